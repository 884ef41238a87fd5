//! Pruning by exact effects, in rounds.
//!
//! Each effect is that of one Gaussian if all others stay. Of two of which either alone could go, both look worthless: what goes in one round is
//! therefore little, and what is left is looked at again.

use super::Evidence;
use crate::densify::{Limit, Scope, UpdateCounts};
use crate::gaussians::GaussianSet;
use crate::loss::LossWeights;
use crate::views::View;

/// Rounds in which a scene falls to a limit. Held-out PSNR of half of 68 thousand Gaussians after three learned steps (a front camera of
/// 270x480): 29.03 dB in 1 round, 29.10 in 2, 29.18 in 3, 29.20 in 6; by chance 28.13.
pub const ROUNDS: usize = 3;
/// Largest share of the scene, one over this, that goes in a round where no limit asks for more.
const WITHOUT_LIMIT: usize = 10;

/// The Gaussians of a scene that stay, in its order, when it is pruned to a limit, or, where there is none, of whatever it is better without;
/// `done` is told of every round.
///
/// # Formula
/// Before each round the effects are measured anew; those with the least [`Evidence::costs`] go, ties by index. To a limit: the same share of what
/// is there in each of [`ROUNDS`]. Without one: those of a negative cost, at most a tenth of the scene a round.
pub fn survivors(
    scene: &GaussianSet,
    views: &[&View],
    scope: Scope,
    limit: Option<Limit>,
    done: &mut dyn FnMut(),
) -> Vec<usize> {
    let count = |scene: &GaussianSet| if scope == Scope::All { scene.len() } else { scene.num_lidar };
    let first = count(scene);
    let target = limit.map(|limit| limit.of(first).min(first));
    let mut kept: Vec<usize> = (0..scene.len()).collect();
    for round in 1..=ROUNDS {
        let left = of_rows(scene, &kept);
        let now = count(&left);
        let most = target.map_or(now / WITHOUT_LIMIT, |target| now.saturating_sub(between(first, target, round)));
        if most > 0 {
            let costs = Evidence::of(&left, views, &LossWeights::default()).costs();
            let mut order: Vec<usize> = (0..now).filter(|&i| target.is_some() || costs[i] < 0.0).collect();
            order.sort_by(|&a, &b| costs[a].total_cmp(&costs[b]).then(a.cmp(&b)));
            let mut stays = vec![true; left.len()];
            order.iter().take(most).for_each(|&i| stays[i] = false);
            kept = kept.into_iter().zip(stays).filter_map(|(i, stays)| stays.then_some(i)).collect();
        }
        done();
    }
    kept
}

/// Prunes a scene to its [`survivors`].
pub fn prune(
    scene: &mut GaussianSet,
    views: &[&View],
    scope: Scope,
    limit: Option<Limit>,
    done: &mut dyn FnMut(),
) -> UpdateCounts {
    let before = [scene.num_lidar, scene.len() - scene.num_lidar];
    *scene = of_rows(scene, &survivors(scene, views, scope, limit, done));
    let [pruned, background_pruned] = [before[0] - scene.num_lidar, before[1] - (scene.len() - scene.num_lidar)];
    UpdateCounts { pruned, added: 0, background_pruned }
}

/// The scene of some rows of another, in their order.
fn of_rows(scene: &GaussianSet, rows: &[usize]) -> GaussianSet {
    scene.select(rows, rows.partition_point(|&i| i < scene.num_lidar))
}

/// The number after a round on the way from `first` to `target`, by equal shares.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between the two numbers")]
fn between(first: usize, target: usize, round: usize) -> usize {
    if round == ROUNDS || target == 0 {
        return target;
    }
    let share = (target as f64 / first as f64).powf(round as f64 / ROUNDS as f64);
    (first as f64 * share).round() as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evidence::samples::{scene, view};

    #[test]
    fn a_limit_is_met_by_the_branches_that_it_counts() {
        let view = view();
        for (scope, limit, left) in [
            (Scope::All, Limit::Percent(50), [None, Some(40)]),
            (Scope::All, Limit::Count(0), [Some(0), Some(0)]),
            (Scope::All, Limit::Count(1000), [Some(60), Some(80)]),
            (Scope::Lidar, Limit::Count(17), [Some(17), Some(37)]),
        ] {
            let (mut pruned, mut rounds) = (scene(0.0), 0);
            let counts = prune(&mut pruned, &[&view], scope, Some(limit), &mut || rounds += 1);
            assert_eq!((rounds, pruned.len()), (ROUNDS, left[1].unwrap()), "{limit}");
            assert!(left[0].is_none_or(|lidar| lidar == pruned.num_lidar), "{limit}");
            assert_eq!(counts.pruned, 60 - pruned.num_lidar);
            assert_eq!(counts.background_pruned, 20 - (pruned.len() - pruned.num_lidar));
        }
    }

    #[test]
    fn without_a_limit_the_loss_falls() {
        let view = view();
        let loss = |set: &GaussianSet| crate::objective::objective(set, &[&view], &LossWeights::default()).loss;
        let before = scene(2.0);
        let mut after = before.clone();
        let counts = prune(&mut after, &[&view], Scope::All, None, &mut || ());
        assert!(counts.pruned > 0 && loss(&after) < loss(&before), "{} {}", loss(&after), loss(&before));
        assert!(after.len() >= before.len() - 3 * (before.len() / WITHOUT_LIMIT));
    }
}
