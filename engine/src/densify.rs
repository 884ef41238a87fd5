//! The set update: which primitives go, which get a copy beside them.
//!
//! # Formula
//! Keep i iff `p_prune_i <= theta_p`; add a copy of i iff `p_add_i > theta_a` and `p_prune_i <= theta_p`. The copy has every attribute of i and
//! stands at `x + N(0, 0.01 m)` per axis.
//!
//! # Source
//! The paper, section 3.2, feed-forward density adjustment.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use crate::error::{EngineError, Result};
use crate::gaussians::{GaussianSet, MEAN};

/// Standard deviation of a copy's displacement per axis, metres.
pub const COPY_NOISE: f64 = 0.01;

/// Scores of the `LiDAR` branch.
///
/// # Shapes
/// Both `[num_lidar]`, in 0..=1.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scores {
    /// How much pruning would help.
    pub prune: Vec<f32>,
    /// How much a copy would help.
    pub add: Vec<f32>,
}

/// Scores above these decide.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Thresholds {
    /// `theta_p`.
    pub prune: f32,
    /// `theta_a`.
    pub add: f32,
}

impl Default for Thresholds {
    fn default() -> Self {
        Self { prune: 0.7, add: 0.7 }
    }
}

/// Who decides what is pruned and added.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Density {
    /// The learned policy.
    Policy,
    /// Chance, as often as the policy would: the ablation.
    Random,
    /// Nobody: the set stays as it is.
    Off,
}

/// What happens to one primitive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// Nothing.
    Keep,
    /// It is taken out.
    Prune,
    /// It stays and a copy comes beside it.
    Copy,
}

/// How many primitives an update took out and added.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct UpdateCounts {
    /// Taken out.
    pub pruned: usize,
    /// Copies added.
    pub added: usize,
}

impl Scores {
    /// # Errors
    /// When a score is not finite, or the two differ in length.
    fn check(&self) -> Result<()> {
        if self.prune.len() != self.add.len() {
            return Err(EngineError::Setting {
                setting: "densify scores",
                expected: format!("as many prune as add scores ({})", self.prune.len()),
                found: self.add.len().to_string(),
            });
        }
        for (name, scores) in [("prune", &self.prune), ("add", &self.add)] {
            if let Some(i) = scores.iter().position(|s| !s.is_finite()) {
                return Err(EngineError::NonFinite { what: format!("{name} score of Gaussian {i}"), found: scores[i] });
            }
        }
        Ok(())
    }
}

/// The actions that thresholds decide.
///
/// # Errors
/// When a score is not finite.
pub fn by_thresholds(scores: &Scores, thresholds: Thresholds) -> Result<Vec<Action>> {
    scores.check()?;
    let decide = |(&prune, &add): (&f32, &f32)| {
        if prune > thresholds.prune {
            Action::Prune
        } else if add > thresholds.add {
            Action::Copy
        } else {
            Action::Keep
        }
    };
    Ok(scores.prune.iter().zip(&scores.add).map(decide).collect())
}

/// The actions that thresholds decide, held to at most `budget` primitives by rank: first the worst are pruned, then the best
/// additions are made. Ties by index.
///
/// # Errors
/// When a score is not finite.
pub fn by_budget(scores: &Scores, thresholds: Thresholds, budget: usize) -> Result<Vec<Action>> {
    let mut actions = by_thresholds(scores, thresholds)?;
    let by_score = |scores: &[f32], of: &[usize]| {
        let mut order = of.to_vec();
        order.sort_by(|&a, &b| scores[b].total_cmp(&scores[a]).then(a.cmp(&b)));
        order
    };
    let kept: Vec<usize> = (0..actions.len()).filter(|&i| actions[i] != Action::Prune).collect();
    if kept.len() > budget {
        for &i in &by_score(&scores.prune, &kept)[..kept.len() - budget] {
            actions[i] = Action::Prune;
        }
    }
    let kept = actions.iter().filter(|&&a| a != Action::Prune).count();
    let copies: Vec<usize> = (0..actions.len()).filter(|&i| actions[i] == Action::Copy).collect();
    for &i in by_score(&scores.add, &copies).iter().skip(budget - kept) {
        actions[i] = Action::Keep;
    }
    Ok(actions)
}

