//! Scores, budgets, deltas and sums at their ends.

use std::sync::Arc;

use candle_core::{Device, Tensor};
use lgs_engine::densify::{Action, Scores, Thresholds, apply, at_random, by_budget, by_thresholds, count};
use lgs_engine::ops::knn::nearest_of;
use lgs_engine::ops::segment::{Segments, mean_pool};
use lgs_formats::targets::{Signal, TargetsConfig, ZScore};
use lgs_targetgen::response::{Maxima, responses};
use lgs_targetgen::target::{Moments, Targets, targets};
use lgs_tests::Outcome;

use super::tiny::{noise, set_of};
use super::{Extreme, ensure, failed};
use crate::targetgen::config;

/// Terms of the largest sums.
const MANY: usize = 100_000_000;

pub(super) const CASES: &[Extreme] = &[
    Extreme::new(
        "scores_at_the_thresholds",
        "scores equal to the thresholds, to the ends, and -0",
        "strictly above decides: nothing at 1, nothing at equality",
        at_thresholds,
    ),
    Extreme::new(
        "all_pruned",
        "every score above the threshold for pruning",
        "an empty LiDAR branch, the background as it was",
        || updated(1.0, 1.0, 0),
    ),
    Extreme::new("all_added", "every score above the threshold for a copy only", "twice as many, all finite", || {
        updated(0.0, 1.0, 2)
    }),
    Extreme::new("budget_of_zero", "a budget of 0", "an empty LiDAR branch", || budget(0)),
    Extreme::new("budget_above_all", "budgets of N, 2 N and the largest count", "what the scores ask for", || {
        [90, 180, usize::MAX].into_iter().try_for_each(budget)
    }),
    Extreme::new(
        "scores_that_are_not_finite",
        "NaN and infinities among the scores",
        "an error that names score and Gaussian, never a prune",
        spoilt_scores,
    ),
    Extreme::new("an_empty_set", "no primitive", "no action, an empty set", empty_set),
    Extreme::new(
        "z_score_of_none_one_two_equal",
        "no delta, one, two, a thousand equal",
        "targets in 0..=1; 0.5 where there is no variance",
        few_deltas,
    ),
    Extreme::new(
        "z_score_of_1e30_spread",
        "deltas from -1e30 to 1e30, and at the end of f32",
        "targets in 0..=1 that fall as deltas rise",
        || spread(&[-3e38, -1e30, -1.0, 0.0, 1e-30, 1.0, 1e30, 3e38], 1.0),
    ),
    Extreme::new(
        "z_score_of_denormals",
        "deltas of 1e-45 to 1e-38",
        "targets in 0..=1 that fall as deltas rise: f64 holds their squares",
        || spread(&[-1e-38, -1e-45, 0.0, 1e-45, 1e-38], 1.0),
    ),
    Extreme::new(
        "z_score_under_any_log_scale",
        "the same deltas under scales of 1e-300 and 1e300",
        "targets in 0..=1",
        || [1e-300, 1e300].into_iter().try_for_each(|scale| spread(&[-3e38, -1.0, 1e-45, 1.0, 3e38], scale)),
    ),
    Extreme::new(
        "sums_of_many_terms",
        "10^8 values of 0.1, and their moments",
        "the mean within 1e-9, no variance: sums are f64",
        many_terms,
    ),
    Extreme::new(
        "a_voxel_of_many_rows",
        "10^8 rows of one voxel, 0.1 each",
        "their mean to the last bit of f32: sums are f64",
        many_rows,
    ),
    Extreme::new(
        "more_neighbours_than_points",
        "64 neighbours of three points, and of one",
        "those that there are, nearest first",
        few_neighbours,
    ),
    Extreme::new(
        "responses_of_denormals_and_of_1e38",
        "gradients of 1e-45 and of 3e38",
        "responses in 0..=1",
        extreme_responses,
    ),
];

fn scores(prune: f32, add: f32, n: usize) -> Scores {
    Scores { prune: vec![prune; n], add: vec![add; n] }
}

fn at_thresholds() -> Outcome {
    for (score, threshold, above) in [
        (0.7, 0.7, false),
        (1.0, 1.0, false),
        (0.0, 0.0, false),
        (-0.0, 0.0, false),
        (1e-45, 0.0, true),
        (1.0, 0.999_999_9, true),
    ] {
        let thresholds = Thresholds { prune: threshold, add: threshold };
        let pruned = by_thresholds(&scores(score, 0.0, 1), thresholds).map_err(failed)? == [Action::Prune];
        ensure(pruned == above, || format!("score {score} over {threshold}: {pruned}"))?;
    }
    Ok(())
}

fn updated(prune: f32, add: f32, times: usize) -> Outcome {
    let (set, _) = noise(100, 1);
    let actions = by_thresholds(&scores(prune, add, set.num_lidar), Thresholds::default()).map_err(failed)?;
    let after = apply(&set, &actions, 3).map_err(failed)?;
    after.check_finite().map_err(failed)?;
    let background = |s: &lgs_engine::gaussians::GaussianSet| s.attributes[s.num_lidar..].to_vec();
    let as_wanted = after.num_lidar == times * set.num_lidar && background(&after) == background(&set);
    ensure(as_wanted, || format!("{} of {}", after.num_lidar, set.num_lidar))
}

