//! The set update against the paper's rule and counts.

use proptest::prelude::*;
use rand_chacha::rand_core::Rng;

use super::budget::ranks;
use super::random::generator;
use super::{Action, COPY_NOISE, Scores, Thresholds, apply, at_random, by_budget, by_thresholds, count, origins};
use crate::gaussians::GaussianSet;

fn set(num_lidar: usize, background: usize) -> GaussianSet {
    let n = num_lidar + background;
    GaussianSet {
        attributes: (0..n).map(|i| [i as f32; 14]).collect(),
        times: vec![0.5; n],
        frames: (0..).take(n).collect(),
        velocities: vec![[1.0; 3]; n],
        num_lidar,
    }
}

proptest! {
    /// The worst go first, then the best copies come: among neighbours in the even order, no score of what went or was not copied beats one
    /// of what stayed or was.
    #[test]
    fn a_budget_goes_by_rank(rows in proptest::collection::vec((0_u8..20, 0_u8..20), 0..120), budget in 0_usize..150) {
        let score = |value: u8| f32::from(value) / 20.0;
        let scores = Scores { prune: rows.iter().map(|r| score(r.0)).collect(), add: rows.iter().map(|r| score(r.1)).collect() };
        let thresholds = Thresholds { prune: 0.6, add: 0.4 };
        let free = by_thresholds(&scores, thresholds).unwrap();
        let held = by_budget(&scores, thresholds, budget).unwrap();
        let is = |actions: &[Action], wanted: Action| (0..rows.len()).filter(|&i| actions[i] == wanted).collect::<Vec<_>>();
        let rank = |scores: &[f32], i: usize| ranks(scores)[i];
        let stayed = (0..rows.len()).filter(|&i| held[i] != Action::Prune);
        let worst_stayed = stayed.map(|i| rank(&scores.prune, i)).max_by(|a, b| a.partial_cmp(b).unwrap());
        for i in is(&held, Action::Prune).into_iter().filter(|&i| free[i] != Action::Prune) {
            prop_assert!(worst_stayed.is_none_or(|worst| rank(&scores.prune, i) > worst));
        }
        let copied = is(&held, Action::Copy);
        let best_left = (0..rows.len()).filter(|&i| free[i] == Action::Copy && held[i] == Action::Keep);
        let best_left = best_left.map(|i| rank(&scores.add, i)).max_by(|a, b| a.partial_cmp(b).unwrap());
        for &i in &copied {
            prop_assert!(free[i] == Action::Copy && best_left.is_none_or(|best| rank(&scores.add, i) > best));
        }
        // Nobody is pruned while a copy is made, unless the thresholds say so.
        let by_rank = is(&held, Action::Prune).len() > is(&free, Action::Prune).len();
        prop_assert!(!by_rank || copied.is_empty());
    }

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
        let turned = Scores { prune: scores.add, add: scores.prune };
        let text = by_budget(&turned, Thresholds::default(), 5).unwrap_err().to_string();
        assert!(text.contains("add score of Gaussian 1"), "{text}");
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

/// From 519.8 K, 2.25 % pruned and 14.91 % over the addition threshold, independently, give 584.2 K: pruning takes precedence.
#[test]
fn counts_of_the_paper() {
    let n = 519_800_usize;
    let mut rng = generator(11, 0, 2);
    let mut draw = |share: f64| -> Vec<f32> {
        (0..n).map(|_| if f64::from(rng.next_u32()) < share * f64::from(u32::MAX) { 0.9 } else { 0.1 }).collect()
    };
    let scores = Scores { prune: draw(0.0225), add: draw(0.1491) };
    let counts = count(&by_thresholds(&scores, Thresholds::default()).unwrap());
    let total = n - counts.pruned + counts.added;
    assert!(total.abs_diff(584_200) < 1_000, "{total}");
}

#[test]
fn what_is_kept_keeps_its_bits_and_copies_come_before_the_background() {
    let mut start = set(4, 2);
    start.attributes[1] = [-0.0; 14];
    let actions = [Action::Copy, Action::Keep, Action::Prune, Action::Copy];
    let updated = apply(&start, &actions, 1).unwrap();
    assert_eq!(origins(&actions), [0, 1, 3, 0, 3]);
    assert_eq!((updated.num_lidar, updated.len()), (5, 7));
    let same = |got: usize, want: usize| {
        let bits = |row: &[f32; 14]| row.map(f32::to_bits);
        assert_eq!(bits(&updated.attributes[got]), bits(&start.attributes[want]), "{got} is {want}");
    };
    [(0, 0), (1, 1), (2, 3), (5, 4), (6, 5)].into_iter().for_each(|(got, want)| same(got, want));
    assert_eq!(updated.frames, [0, 1, 3, 0, 3, 4, 5], "copies are of the frame of their original");
}

#[test]
fn displacements_have_the_spread_of_the_paper() {
    let n = 20_000;
    let start = GaussianSet { attributes: vec![[0.0; 14]; n], ..set(n, 0) };
    let copies = apply(&start, &vec![Action::Copy; n], 3).unwrap();
    for axis in 0..3 {
        let moved: Vec<f64> = copies.attributes[n..].iter().map(|row| f64::from(row[axis])).collect();
        let mean = moved.iter().sum::<f64>() / n as f64;
        let spread = (moved.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n as f64).sqrt();
        assert!(mean.abs() < 4e-4 && (spread / COPY_NOISE - 1.0).abs() < 0.03, "axis {axis}: {mean}, {spread}");
    }
}
