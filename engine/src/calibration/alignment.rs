//! How cameras have to be turned, moved and timed for the returns that two images show to look alike.
//!
//! Direct alignment: no features are matched, the images themselves are the measurement. What is compared is the logarithm of brightness
//! between two scales, which knows neither exposure nor vignetting, and little of tone.

use glam::{DQuat, DVec3};

use crate::{cholesky::cholesky, parallel, views::View};

/// Numbers of a change.
pub(super) const NUM: usize = 9;
/// What one camera is turned about its own axes (radians, three numbers) and moved along them (metres, three), and when its images are exposed
/// (seconds after the stated moment): the middle, how much later the right edge is than the left one, and the lower one than the upper one.
pub(super) type Change = [f64; NUM];
/// Which numbers of a change are looked for.
pub(super) type Free = [bool; NUM];

/// Turn and shift.
pub(super) const MOUNT: Free = [true, true, true, true, true, true, false, false, false];
/// None.
pub(super) const FIXED: Free = [false; NUM];

/// Which returns of two that are beside one another a step looks at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fold {
    Even,
    Odd,
    All,
}

/// A return that two images show.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pair {
    /// Index of the return in the cloud.
    pub(super) point: usize,
    /// How either shows it.
    pub(super) seen: [Seen; 2],
}

/// How an image shows a return.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    /// Index of the view.
    pub(super) view: usize,
    /// Of its camera.
    pub(super) camera: usize,
    /// Where the return is in the camera's axes at the moment at which it is exposed, metres.
    pub(super) place: [f32; 3],
    /// How it moves there because the camera does, metres a second.
    pub(super) rate: [f32; 3],
}

/// How far cameras are thought to be from where they are stated, standard deviations: radians, metres, seconds of the middle and of a readout.
pub(super) const BELIEF: [f64; NUM] = [0.01, 0.01, 0.01, 0.03, 0.03, 0.03, 0.04, 0.15, 0.15];
/// Places of an image at which its moments are followed: this far from its middle, shares of its size.
const FOLLOWED: f64 = 0.7;
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

    /// What a camera that was changed shows of a return, and the derivatives by the change.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside the image")]
    fn at(&self, seen: &Seen, change: &Change) -> Option<(f64, Change)> {
        let [turn, shift] = [0, 3].map(|k| DVec3::new(change[k], change[k + 1], change[k + 2]));
        let [place, rate] = [seen.place, seen.rate].map(|vector| DVec3::from(vector.map(f64::from)));
        let share = |k: usize, size: usize| {
            let at = (self.focal[k] * place[k] / place.z + self.centre[k]) / size as f64;
            (at - 0.5).clamp(-FOLLOWED, FOLLOWED)
        };
        let (across, down) = (share(0, self.width), share(1, self.height));
        let later = change[6] + across * change[7] + down * change[8];
        let p = DQuat::from_scaled_axis(-turn) * (place + later * rate - shift);
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
        let by = |[dx, dy, dz]: [f64; 3]| slope[0] * (dx - x * dz) + slope[1] * (dy - y * dz);
        let [a, b, c, d, e, f] = moves.map(by);
        let by_time = by((near * rate).to_array());
        Some((value(corner), [a, b, c, d, e, f, by_time, across * by_time, down * by_time]))
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

/// Changes of the cameras, `rounds` steps of Gauss and Newton nearer to where pairs look alike; only the numbers that are free change.
pub(super) fn align(
    pairs: &[Pair],
    details: &[Detail],
    start: &[Change],
    free: &[Free],
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

/// One term of the sum of squares: what two images differ by, and the derivatives by the change of either camera.
type Term = (f64, [usize; 2], [Change; 2]);

fn step(pairs: &[&Pair], details: &[Detail], changes: &mut [Change], free: &[Free]) {
    // Camera and number of each unknown, and the unknowns of each camera.
    let unknowns: Vec<[usize; 2]> =
        (0..free.len()).flat_map(|c| (0..NUM).map(move |k| [c, k])).filter(|&[c, k]| free[c][k]).collect();
    let n = unknowns.len();
    let columns: Vec<Vec<[usize; 2]>> = (0..free.len())
        .map(|camera| (0..n).filter(|&i| unknowns[i][0] == camera).map(|i| [i, unknowns[i][1]]).collect())
        .collect();
    let term = |i: usize| -> Option<Term> {
        let pair = pairs[i];
        let seen = |k: usize| details[pair.seen[k].view].at(&pair.seen[k], &changes[pair.seen[k].camera]);
        let ((first, by_first), (second, by_second)) = (seen(0)?, seen(1)?);
        let [a, b] = pair.seen.map(|seen| seen.camera);
        let by_second = by_second.map(|d| -d);
        // Of two images of one camera the first one's place is for both.
        let by_first = if a == b { std::array::from_fn(|k| by_first[k] + by_second[k]) } else { by_first };
        Some((first - second, [a, b], [by_first, by_second]))
    };
    let terms: Vec<Term> = parallel::filter_map(pairs.len(), 1, &term);
    let mut errors: Vec<f64> = terms.iter().map(|(error, ..)| error.abs()).collect();
    errors.sort_unstable_by(f64::total_cmp);
    let scale = (1.5 * errors.get(errors.len() / 2).copied().unwrap_or(0.0)).max(LEAST_ERROR);
    let add = |block: usize| {
        let (mut system, mut right) = (vec![0.0; n * n], vec![0.0; n]);
        for (error, cameras, derivatives) in terms[block * BLOCK..].iter().take(BLOCK) {
            let weight = (1.0 + (error / scale).powi(2)).powi(-2);
            let num_cameras = if cameras[0] == cameras[1] { 1 } else { 2 };
            let (cameras, derivatives) = (&cameras[..num_cameras], &derivatives[..num_cameras]);
            for (&a, by_a) in cameras.iter().zip(derivatives) {
                for &[i, k] in &columns[a] {
                    let x = by_a[k];
                    right[i] -= weight * x * error;
                    for (&b, by_b) in cameras.iter().zip(derivatives) {
                        columns[b].iter().for_each(|&[j, l]| system[i * n + j] += weight * x * by_b[l]);
                    }
                }
            }
        }
        (system, right)
    };
    let blocks: Vec<(Vec<f64>, Vec<f64>)> = parallel::map(terms.len().div_ceil(BLOCK), 1, &add);
    let (mut system, mut right) = (vec![0.0; n * n], vec![0.0; n]);
    for (part, rest) in &blocks {
        system.iter_mut().zip(part).for_each(|(sum, x)| *sum += x);
        right.iter_mut().zip(rest).for_each(|(sum, x)| *sum += x);
    }
    for (i, &[camera, k]) in unknowns.iter().enumerate() {
        let weight = ALIKE * (scale / BELIEF[k]).powi(2);
        system[i * n + i] += weight;
        right[i] -= weight * changes[camera][k];
    }
    cholesky(&mut system, &mut right);
    for (&[camera, k], change) in unknowns.iter().zip(right) {
        changes[camera][k] += change;
    }
}

/// What the two images of each pair in a fold show, where both show it.
pub(super) fn shown(pairs: &[Pair], details: &[Detail], changes: &[Change], fold: Fold) -> Vec<[f64; 2]> {
    let values = |i: usize| -> Option<[f64; 2]> {
        let pair = pairs.get(i).filter(|pair| fold.holds(pair.point))?;
        let value = |k: usize| Some(details[pair.seen[k].view].at(&pair.seen[k], &changes[pair.seen[k].camera])?.0);
        Some([value(0)?, value(1)?])
    };
    parallel::filter_map(pairs.len(), 1, &values)
}
