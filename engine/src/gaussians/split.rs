//! A Gaussian as two: which halves together look like it.
//!
//! # Formula
//! Along the axis that is split the halves stand `0.3` standard deviations to either side. Their size along and across it, and their opacity,
//! are those with the least squared difference between `1 - (1 - a)(1 - b)` of the halves and the alpha of the whole, over the plane:
//! `FITS`, linear between its rows. Left over are 36 dB for an opaque Gaussian and more for others.

use glam::{DQuat, DVec3};
use lgs_formats::casts::to_f32;

use super::physical::{Splat, splat_of};
use super::{GaussianSet, LOG_SCALE, LOGIT_OPACITY, MEAN, NUM_ATTRIBUTES};

/// Distance of a half from the whole's centre, standard deviations.
const OFFSET: f64 = 0.3;
/// Size along the axis, size across it and opacity of the halves of a Gaussian of size 1 whose opacity is the row's place in tenths.
const FITS: [[f64; 3]; 11] = [
    [0.9515, 0.9999, 0.0000],
    [0.9450, 0.9945, 0.0537],
    [0.9380, 0.9886, 0.1102],
    [0.9305, 0.9823, 0.1696],
    [0.9224, 0.9755, 0.2327],
    [0.9137, 0.9682, 0.2999],
    [0.9042, 0.9603, 0.3720],
    [0.8939, 0.9517, 0.4501],
    [0.8826, 0.9423, 0.5354],
    [0.8703, 0.9321, 0.6295],
    [0.8571, 0.9213, 0.7338],
];

/// How a Gaussian of an opacity is halved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Halving {
    /// Distance of a half from the whole's centre, standard deviations of the whole.
    pub offset: f64,
    /// Size along the axis, of the whole's.
    pub along: f64,
    /// Size across it, of the whole's.
    pub across: f64,
    /// Opacity.
    pub opacity: f64,
}

impl Halving {
    /// That of an opacity in 0..=1.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 to 9")]
    pub fn of(opacity: f64) -> Self {
        let place = 10.0 * opacity.clamp(0.0, 1.0);
        let row = (place as usize).min(FITS.len() - 2);
        let part = place - row as f64;
        let [along, across, opacity] = std::array::from_fn(|k| FITS[row][k] + part * (FITS[row + 1][k] - FITS[row][k]));
        Self { offset: OFFSET, along, across, opacity }
    }
}

/// The halves of Gaussian `i` along its axis `axis` (0 to 2), raw attributes: the first to the side to which the axis points.
///
/// # Panics
/// When there is no such Gaussian or axis.
pub fn halves(set: &GaussianSet, i: usize, axis: usize) -> [[f32; NUM_ATTRIBUTES]; 2] {
    let row = set.attributes[i];
    let splat = splat_of(set, i);
    let halving = Halving::of(f64::from(splat.opacity));
    let mut half = row;
    for k in 0..3 {
        let factor = if k == axis { halving.along } else { halving.across };
        half[LOG_SCALE.start + k] = to_f32((f64::from(splat.scale[k]) * factor).ln());
    }
    // What has no opacity at all stays finite.
    half[LOGIT_OPACITY] = to_f32((halving.opacity.max(f64::MIN_POSITIVE) / (1.0 - halving.opacity)).ln());
    let step = halving.offset * f64::from(splat.scale[axis]) * axis_of(&splat, axis);
    [1.0, -1.0].map(|side| {
        let mut moved = half;
        for k in 0..3 {
            moved[MEAN.start + k] = to_f32(f64::from(row[MEAN.start + k]) + side * step[k]);
        }
        moved
    })
}

/// The unit vector of an axis of a Gaussian, clip frame.
pub(crate) fn axis_of(splat: &Splat, axis: usize) -> DVec3 {
    let [w, x, y, z] = splat.quat.map(f64::from);
    let quat = DQuat::from_xyzw(x, y, z, w);
    if quat.length() > 0.0 { quat.normalize() * DVec3::AXES[axis] } else { DVec3::AXES[axis] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_of_what_is_not_seen_are_finite() {
        for opacity in [-200.0, 200.0] {
            let mut row = [0.1; NUM_ATTRIBUTES];
            row[LOGIT_OPACITY] = opacity;
            let set = GaussianSet {
                attributes: vec![row],
                times: vec![0.0],
                frames: vec![0],
                velocities: vec![[0.0; 3]],
                num_lidar: 1,
            };
            assert!(halves(&set, 0, 1).iter().flatten().all(|value| value.is_finite()), "{opacity}");
        }
    }

    /// The fit is the best there is: other sizes and opacities leave more.
    #[test]
    fn halves_look_like_the_whole() {
        let left = |opacity: f64, halving: &Halving| {
            let half = |x: f64, y: f64| {
                let along = x / halving.along;
                halving.opacity * (-0.5 * (along * along + (y / halving.across).powi(2))).exp()
            };
            let grid = || (-40..=40).map(|k| f64::from(k) / 10.0);
            let pixels = grid().flat_map(|x| grid().map(move |y| (x, y)));
            let squares = pixels.map(|(x, y)| {
                let whole = opacity * (-0.5 * (x * x + y * y)).exp();
                let both = 1.0 - (1.0 - half(x - halving.offset, y)) * (1.0 - half(x + halving.offset, y));
                (both - whole).powi(2)
            });
            squares.sum::<f64>().sqrt()
        };
        for opacity in [0.07, 0.35, 0.5, 0.88, 0.99] {
            let halving = Halving::of(opacity);
            let best = left(opacity, &halving);
            let whole = 10.0 * std::f64::consts::PI.sqrt() * opacity;
            assert!(best / whole < 0.06 * opacity + 0.005, "{opacity}: {}", best / whole);
            for change in [0.9, 1.1] {
                for other in [
                    Halving { along: change * halving.along, ..halving },
                    Halving { across: change * halving.across, ..halving },
                    Halving { opacity: change * halving.opacity, ..halving },
                ] {
                    assert!(left(opacity, &other) > best, "{opacity}: {other:?} is better than {halving:?}");
                }
            }
        }
    }
}