/// As many prunes and copies as `actions` has, of primitives drawn at random.
pub fn at_random(actions: &[Action], seed: u64) -> Vec<Action> {
    let counts = count(actions);
    let mut order: Vec<(u64, usize)> = (0..actions.len()).map(|i| (generator(seed, i, 1).next_u64(), i)).collect();
    order.sort_unstable();
    let mut drawn = vec![Action::Keep; actions.len()];
    for (rank, &(_, i)) in order.iter().enumerate() {
        if rank < counts.pruned {
            drawn[i] = Action::Prune;
        } else if rank < counts.pruned + counts.added {
            drawn[i] = Action::Copy;
        }
    }
    drawn
}

/// How many prunes and copies there are.
pub fn count(actions: &[Action]) -> UpdateCounts {
    let of = |action| actions.iter().filter(|&&a| a == action).count();
    UpdateCounts { pruned: of(Action::Prune), added: of(Action::Copy) }
}

/// The set after the actions: what is kept, the copies, the background; each in the order of the set.
///
/// # Shapes
/// `actions` `[num_lidar]`.
///
/// # Errors
/// When there are not as many actions as primitives in the `LiDAR` branch.
pub fn apply(set: &GaussianSet, actions: &[Action], seed: u64) -> Result<GaussianSet> {
    if actions.len() != set.num_lidar {
        return Err(EngineError::Setting {
            setting: "densify actions",
            expected: format!("one per primitive of the LiDAR branch ({})", set.num_lidar),
            found: actions.len().to_string(),
        });
    }
    let mut updated = GaussianSet::default();
    let mut push = |i: usize, offset: [f32; 3]| {
        let mut row = set.attributes[i];
        row[MEAN].iter_mut().zip(offset).for_each(|(x, o)| *x += o);
        updated.attributes.push(row);
        updated.times.push(set.times[i]);
        updated.velocities.push(set.velocities[i]);
    };
    let of = |wanted: fn(Action) -> bool| (0..actions.len()).filter(move |&i| wanted(actions[i]));
    of(|a| a != Action::Prune).for_each(|i| push(i, [0.0; 3]));
    of(|a| a == Action::Copy).for_each(|i| push(i, displacement(seed, i)));
    (set.num_lidar..set.len()).for_each(|i| push(i, [0.0; 3]));
    let counts = count(actions);
    updated.num_lidar = set.num_lidar - counts.pruned + counts.added;
    Ok(updated)
}

/// Displacement of the copy of primitive i: the same for a seed, whatever else is copied and on any number of threads.
#[expect(clippy::cast_possible_truncation, reason = "positions are stored in f32")]
fn displacement(seed: u64, i: usize) -> [f32; 3] {
    let mut rng = generator(seed, i, 0);
    let mut unit = || (f64::from(rng.next_u32()) + 0.5) / 4_294_967_296.0;
    std::array::from_fn(|_| {
        let (radius, angle) = ((-2.0 * unit().ln()).sqrt(), std::f64::consts::TAU * unit());
        (COPY_NOISE * radius * angle.cos()) as f32
    })
}

/// A generator keyed by (seed, primitive, purpose).
fn generator(seed: u64, i: usize, purpose: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream((i as u64) << 8 | purpose);
    rng
}

#[cfg(test)]
mod tests {
    use super::{Action, Scores, Thresholds, apply, at_random, by_budget, by_thresholds, count};
    use crate::gaussians::GaussianSet;
    use proptest::prelude::*;

