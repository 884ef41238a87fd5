//! One label per pixel: cheap ones, and the same as the neighbours' unless there is an edge.
//!
//! # Source
//! Hirschmueller, Stereo processing by semiglobal matching and mutual information, 2008.

use super::{
    level::{NUM_DEPTHS, NUM_LABELS, OWN_VEHICLE},
    volume::Volume,
};
use crate::{parallel, views::reduced::Reduced};

/// Cost of a neighbour's depth one label away.
const SMALL_STEP: i16 = 20;
/// Cost of any other label of a neighbour of the same colour.
const LARGE_STEP: f32 = 1000.0;
/// Difference of colour (grey levels) at which that cost is halved.
const EDGE: f32 = 15.0;
/// Labels with one more at either end that is never cheap.
const PADDED: usize = NUM_LABELS + 2;
/// More than any path costs, and far enough from overflow.
const HIGH: i16 = 16_000;
/// Pixels that a thread chooses for at once.
const GRAIN: usize = 512;

/// What was decided about a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Choice {
    /// Inverse depth, 1 / metres; also where the own vehicle was chosen, then of the best other hypothesis.
    pub(super) inverse: f32,
    /// Whether the own vehicle was chosen.
    pub(super) own_vehicle: bool,
}

/// The choice for every pixel. `[H, W]`
///
/// # Formula
/// The label of least `sum over 8 directions r of L_r(p, l)`, with
/// `L_r(p, l) = C(p, l) + min(L_r(q, l), L_r(q, l +- 1) + P1, min_k L_r(q, k) + P2) - min_k L_r(q, k)`, `q = p - r`; then the minimum
/// of the parabola through it and its neighbours.
pub(super) fn smooth(volume: &Volume, view: &Reduced) -> Vec<Choice> {
    let (forward, backward) = rayon::join(|| sweep(volume, view, true), || sweep(volume, view, false));
    let total = |pixel: usize| -> [i16; NUM_LABELS] { std::array::from_fn(|l| forward[pixel][l] + backward[pixel][l]) };
    parallel::map(volume.costs.len(), GRAIN, &|pixel| choose(&total(pixel), volume.step))
}

fn choose(total: &[i16; NUM_LABELS], step: f32) -> Choice {
    let depths = &total[..NUM_DEPTHS];
    let best = depths.iter().enumerate().min_by_key(|&(label, &cost)| (cost, label)).map_or(0, |(label, _)| label);
    let mut place = best as f32;
    if best > 0 && best + 1 < NUM_DEPTHS {
        let [before, here, after] = [best - 1, best, best + 1].map(|label| f32::from(depths[label]));
        let curvature = before - 2.0 * here + after;
        if curvature > 0.0 {
            place += (0.5 * (before - after) / curvature).clamp(-0.5, 0.5);
        }
    }
    Choice { inverse: place * step, own_vehicle: total[OWN_VEHICLE] < depths[best] }
}

/// Path costs of the last row of pixels in one direction.
struct PathCosts {
    /// `[W]` costs between two entries of [`HIGH`].
    costs: Vec<[i16; PADDED]>,
    /// `[W]` the least of them.
    least: Vec<i16>,
}

/// The sum of the path costs of the four directions that run with the reading order, or against it.
fn sweep(volume: &Volume, view: &Reduced, forward: bool) -> Vec<[i16; NUM_LABELS]> {
    let (width, num_pixels) = (view.pinhole.width, volume.costs.len());
    let mut total = vec![[0; NUM_LABELS]; num_pixels];
    let new_row = || PathCosts { costs: vec![[HIGH; PADDED]; width], least: vec![0; width] };
    let mut rows: [[PathCosts; 2]; 4] = std::array::from_fn(|_| [new_row(), new_row()]);
    for place in 0..num_pixels {
        let pixel = if forward { place } else { num_pixels - 1 - place };
        let (line, column) = (place / width, place % width); // in walking order
        // The neighbour behind, and the three of the line behind: where they stand in walking order.
        let behind = [
            (column > 0).then(|| (1, column - 1)),
            (line > 0 && column > 0).then(|| (width + 1, column - 1)),
            (line > 0).then_some((width, column)),
            (line > 0 && column + 1 < width).then(|| (width - 1, column + 1)),
        ];
        for (direction, (row, from)) in rows.iter_mut().zip(behind).enumerate() {
            let [even, odd] = row;
            let (now, last) = if line % 2 == 0 { (even, odd) } else { (odd, even) };
            let mut out = [HIGH; PADDED];
            let least = match from {
                None => start(&volume.costs[pixel], &mut out),
                Some((distance, at)) => {
                    let other = if forward { pixel - distance } else { pixel + distance };
                    let source = if direction == 0 { &*now } else { &*last };
                    let jump = large_step(view.difference(pixel, other));
                    extend(&volume.costs[pixel], &source.costs[at], source.least[at], jump, &mut out)
                }
            };
            for (sum, cost) in total[pixel].iter_mut().zip(&out[1..]) {
                *sum += cost;
            }
            now.costs[column] = out;
            now.least[column] = least;
        }
    }
    total
}

#[expect(clippy::cast_possible_truncation, reason = "at most LARGE_STEP")]
fn large_step(difference: f32) -> i16 {
    ((LARGE_STEP / (1.0 + difference / EDGE)) as i16).max(SMALL_STEP + 4)
}

fn start(costs: &[i16; NUM_LABELS], out: &mut [i16; PADDED]) -> i16 {
    out[1..=NUM_LABELS].copy_from_slice(costs);
    costs.iter().copied().fold(HIGH, i16::min)
}

/// The least path cost; writes the costs of the paths that come from a neighbour with the costs `before`, `least` of
/// them, and `jump`, the cost of a large step there.
fn extend(costs: &[i16; NUM_LABELS], before: &[i16; PADDED], least: i16, jump: i16, out: &mut [i16; PADDED]) -> i16 {
    let mut lowest = HIGH;
    for label in 0..NUM_LABELS {
        let beside = before[label].min(before[label + 2]) + SMALL_STEP;
        let reached = before[label + 1].min(beside).min(least + jump);
        let cost = costs[label] + reached - least;
        out[label + 1] = cost;
        lowest = lowest.min(cost);
    }
    lowest
}
