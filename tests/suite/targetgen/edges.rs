//! Settings and scenes at their ends: defined results, no value that is not finite.

use lgs_engine::gaussians::GaussianSet;
use lgs_engine::loss::LossWeights;
use lgs_formats::targets::{Signal, TargetsConfig, ZScore};
use lgs_targetgen::delta::Deltas;
use lgs_targetgen::target::Targets;
use lgs_tests::{Outcome, case};
use libtest_mimic::Trial;

use super::problems::{Made, config, random};
use super::twin::fast;

const SIGNALS: [Signal; 4] = [Signal::Response, Signal::Footprint, Signal::Magnitude, Signal::Exact];

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("targetgen::edges::rho_0", || {
            each(&random(60, 1), 0.0, |signal, d, _| d.index.is_empty() != (signal == Signal::Exact))
        }),
        case("targetgen::edges::rho_1", rho_1),
        case("targetgen::edges::fewer_than_k_plus_1", || each(&random(5, 2), 0.5, |_, d, _| !d.index.is_empty())),
        case("targetgen::edges::one_primitive", one_primitive),
        case("targetgen::edges::no_primitive", || each(&random(0, 4), 1.0, |_, d, _| d.index.is_empty())),
        case("targetgen::edges::all_invisible", all_invisible),
        case("targetgen::edges::no_view", no_view),
        case("targetgen::edges::spoilt_gaussian", spoilt_gaussian),
    ]
}

/// Every signal and population on a scene: finite, within bounds, and what `holds` says.
fn each(made: &Made, rho: f64, holds: fn(Signal, &Deltas, &Targets) -> bool) -> Outcome {
    for signal in SIGNALS {
        for zscore in [ZScore::Joint, ZScore::PerAction] {
            let config = TargetsConfig { rho, zscore, ..config(signal) };
            let (deltas, targets) = fast(made, LossWeights::default(), &config, 11)?;
            for action in [&targets.prune, &targets.add] {
                let fine =
                    action.y.iter().all(|y| (0.0..=1.0).contains(y)) && action.delta.iter().all(|d| d.is_finite());
                let masked = action.y.iter().zip(&action.mask).all(|(&y, &set)| set || y == 0.5);
                if !fine || !masked || action.y.len() != deltas.index.len() {
                    return Err(format!("{signal:?} {zscore:?}: {action:?}").into());
                }
            }
            if !holds(signal, &deltas, &targets) {
                return Err(format!("{signal:?} {zscore:?}: {deltas:?} {targets:?}").into());
            }
        }
    }
    Ok(())
}

fn any(mask: &[bool]) -> bool {
    mask.contains(&true)
}

/// All are removed: nobody is left to respond, so pruning has no targets; adding has.
fn rho_1() -> Outcome {
    each(&random(40, 3), 1.0, |signal, deltas, targets| {
        let rounds = if signal == Signal::Exact { 1 } else { 3 };
        let all = deltas.index.len() == 40 && deltas.samples.iter().all(|&count| count == rounds);
        all && any(&targets.add.mask) && (signal != Signal::Response || !any(&targets.prune.mask))
    })
}

/// One primitive has no neighbours: the response says nothing; its footprint says something, against which there is no variance but its own.
fn one_primitive() -> Outcome {
    each(&random(1, 5), 1.0, |signal, deltas, targets| {
        let none = !any(&targets.prune.mask) && !any(&targets.add.mask);
        deltas.index == [0] && (none || signal != Signal::Response)
    })
}

/// Behind the cameras: nothing to learn from.
fn all_invisible() -> Outcome {
    let mut made = random(60, 6);
    made.set.attributes[..60].iter_mut().for_each(|row| row[2] = -row[2]);
    each(&made, 0.5, |_, deltas, targets| {
        !deltas.index.is_empty() && !any(&targets.prune.mask) && !any(&targets.add.mask)
    })
}

fn no_view() -> Outcome {
    let made = Made { set: random(30, 8).set, views: Vec::new() };
    each(&made, 0.5, |_, _, targets| !any(&targets.prune.mask) && !any(&targets.add.mask))
}

/// A Gaussian whose colour is not a number is not drawn; the others keep their targets.
fn spoilt_gaussian() -> Outcome {
    let mut made = random(60, 9);
    made.set.attributes[7][12] = f32::NAN;
    let GaussianSet { num_lidar, .. } = made.set;
    if num_lidar != 60 {
        return Err("another scene".into());
    }
    each(&made, 0.5, |_, _, targets| any(&targets.prune.mask) && any(&targets.add.mask))
}
