//! How cameras have to be turned and moved for the returns that two of them show to look alike.
//!
//! Direct alignment: no features are matched, the images themselves are the measurement. What is compared is the logarithm of brightness
//! between two scales, which knows neither exposure nor vignetting, and little of tone.

use glam::{DQuat, DVec3};
use rayon::prelude::*;

use super::correlation;
use crate::{cholesky::cholesky, views::View};

/// What one camera is turned about its own axes (radians, first) and moved along them (metres).
pub(super) type Change = [f64; 6];

/// Which returns of two that are beside one another a step looks at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fold {
    Even,
    Odd,
    All,
}

/// A return that images of two cameras show.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pair {
    /// Index of the return in the cloud.
    pub(super) point: usize,
    /// Indices of the views.
    pub(super) views: [usize; 2],
    /// Of their cameras.
    pub(super) cameras: [usize; 2],
    /// Where the return is in the axes of each at the moment at which it is exposed, metres.
    pub(super) places: [[f32; 3]; 2],
}

/// How far cameras are thought to be from where they are stated, standard deviations: radians, metres.
pub(super) const BELIEF: [f64; 2] = [0.01, 0.03];
/// Pairs beside one another share their errors: so many say as much as one.
const ALIKE: f64 = 30.0;
/// Returns of one run of a scan are in one fold.
const RUN: usize = 64;
/// Scales of the logarithm of brightness that are told apart, pixels.
const FINE: f32 = 1.0;
const COARSE: f32 = 5.0;
/// Darkness that logarithms of brightness end at.
const DARKEST: f32 = 4.0 / 255.0;
/// Least error of that logarithm.
const LEAST_ERROR: f64 = 1e-4;
/// Pairs that one task takes.
const BLOCK: usize = 4096;

impl Fold {
    const fn holds(self, point: usize) -> bool {
        match self {
            Self::Even => (point / RUN).is_multiple_of(2),
            Self::Odd => !(point / RUN).is_multiple_of(2),
            Self::All => true,
        }
    }
}

/// What is compared of one view.
pub(super) struct Detail {
    width: usize,
    height: usize,
    focal: [f64; 2],
    centre: [f64; 2],
    /// `[H, W]`.
    values: Vec<f32>,
}

impl Detail {
    /// That of a view made smaller by a factor.
    pub(super) fn new(view: &View, factor: usize) -> Self {
        let view = view.reduced(factor);
        let camera = &view.pinhole;
        let log = |pixel: &[f32]| (pixel.iter().sum::<f32>() / 3.0 + DARKEST).ln();
        let logs: Vec<f32> = view.image.data.chunks_exact(3).map(log).collect();
        let [fine, coarse] = [FINE, COARSE].map(|sigma| blurred(&logs, camera.width, sigma));
        Self {
            width: camera.width,
            height: camera.height,
            focal: [camera.fx, camera.fy].map(f64::from),
            centre: [camera.cx, camera.cy].map(f64::from),
            values: fine.iter().zip(coarse).map(|(fine, coarse)| fine - coarse).collect(),
        }
    }

    /// What a camera that was changed shows of a place in its stated axes, and the derivatives by the change.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside the image")]
    fn at(&self, place: [f32; 3], change: &Change) -> Option<(f64, Change)> {
        let [turn, shift] = [0, 3].map(|k| DVec3::new(change[k], change[k + 1], change[k + 2]));
        let p = DQuat::from_scaled_axis(-turn) * (DVec3::from(place.map(f64::from)) - shift);
        let (x, y) = (p.x / p.z, p.y / p.z);
        let [u, v] = [self.focal[0] * x + self.centre[0] - 0.5, self.focal[1] * y + self.centre[1] - 0.5];
        let inside = u >= 1.0 && v >= 1.0 && u < self.width as f64 - 2.0 && v < self.height as f64 - 2.0;
        if p.z <= 0.0 || !inside {
            return None;
        }
        let corner = v as usize * self.width + u as usize;
        let (a, b) = (u.fract(), v.fract());
        let value = |corner: usize| {
            let tap = |offset: usize| f64::from(self.values[corner + offset]);
            let [above, below] = [0, self.width].map(|row| (1.0 - a) * tap(row) + a * tap(row + 1));
            (1.0 - b) * above + b * below
        };
        let slope = [
            0.5 * self.focal[0] * (value(corner + 1) - value(corner - 1)),
            0.5 * self.focal[1] * (value(corner + self.width) - value(corner - self.width)),
        ];
        // Of the place in the changed axes, over its depth: a turn w takes it to p - w x p, a shift s to p - s.
        let near = 1.0 / p.z;
        let moves =
            [[0.0, 1.0, -y], [-1.0, 0.0, x], [y, -x, 0.0], [-near, 0.0, 0.0], [0.0, -near, 0.0], [0.0, 0.0, -near]];
        Some((value(corner), moves.map(|[dx, dy, dz]| slope[0] * (dx - x * dz) + slope[1] * (dy - y * dz))))
    }
}

