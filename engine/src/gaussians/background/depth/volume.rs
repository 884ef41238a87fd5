//! How well every depth that a pixel may have fits the other images and what else is known: a plane sweep.
//!
//! # Source
//! Collins, A space-sweep approach to true multi-image matching, 1996; census after Zabih and Woodfill, 1994.

use rayon::prelude::*;

use super::{
    evidence::{Evidence, share_of},
    level::{Level, MAX_DIFFERENCE, NUM_DEPTHS, NUM_LABELS, OWN_VEHICLE},
    matching::{Matching, Source},
};
use crate::views::reduced::difference;

/// Pixels that a thread takes at once.
const BLOCK: usize = 512;
/// Costs are counted in quarters of a grey level.
const UNIT: f32 = 4.0;
/// Cost of a hypothesis that no other image shows, grey levels: about that of a right one which another image shows.
const UNSEEN: f32 = 20.0;
/// The same where the pixel may show the own vehicle, which would else be taken for something so near that no other image shows it.
const UNSEEN_BY_VEHICLE: f32 = 45.0;
/// Cost of a step away from a return, and the most that a return costs, grey levels.
const RETURN_STEP: (f32, f32) = (40.0, 60.0);
/// Cost of a step away from the expected ground, and the most that it costs, grey levels.
const GROUND_STEP: (f32, f32) = (1.0, 20.0);
/// Cost of sky that is not infinitely far, grey levels.
const SKY: f32 = 50.0;
/// Cost of a depth behind the ground, grey levels.
const BEHIND_GROUND: f32 = 100.0;
/// Cost of being the own vehicle, without and with returns around the pixel, grey levels.
const OWN_VEHICLE_BIAS: (f32, f32) = (6.0, 21.0);
/// The own vehicle hides the ground up to this distance, metres.
const OWN_VEHICLE_RANGE: f32 = 15.0;
/// Cost of the own vehicle where it cannot be, and of the label that is never chosen.
const NEVER: (i16, i16) = (1500, 2000);
/// Share of the returns whose inverse depth the hypotheses reach, and how far they go beyond it.
const REACHED: (f32, f32) = (0.995, 1.1);
/// Smallest and largest of the nearest hypotheses, 1 / metres.
const NEAREST: (f32, f32) = (0.055, 0.63);

/// Costs of all hypotheses of all pixels.
#[derive(Debug)]
pub(super) struct Volume {
    /// Inverse depth between two labels, 1 / metres.
    pub(super) step: f32,
    /// `[H, W, NUM_LABELS]` quarters of a grey level.
    pub(super) costs: Vec<[i16; NUM_LABELS]>,
}

/// The costs of `level`'s hypotheses against the images of `sources`, the best of these counting.
pub(super) fn volume(level: &Level, sources: &[&Level], evidence: &[Evidence]) -> Volume {
    let step = nearest_inverse(evidence) / (NUM_DEPTHS - 1) as f32;
    let sources: Vec<Source<'_>> = sources.iter().map(|source| Source::new(source, &level.view)).collect();
    let arch = pulp::Arch::new();
    let mut costs = vec![[0; NUM_LABELS]; evidence.len()];
    let blocks = costs.par_chunks_mut(BLOCK).zip(evidence.par_chunks(BLOCK)).enumerate();
    blocks.for_each_init(Vec::new, |seen, (block, (costs, evidence))| {
        let first = block * BLOCK;
        let own: Vec<Option<f32>> =
            (first..).zip(evidence).map(|(pixel, evidence)| own_vehicle(level, pixel, &sources, evidence)).collect();
        let unseen: Vec<f32> = own.iter().map(|own| if own.is_some() { UNSEEN_BY_VEHICLE } else { UNSEEN }).collect();
        seen.clear();
        seen.resize(costs.len(), [f32::INFINITY; NUM_DEPTHS]);
        arch.dispatch(Matching { level, sources: &sources, step, first, unseen: &unseen, costs: seen });
        for ((costs, seen), (evidence, own)) in costs.iter_mut().zip(&*seen).zip(evidence.iter().zip(own)) {
            *costs = with_evidence(seen, evidence, step, own);
        }
    });
    Volume { step, costs }
}

/// The inverse depth of the nearest hypothesis: nearer than nearly all returns and than the ground that none fell on.
fn nearest_inverse(evidence: &[Evidence]) -> f32 {
    let mut returns: Vec<f32> = evidence.iter().filter(|e| e.weight > 0.0).map(|e| e.inverse).collect();
    returns.sort_by(f32::total_cmp);
    let nearest = returns.get(share_of(returns.len(), REACHED.0)).map_or(0.5, |w| w * REACHED.1);
    let ground = evidence.iter().map(|e| e.ground).fold(0.0, f32::max);
    nearest.max(NEAREST.0).max((ground * 1.05).min(NEAREST.1))
}

/// The cost (grey levels) of showing the own vehicle, which looks the same in every image of the camera; `None` where it
/// cannot be: above the near ground, at a return of the view's own sweep, or without another image.
fn own_vehicle(level: &Level, pixel: usize, sources: &[Source<'_>], evidence: &Evidence) -> Option<f32> {
    if evidence.floor <= 1.0 / OWN_VEHICLE_RANGE || evidence.weight >= 1.0 {
        return None;
    }
    let cost = |source: &Source<'_>| {
        let source = source.level;
        let colour = *source.view.colours.get(pixel)?;
        let bits = level.census[pixel] ^ source.census[pixel];
        Some(difference(level.view.colours[pixel], colour).min(MAX_DIFFERENCE) + bits.count_ones() as f32)
    };
    let same = |source: &&Source<'_>| source.level.view.pinhole.width == level.view.pinhole.width;
    let worst = sources.iter().filter(same).filter_map(cost).reduce(f32::max)?;
    Some(worst + if evidence.near_returns { OWN_VEHICLE_BIAS.1 } else { OWN_VEHICLE_BIAS.0 })
}

/// A pixel's costs of all hypotheses, what the images say joined with what else is known.
fn with_evidence(seen: &[f32; NUM_DEPTHS], evidence: &Evidence, step: f32, own: Option<f32>) -> [i16; NUM_LABELS] {
    let mut costs = [NEVER.1; NUM_LABELS];
    let pull = |w: f32, target: f32, (slope, most): (f32, f32)| ((w - target).abs() / step * slope).min(most);
    for (label, (cost, &seen)) in costs.iter_mut().zip(seen).enumerate() {
        let w = label as f32 * step;
        let mut total = seen.min(UNSEEN + MAX_DIFFERENCE);
        if evidence.weight > 0.0 {
            total += evidence.weight * (pull(w, evidence.inverse, RETURN_STEP) - total);
        }
        if w < evidence.floor - step {
            total += BEHIND_GROUND;
        }
        if evidence.ground > 0.0 {
            total += pull(w, evidence.ground, GROUND_STEP);
        }
        if label > 0 {
            total += SKY * evidence.sky;
        }
        *cost = to_cost(total);
    }
    costs[OWN_VEHICLE] = own.map_or(NEVER.0, to_cost);
    costs
}

#[expect(clippy::cast_possible_truncation, reason = "the sum of the limits above is far below 32767 quarters")]
fn to_cost(grey_levels: f32) -> i16 {
    (grey_levels * UNIT) as i16
}
