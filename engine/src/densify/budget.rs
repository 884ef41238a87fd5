//! The actions that meet a budget.

use super::{Action, Limit, Scores, Thresholds, by_thresholds};
use crate::error::Result;

/// How much the share of the primitives that a score beats counts beside the even order.
const SCORE: f64 = 0.5;

/// What becomes of the primitives that the scores are of: [`by_budget`] under a limit, otherwise [`by_thresholds`].
///
/// # Errors
/// When a score is not finite.
pub fn decide(scores: &Scores, thresholds: Thresholds, limit: Option<Limit>) -> Result<Vec<Action>> {
    match limit {
        Some(limit) => by_budget(scores, thresholds, limit.of(scores.prune.len())),
        None => by_thresholds(scores, thresholds),
    }
}

/// The actions that thresholds decide, held to at most `budget` primitives by rank: first the worst are pruned, then the best
/// additions are made.
///
/// # Formula
/// The rank is that of `0.5 q + u`: q the share of the primitives with a lower score, u in 0..1 an order of which every beginning leaves gaps of
/// even size between the indices, which follow frames and beams. Neighbours have like scores, each given as if the others stayed: by q alone
/// whole surfaces would go; with u, surfaces that need fewer are thinned more. A policy that tells nothing apart thins evenly.
///
/// # Errors
/// When a score is not finite.
pub fn by_budget(scores: &Scores, thresholds: Thresholds, budget: usize) -> Result<Vec<Action>> {
    let mut actions = by_thresholds(scores, thresholds)?;
    let kept: Vec<usize> = (0..actions.len()).filter(|&i| actions[i] != Action::Prune).collect();
    if kept.len() > budget {
        for &i in &by_rank(&scores.prune, &kept)[..kept.len() - budget] {
            actions[i] = Action::Prune;
        }
    }
    let kept = actions.iter().filter(|&&a| a != Action::Prune).count();
    let copies: Vec<usize> = (0..actions.len()).filter(|&i| actions[i] == Action::Copy).collect();
    for &i in by_rank(&scores.add, &copies).iter().skip(budget - kept) {
        actions[i] = Action::Keep;
    }
    Ok(actions)
}

/// The `places` by rank, first those to act on first.
fn by_rank(scores: &[f32], places: &[usize]) -> Vec<usize> {
    let (ranks, mut order) = (ranks(scores), places.to_vec());
    order.sort_by(|&a, &b| ranks[b].total_cmp(&ranks[a]).then(a.cmp(&b)));
    order
}

/// `[N]` the rank of each score, from -1 to 0.5; the highest is to be acted on first.
pub(super) fn ranks(scores: &[f32]) -> Vec<f64> {
    let mut sorted = scores.to_vec();
    sorted.sort_by(f32::total_cmp);
    let below = |score: &f32| sorted.partition_point(|other| other.total_cmp(score).is_lt());
    let share = |score: &f32| below(score) as f64 / sorted.len() as f64;
    scores.iter().enumerate().map(|(i, score)| SCORE.mul_add(share(score), -spread(i))).collect()
}

/// The place of an index, in 0..1, in an order of which every beginning lies evenly among the indices (multiples of the golden ratio, modulo 1).
fn spread(index: usize) -> f64 {
    (index as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) as f64 / 2.0_f64.powi(64)
}

#[cfg(test)]
mod tests {
    use super::{Action, Scores, Thresholds, by_budget};

    #[test]
    fn equal_scores_thin_evenly() {
        let scores = Scores { prune: vec![0.5; 1000], add: vec![0.5; 1000] };
        for budget in [999, 700, 500, 100] {
            let actions = by_budget(&scores, Thresholds::default(), budget).unwrap();
            let pruned = |part: &[Action]| part.iter().filter(|&&a| a == Action::Prune).count();
            assert_eq!(pruned(&actions), 1000 - budget);
            let share = (1000 - budget) / 10;
            assert!(actions.chunks(100).all(|part| pruned(part).abs_diff(share) <= 2), "{budget}");
        }
    }

    #[test]
    fn a_surface_of_worse_scores_is_thinned_more_and_does_not_go_whole() {
        let prune: Vec<f32> = (0..1000).map(|i| if i % 100 < 50 { 0.6 } else { 0.2 }).collect();
        let scores = Scores { add: vec![0.0; prune.len()], prune };
        let actions = by_budget(&scores, Thresholds::default(), 700).unwrap();
        let pruned =
            |worse: bool| (0..1000).filter(|i| (i % 100 < 50) == worse && actions[*i] == Action::Prune).count();
        let (worse, better) = (pruned(true), pruned(false));
        // Shares t and t - 1/4 of the halves go, for a mean of 3/10.
        assert!(worse.abs_diff(212) <= 5 && better.abs_diff(88) <= 5, "{worse} {better}");
    }
}
