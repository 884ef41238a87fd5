//! Fast paths against their slow twins, and the properties that the targets promise.

use lgs_engine::loss::LossWeights;
use lgs_formats::targets::{Normalise, Signal, TargetsConfig, ZScore};
use lgs_targetgen::branches::Round;
use lgs_targetgen::delta::{Deltas, merge_rounds};
use lgs_targetgen::generate::{Seconds, deltas};
use lgs_targetgen::reference;
use lgs_targetgen::target::{Moments, Targets, signed_log, stored, targets};
use lgs_tests::{Outcome, case};
use libtest_mimic::Trial;

use super::problems::{Made, config, random};

const TOLERANCE: f64 = 1e-5;

pub(crate) fn cases() -> Vec<Trial> {
    let kinds = [
        ("response_branch", Signal::Response, Normalise::Branch),
        ("response_original", Signal::Response, Normalise::Original),
        ("footprint", Signal::Footprint, Normalise::Branch),
        ("magnitude", Signal::Magnitude, Normalise::Branch),
        ("exact", Signal::Exact, Normalise::Branch),
    ];
    let mut cases = Vec::new();
    for (name, signal, normalise) in kinds {
        let config = TargetsConfig { normalise, ..config(signal) };
        let own = config.clone();
        cases.push(case(format!("targetgen::twin::{name}"), move || equals_twin(&own)));
        cases.push(case(format!("targetgen::loss_scale::{name}"), move || unchanged_by_loss_scale(&config)));
    }
    cases.push(case("targetgen::targets::fall_as_deltas_rise", fall_as_deltas_rise));
    cases.push(case("targetgen::targets::zero_variance", zero_variance));
    cases
}

/// Deltas of the fast path, and targets.
pub(crate) fn fast(
    made: &Made,
    weights: LossWeights,
    config: &TargetsConfig,
    seed: u64,
) -> Result<(Deltas, Targets), String> {
    let found = deltas(&made.problem(weights), config, seed, &mut Seconds::default()).map_err(|e| e.to_string())?;
    let ((prune, prune_mask), (add, add_mask)) = (stored(&found.actions.prune), stored(&found.actions.add));
    let targets = targets([&prune, &add], [&prune_mask, &add_mask], config);
    Ok((found, targets))
}

fn equals_twin(config: &TargetsConfig) -> Outcome {
    for seed in 0..20 {
        let made = random(60, 100 + seed);
        let (found, got) = fast(&made, LossWeights::default(), config, seed)?;
        let rounds = Round::all(&made.set, config, seed);
        let twin = merge_rounds(&rounds, &reference::deltas(&made.usual(), &rounds, config));
        if (&found.index, &found.samples) != (&twin.index, &twin.samples) {
            return Err(format!("scene {seed}: other primitives were sampled").into());
        }
        if found.index.is_empty() {
            return Err("nothing was sampled".into());
        }
        let want = reference::targets([&twin.actions.prune, &twin.actions.add], config);
        let pairs = [
            (&found.actions.prune, &twin.actions.prune, &got.prune.y, &want[0]),
            (&found.actions.add, &twin.actions.add, &got.add.y, &want[1]),
        ];
        for (action, (delta, twin, y, want_y)) in pairs.into_iter().enumerate() {
            for k in 0..delta.len() {
                let name = format!("scene {seed}, action {action}, primitive {}", found.index[k]);
                match (delta[k], twin[k]) {
                    (None, None) => {}
                    (Some(d), Some(t)) if (d - t).abs() <= TOLERANCE * (1.0 + t.abs()) => {}
                    (d, t) => return Err(format!("{name}: delta {d:?}, twin {t:?}").into()),
                }
                let (y, want) = (f64::from(y[k]), want_y[k].unwrap_or(0.5));
                if y.is_nan() || (y - want).abs() > TOLERANCE {
                    return Err(format!("{name}: target {y}, twin {want}").into());
                }
            }
        }
    }
    Ok(())
}

fn unchanged_by_loss_scale(config: &TargetsConfig) -> Outcome {
    let made = random(150, 7);
    let scaled = |by: f32| {
        let LossWeights { l1, ssim, depth, velocity, psnr } = LossWeights::default();
        LossWeights { l1: l1 * by, ssim: ssim * by, depth: depth * by, velocity: velocity * by, psnr: psnr * by }
    };
    let (_, want) = fast(&made, scaled(1.0), config, 3)?;
    for by in [1e-6, 1e6] {
        let (_, got) = fast(&made, scaled(by), config, 3)?;
        for (got, want) in [(&got.prune, &want.prune), (&got.add, &want.add)] {
            if got.mask != want.mask {
                return Err(format!("loss times {by}: another mask").into());
            }
            let apart = got.y.iter().zip(&want.y).map(|(g, w)| (g - w).abs()).fold(0.0, f32::max);
            if f64::from(apart) > TOLERANCE {
                return Err(format!("loss times {by}: a target moved by {apart}").into());
            }
        }
    }
    Ok(())
}

fn fall_as_deltas_rise() -> Outcome {
    let rising: Vec<f32> = (0..200_u8).map(|i| (f32::from(i) - 90.0) / 40.0).collect();
    let mask = vec![true; rising.len()];
    for (scale, zscore) in [(1.0, ZScore::Joint), (0.01, ZScore::PerAction)] {
        let config = TargetsConfig { log_scale: scale, zscore, ..config(Signal::Response) };
        let found = targets([&rising, &rising], [&mask, &mask], &config);
        for y in [&found.prune.y, &found.add.y] {
            if let Some(k) = (1..y.len()).find(|&k| y[k] >= y[k - 1]) {
                return Err(format!("scale {scale}: y[{k}] = {} after {}", y[k], y[k - 1]).into());
            }
        }
    }
    let odd = signed_log(-2.0, 0.5) == -signed_log(2.0, 0.5) && (signed_log(2.0, 0.5) - 5.0_f64.ln()).abs() < 1e-12;
    if odd { Ok(()) } else { Err(format!("the transform of 2 at 0.5 is {}", signed_log(2.0, 0.5)).into()) }
}

fn zero_variance() -> Outcome {
    let (same, mask) = (vec![0.3_f32; 9], vec![true; 9]);
    let found = targets([&same, &same], [&mask, &mask], &config(Signal::Response));
    let one = targets([&same[..1], &[]], [&mask[..1], &[]], &config(Signal::Response));
    let none = targets([&same, &same], [&[false; 9], &[false; 9]], &config(Signal::Response));
    let half = [&found.prune.y, &found.add.y, &one.prune.y, &none.add.y].into_iter().flatten().all(|&y| y == 0.5);
    let still = found.moments[0].deviation == 0.0 && none.moments == [Moments::default(); 2];
    if half && still { Ok(()) } else { Err(format!("{found:?}").into()) }
}