    fn set(num_lidar: usize, background: usize) -> GaussianSet {
        let n = num_lidar + background;
        GaussianSet {
            attributes: (0..n).map(|i| [i as f32; 14]).collect(),
            times: vec![0.5; n],
            velocities: vec![[1.0; 3]; n],
            num_lidar,
        }
    }

    proptest! {
        #[test]
        fn counts_add_up(rows in proptest::collection::vec((0.0_f32..=1.0, 0.0_f32..=1.0), 0..200), p in 0.0_f32..=1.0, a in 0.0_f32..=1.0, budget in 0_usize..250) {
            let scores = Scores { prune: rows.iter().map(|r| r.0).collect(), add: rows.iter().map(|r| r.1).collect() };
            let thresholds = Thresholds { prune: p, add: a };
            let actions = by_thresholds(&scores, thresholds).unwrap();
            let kept = rows.iter().filter(|r| r.0 <= p).count();
            let added = rows.iter().filter(|r| r.0 <= p && r.1 > a).count();
            let updated = apply(&set(rows.len(), 3), &actions, 7).unwrap();
            prop_assert_eq!(updated.num_lidar, kept + added);
            prop_assert_eq!(updated.len(), kept + added + 3);
            prop_assert_eq!(count(&at_random(&actions, 3)), count(&actions));
            let held = apply(&set(rows.len(), 3), &by_budget(&scores, thresholds, budget).unwrap(), 7).unwrap();
            prop_assert_eq!(held.num_lidar, (kept + added).min(budget));
        }
    }

    #[test]
    fn thresholds_are_strict_and_prune_wins() {
        let scores = Scores { prune: vec![0.7, 0.700_001, 0.9, 0.0], add: vec![0.7, 0.9, 0.9, 0.71] };
        let actions = by_thresholds(&scores, Thresholds::default()).unwrap();
        assert_eq!(actions, [Action::Keep, Action::Prune, Action::Prune, Action::Copy]);
    }

    #[test]
    fn a_score_that_is_not_finite_is_an_error() {
        for bad in [f32::NAN, f32::INFINITY] {
            let scores = Scores { prune: vec![0.1, bad], add: vec![0.0; 2] };
            let text = by_thresholds(&scores, Thresholds::default()).unwrap_err().to_string();
            assert!(text.contains("prune score of Gaussian 1"), "{text}");
        }
    }

    #[test]
    fn a_copy_stands_near_and_does_not_depend_on_other_copies() {
        let one = apply(&set(3, 0), &[Action::Keep, Action::Keep, Action::Copy], 9).unwrap();
        let two = apply(&set(3, 0), &[Action::Copy, Action::Keep, Action::Copy], 9).unwrap();
        assert_eq!(one.attributes[3], two.attributes[4]);
        let moved: Vec<f32> = one.attributes[3][..3].iter().map(|x| x - 2.0).collect();
        assert!(moved.iter().all(|d| d.abs() < 0.08) && moved.iter().any(|d| d.abs() > 1e-4), "{moved:?}");
        assert_eq!(one.attributes[3][3..], one.attributes[2][3..]);
    }

    /// From 519.8 K, 2.25 % pruned and 14.91 % over the addition threshold give 584.2 K: the additions are counted before
    /// pruning takes precedence, and barely overlap with it.
    #[test]
    fn counts_of_the_paper() {
        let n = 519_800_usize;
        let pruned = n * 225 / 10_000;
        let added = n * 1491 / 10_000;
        let scores = Scores {
            prune: (0..n).map(|i| if i < pruned { 0.9 } else { 0.1 }).collect(),
            add: (0..n).map(|i| if i >= n - added { 0.9 } else { 0.1 }).collect(),
        };
        let counts = count(&by_thresholds(&scores, Thresholds::default()).unwrap());
        let total = n - counts.pruned + counts.added;
        assert!(total.abs_diff(584_200) < 1_500, "{total}");
    }
}