fn budget(budget: usize) -> Outcome {
    let (set, _) = noise(100, 1);
    let graded = |salt: usize| -> Vec<f32> { (0..set.num_lidar).map(|i| ((i * salt) % 100) as f32 / 100.0).collect() };
    let scores = Scores { prune: graded(37), add: graded(61) };
    let free = count(&by_thresholds(&scores, Thresholds::default()).map_err(failed)?);
    let last = set.num_lidar - free.pruned + free.added;
    let held = by_budget(&scores, Thresholds::default(), budget).map_err(failed)?;
    let after = apply(&set, &held, 3).map_err(failed)?;
    ensure(after.num_lidar == last.min(budget), || format!("{} of {last} within {budget}", after.num_lidar))
}

fn spoilt_scores() -> Outcome {
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for kind in ["prune", "add"] {
            let mut scores = scores(0.1, 0.1, 9);
            let column = if kind == "prune" { &mut scores.prune } else { &mut scores.add };
            column[4] = value;
            for said in [by_thresholds(&scores, Thresholds::default()), by_budget(&scores, Thresholds::default(), 3)] {
                let said = said.map_err(|e| e.to_string()).err().unwrap_or_default();
                ensure(said.starts_with(&format!("{kind} score of Gaussian 4: expected")), || said.clone())?;
            }
        }
    }
    Ok(())
}

fn empty_set() -> Outcome {
    let actions = by_budget(&Scores::default(), Thresholds::default(), 5).map_err(failed)?;
    let after = apply(&set_of(Vec::new(), 0), &actions, 3).map_err(failed)?;
    ensure(after.is_empty() && at_random(&actions, 1).is_empty(), || "something came of nothing".to_owned())
}

/// Targets of the same deltas for both actions, all of them valid.
fn targets_of(deltas: &[f32], zscore: ZScore, log_scale: f64) -> Result<Targets, libtest_mimic::Failed> {
    let mask = vec![true; deltas.len()];
    let config = TargetsConfig { zscore, log_scale, ..config(Signal::Footprint) };
    let found = targets([deltas, deltas], [mask.as_slice(), &mask], &config);
    for action in [&found.prune, &found.add] {
        ensure(action.y.iter().all(|y| (0.0..=1.0).contains(y)), || format!("{:?}", action.y))?;
    }
    Ok(found)
}

fn few_deltas() -> Outcome {
    for zscore in [ZScore::Joint, ZScore::PerAction] {
        targets_of(&[], zscore, 1.0)?;
        targets_of(&[3.0, -3.0], zscore, 1.0)?;
        for deltas in [vec![3.0], vec![0.1; 1000], vec![0.0; 3]] {
            let found = targets_of(&deltas, zscore, 1.0)?;
            ensure(found.prune.y.iter().all(|&y| y == 0.5), || format!("{:?}", &found.prune.y[..1]))?;
        }
    }
    Ok(())
}

fn spread(deltas: &[f32], scale: f64) -> Outcome {
    for zscore in [ZScore::Joint, ZScore::PerAction] {
        let found = targets_of(deltas, zscore, scale)?;
        ensure(found.prune.y.is_sorted_by(|a, b| a >= b), || format!("{:?}", found.prune.y))?;
    }
    Ok(())
}

fn many_terms() -> Outcome {
    let moments = Moments::of(&vec![0.1; MANY]);
    ensure((moments.mean - 0.1).abs() < 1e-9 && moments.deviation == 0.0, || format!("{moments:?}"))
}

fn many_rows() -> Outcome {
    let segments = Arc::new(Segments::new(vec![0; MANY], 1)?);
    let rows = Tensor::from_vec(vec![0.1_f32; MANY], (MANY, 1), &Device::Cpu)?;
    let mean: Vec<f32> = mean_pool(&rows, &segments)?.flatten_all()?.to_vec1()?;
    ensure(mean == [0.1], || format!("{mean:?}"))
}

fn few_neighbours() -> Outcome {
    let found = nearest_of(&[[0.0; 3], [2.0, 0.0, 0.0], [1.0, 0.0, 0.0]], &[0, 1, 2], 64).map_err(failed)?;
    let alone = nearest_of(&[[0.0; 3]], &[0], 64).map_err(failed)?;
    ensure(found.of(0) == [2, 1] && alone.of(0).is_empty(), || format!("{:?}", found.of(0)))
}

fn extreme_responses() -> Outcome {
    let mut rows = vec![[0.0; 14]; 3];
    for value in [1e-45, 3e38] {
        (rows[0], rows[1][3]) = ([value; 14], -value);
        let found = responses(&rows, &Maxima::of(&rows));
        ensure(found.iter().all(|r| (0.0..=1.0 + 1e-12).contains(r)) && found[2] == 0.0, || format!("{found:?}"))?;
    }
    Ok(())
}