/// A plane `[H, W]`, blurred with a Gaussian; its rim is repeated beyond it.
fn blurred(plane: &[f32], width: usize, sigma: f32) -> Vec<f32> {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few pixels")]
    let reach = (3.0 * sigma).ceil() as usize;
    let weight = |k: usize| (-0.5 * (k.abs_diff(reach) as f32 / sigma).powi(2)).exp();
    let total: f32 = (0..=2 * reach).map(weight).sum();
    let kernel: Vec<f32> = (0..=2 * reach).map(|k| weight(k) / total).collect();
    let height = plane.len() / width;
    let mut across = vec![0.0; plane.len()];
    for (out, row) in across.chunks_exact_mut(width).zip(plane.chunks_exact(width)) {
        for (x, value) in out.iter_mut().enumerate() {
            let at = |k: usize| row[(x + k).saturating_sub(reach).min(width - 1)];
            *value = kernel.iter().enumerate().map(|(k, weight)| weight * at(k)).sum();
        }
    }
    let mut result = vec![0.0; plane.len()];
    for (y, out) in result.chunks_exact_mut(width).enumerate() {
        for (k, weight) in kernel.iter().enumerate() {
            let row = (y + k).saturating_sub(reach).min(height - 1);
            out.iter_mut().zip(&across[row * width..]).for_each(|(value, from)| *value += weight * from);
        }
    }
    result
}

/// Changes of the cameras, `rounds` steps of Gauss and Newton nearer to where pairs look alike; only those of `free` cameras change.
pub(super) fn align(
    pairs: &[Pair],
    details: &[Detail],
    start: &[Change],
    free: &[bool],
    fold: Fold,
    rounds: usize,
) -> Vec<Change> {
    let pairs: Vec<&Pair> = pairs.iter().filter(|pair| fold.holds(pair.point)).collect();
    let mut changes = start.to_vec();
    for _ in 0..rounds {
        step(&pairs, details, &mut changes, free);
    }
    changes
}

/// One term of the sum of squares: what two cameras differ by, and the derivatives by the change of either.
type Term = (f64, [usize; 2], [Change; 2]);

fn step(pairs: &[&Pair], details: &[Detail], changes: &mut [Change], free: &[bool]) {
    let n = 6 * changes.len();
    let term = |pair: &&Pair| -> Option<Term> {
        let seen = |k: usize| details[pair.views[k]].at(pair.places[k], &changes[pair.cameras[k]]);
        let ((first, by_first), (second, by_second)) = (seen(0)?, seen(1)?);
        Some((first - second, pair.cameras, [by_first, by_second.map(|d| -d)]))
    };
    let terms: Vec<Term> = pairs.par_iter().filter_map(term).collect();
    let mut errors: Vec<f64> = terms.iter().map(|(error, ..)| error.abs()).collect();
    errors.sort_unstable_by(f64::total_cmp);
    let scale = (1.5 * errors.get(errors.len() / 2).copied().unwrap_or(0.0)).max(LEAST_ERROR);
    let add = |block: &[Term]| {
        let (mut system, mut right) = (vec![0.0; n * n], vec![0.0; n]);
        for (error, cameras, derivatives) in block {
            let weight = (1.0 + (error / scale).powi(2)).powi(-2);
            for (&a, by_a) in cameras.iter().zip(derivatives) {
                for (i, x) in by_a.iter().enumerate() {
                    right[6 * a + i] -= weight * x * error;
                    for (&b, by_b) in cameras.iter().zip(derivatives) {
                        let row = (6 * a + i) * n + 6 * b;
                        system[row..row + 6].iter_mut().zip(by_b).for_each(|(sum, y)| *sum += weight * x * y);
                    }
                }
            }
        }
        (system, right)
    };
    let blocks: Vec<(Vec<f64>, Vec<f64>)> = terms.par_chunks(BLOCK).map(add).collect();
    let (mut system, mut right) = (vec![0.0; n * n], vec![0.0; n]);
    for (part, rest) in &blocks {
        system.iter_mut().zip(part).for_each(|(sum, x)| *sum += x);
        right.iter_mut().zip(rest).for_each(|(sum, x)| *sum += x);
    }
    for i in 0..n {
        let weight = ALIKE * (scale / BELIEF[i % 6 / 3]).powi(2);
        system[i * n + i] += weight;
        right[i] -= weight * changes[i / 6][i % 6];
        if !free[i / 6] {
            (0..n).for_each(|j| (system[i * n + j], system[j * n + i]) = (0.0, 0.0));
            (system[i * n + i], right[i]) = (1.0, 0.0);
        }
    }
    cholesky(&mut system, &mut right);
    changes.iter_mut().flatten().zip(right).for_each(|(value, change)| *value += change);
}

/// Share of the variance of the pairs that `chosen` picks in a fold which one image leaves unexplained of the other, and their number.
pub(super) fn unexplained(
    pairs: &[Pair],
    details: &[Detail],
    changes: &[Change],
    fold: Fold,
    chosen: &(dyn Fn(&Pair) -> bool + Sync),
) -> (f64, usize) {
    let seen = |pair: &Pair| {
        let value = |k: usize| Some(details[pair.views[k]].at(pair.places[k], &changes[pair.cameras[k]])?.0);
        Some([value(0)?, value(1)?])
    };
    let found: Vec<[f64; 2]> =
        pairs.par_iter().filter(|pair| fold.holds(pair.point) && chosen(pair)).filter_map(seen).collect();
    (1.0 - correlation(found.iter().copied()).powi(2), found.len())
}
