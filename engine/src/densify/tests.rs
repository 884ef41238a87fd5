//! The set update against the paper's rule and counts.

use proptest::prelude::*;

use super::{Action, Scores, Thresholds, apply, at_random, by_budget, by_thresholds, count};
use crate::gaussians::GaussianSet;

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
