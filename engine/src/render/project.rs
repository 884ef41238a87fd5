//! Projection of one Gaussian to the image: what the compositing passes need of it.
//!
//! Done in f64 (a few hundred operations a Gaussian, small beside compositing), so that huge, tiny, thin and far Gaussians keep
//! their shape; the result is stored in f32.

use glam::{DMat2, DMat3, DVec2, DVec3};

use super::constants::{ALPHA_MIN, BLUR_PX2, JACOBIAN_MARGIN, LOG2_ALPHA_MIN, NEAR_PLANE};
use crate::gaussians::physical::Splat;
use crate::views::{PinholeView, Shutter, shutter::Lens};

/// A camera in f64 with the limits of its Jacobian.
#[derive(Clone, Copy, Debug)]
pub(super) struct Projector {
    pub(super) rotation: DMat3,
    pub(super) translation: DVec3,
    pub(super) focal: DVec2,
    pub(super) centre: DVec2,
    shutter: Option<Shutter>,
    /// Smallest and largest `x / z` and `y / z` at which the Jacobian is taken.
    pub(super) limits_min: DVec2,
    pub(super) limits_max: DVec2,
    time: f64,
    size: [usize; 2],
    /// What is added to the variances of a footprint, px^2.
    pub(super) blur: f64,
}

/// A Gaussian in the camera at the moment at which it is exposed.
#[derive(Clone, Copy, Debug)]
struct Sight {
    /// Mean in the camera frame, metres.
    mean: DVec3,
    /// `camera_from_clip`.
    rotation: DMat3,
    /// Seconds that the Gaussian has moved for.
    elapsed: f64,
    /// How a rolling shutter draws places of the image apart.
    bend: Option<DMat2>,
}

/// What one Gaussian is in the camera, in f64: the common part of the forward and the backward pass.
#[derive(Clone, Copy, Debug)]
pub(super) struct Projected {
    /// `camera_from_clip`, seconds that it has moved for and what a rolling shutter does, all at the moment at which it is exposed: constants.
    pub(super) rotation: DMat3,
    pub(super) elapsed: f64,
    pub(super) bend: Option<DMat2>,
    /// Mean in the camera frame, metres.
    pub(super) camera_mean: DVec3,
    /// Mean with x and y clamped for the Jacobian, and whether they were.
    pub(super) jacobian_mean: DVec3,
    pub(super) clamped: [bool; 2],
    /// Normalised quaternion (w, x, y, z) and the norm that it was divided by (0: no direction, identity used).
    pub(super) quat: [f64; 4],
    pub(super) quat_norm: f64,
    /// Rotation of the Gaussian.
    pub(super) axes: DMat3,
    /// Rows of `J W` `[2, 3]`, bent where a shutter rolls.
    pub(super) image_from_world: [DVec3; 2],
    /// Projected covariance with blur: xx, xy, yy, px^2.
    pub(super) covariance: [f64; 3],
    /// Its determinant, px^4.
    pub(super) determinant: f64,
}

/// One visible Gaussian as the compositing passes read it.
///
/// # Formula
/// With `u = x - mean_x - shear dy` and `dy = y - mean_y`: `alpha = 2^(log2_opacity + curve_u u^2 + curve_y dy^2)`: the
/// exponent with its square completed along the row, so that no two large terms cancel.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Footprint {
    pub(super) mean_x: f32,
    pub(super) mean_y: f32,
    /// `cov_xy / cov_yy`.
    pub(super) shear: f32,
    /// `-log2(e) / 2 * conic_xx`.
    pub(super) curve_u: f32,
    /// `-log2(e) / 2 / cov_yy`.
    pub(super) curve_y: f32,
    /// `-1 / curve_u`, px^2.
    pub(super) width2: f32,
    pub(super) log2_opacity: f32,
    pub(super) colour: [f32; 3],
    /// Depth along the camera's z axis, metres.
    pub(super) depth: f32,
    /// Half height of the region where alpha can reach its minimum, pixels.
    pub(super) extent_y: f32,
    /// Half width of it, pixels.
    pub(super) extent_x: f32,
    /// `cov_xy / cov_xx * extent_x`: the height at which it is widest to the right.
    pub(super) widest_y: f32,
    /// Index of the Gaussian.
    pub(super) index: u32,
}

impl Projector {
    pub(super) fn new(view: &PinholeView) -> Self {
        let row = |i: usize| view.camera_from_clip[i].map(f64::from);
        let rows = [row(0), row(1), row(2)];
        let focal = DVec2::new(f64::from(view.fx), f64::from(view.fy));
        let centre = DVec2::new(f64::from(view.cx), f64::from(view.cy));
        let size = DVec2::new(view.width as f64, view.height as f64);
        let margin = JACOBIAN_MARGIN * 0.5 * size / focal;
        Self {
            rotation: DMat3::from_cols_array_2d(&[0, 1, 2].map(|c| rows.map(|r| r[c]))),
            translation: DVec3::from_array(rows.map(|r| r[3])),
            focal,
            centre,
            shutter: view.shutter,
            limits_min: -(centre / focal + margin),
            limits_max: (size - centre) / focal + margin,
            time: f64::from(view.time),
            size: [view.width, view.height],
            blur: BLUR_PX2 * f64::from(view.pixel_side).powi(2),
        }
    }

    /// The Gaussian in the camera; at the moment at which it is exposed, where the shutter rolls and it is ahead.
    #[inline(always)]
    fn sight(&self, splat: &Splat) -> Sight {
        let elapsed = self.time - f64::from(splat.time);
        let velocity = vector(splat.velocity);
        let mean = vector(splat.mean) + velocity * elapsed;
        let still =
            Sight { mean: self.rotation * mean + self.translation, rotation: self.rotation, elapsed, bend: None };
        match &self.shutter {
            Some(shutter) if still.mean.z >= NEAR_PLANE => {
                let lens = Lens { focal: self.focal, centre: self.centre };
                let moves = self.rotation * velocity;
                let taken = shutter.taken(&lens, still.mean, 1.0, moves);
                let (turn, shift) = shutter.carried(taken.seconds);
                Sight {
                    mean: turn * (still.mean + shift + moves * taken.seconds),
                    rotation: turn * self.rotation,
                    elapsed: elapsed + taken.seconds,
                    bend: Some(taken.bend),
                }
            }
            _ => still,
        }
    }

    /// The Gaussian in the camera; `None` behind the near plane or where a parameter is not finite.
    #[inline(always)]
    pub(super) fn project(&self, splat: &Splat) -> Option<Projected> {
        self.project_seen(splat, &self.sight(splat))
    }

    #[inline(always)]
    fn project_seen(&self, splat: &Splat, &Sight { mean: t, rotation, elapsed, bend }: &Sight) -> Option<Projected> {
        if !t.is_finite() || t.z < NEAR_PLANE {
            return None;
        }
        let slope = DVec2::new(t.x, t.y) / t.z;
        let kept = slope.clamp(self.limits_min, self.limits_max);
        let j = DVec3::new(kept.x * t.z, kept.y * t.z, t.z);
        let (quat, quat_norm) = normalise(splat.quat.map(f64::from));
        let axes = rotation_of(quat);
        let (fx, fy) = (self.focal.x / t.z, self.focal.y / t.z);
        let w = rotation.transpose();
        let rows = [fx * w.x_axis - fx * kept.x * w.z_axis, fy * w.y_axis - fy * kept.y * w.z_axis];
        let image_from_world = bend.map_or(rows, |bend| bent(bend, rows));
        let scale = vector(splat.scale);
        let m = image_from_world.map(|row| (axes.transpose() * row) * scale);
        let (xx, yy) = (m[0].length_squared() + self.blur, m[1].length_squared() + self.blur);
        // |m0|^2 |m1|^2 - (m0 m1)^2 by Lagrange's identity: no cancellation for thin Gaussians.
        let determinant = m[0].cross(m[1]).length_squared() + self.blur * (xx + yy - self.blur);
        Some(Projected {
            rotation,
            elapsed,
            bend,
            camera_mean: t,
            jacobian_mean: j,
            clamped: [kept.x != slope.x, kept.y != slope.y],
            quat,
            quat_norm,
            axes,
            image_from_world,
            covariance: [xx, m[0].dot(m[1]), yy],
            determinant,
        })
    }

    /// Whether the Gaussian misses the image by more than its largest axis could reach if it lay across the line of sight; `false` where
    /// a parameter is not a number.
    ///
    /// # Formula
    /// `cov_xx <= |row of J W|^2 s_max^2 + blur`.
    #[inline(always)]
    fn is_surely_outside(&self, splat: &Splat, &Sight { mean: t, rotation, bend, .. }: &Sight) -> bool {
        if t.z < NEAR_PLANE {
            return true;
        }
        let slope = DVec2::new(t.x, t.y) / t.z;
        let centre = self.focal * slope + self.centre;
        if (0..2).all(|axis| centre[axis] >= 0.5 && centre[axis] <= self.size[axis] as f64 - 0.5) {
            return false;
        }
        let kept = slope.clamp(self.limits_min, self.limits_max);
        let largest = splat.scale.iter().fold(0.0_f64, |max, &s| max.max(f64::from(s).abs()));
        let w = rotation.transpose();
        let rows = [w.x_axis - kept.x * w.z_axis, w.y_axis - kept.y * w.z_axis];
        let rows = [0, 1].map(|k| self.focal[k] / t.z * rows[k]);
        let rows = bend.map_or(rows, |bend| bent(bend, rows));
        let reach = largest_reach(splat.opacity);
        (0..2).any(|axis| {
            let extent = reach * (largest * largest * rows[axis].length_squared() + self.blur).sqrt();
            centre[axis] + extent < 0.5 || centre[axis] - extent > self.size[axis] as f64 - 0.5
        })
    }

    /// Centre of the projected Gaussian, pixels.
    #[inline(always)]
    pub(super) fn centre_of(&self, projected: &Projected) -> DVec2 {
        let t = projected.camera_mean;
        self.focal * DVec2::new(t.x, t.y) / t.z + self.centre
    }

    /// The footprint of a Gaussian; `None` where it can reach no pixel of the image.
    #[inline(always)]
    pub(super) fn footprint(&self, splat: &Splat, index: u32) -> Option<Footprint> {
        if splat.opacity.is_nan() || splat.opacity < ALPHA_MIN {
            return None;
        }
        let sight = self.sight(splat);
        if self.is_surely_outside(splat, &sight) { None } else { self.exact_footprint(splat, &sight, index) }
    }

    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "f64 to f32 is the purpose")]
    fn exact_footprint(&self, splat: &Splat, sight: &Sight, index: u32) -> Option<Footprint> {
        let projected = self.project_seen(splat, sight)?;
        let centre = self.centre_of(&projected);
        let [xx, xy, yy] = projected.covariance;
        let reach = (2.0 * (f64::from(splat.opacity) / f64::from(ALPHA_MIN)).ln()).sqrt() + 1e-4;
        let (extent_x, extent_y) = (reach * xx.sqrt(), reach * yy.sqrt());
        let inside = |c: f64, e: f64, size: usize| c + e >= 0.5 && c - e <= size as f64 - 0.5;
        if !(inside(centre.x, extent_x, self.size[0]) && inside(centre.y, extent_y, self.size[1])) {
            return None;
        }
        let half_log2_e = 0.5 * std::f64::consts::LOG2_E;
        let footprint = Footprint {
            mean_x: centre.x as f32,
            mean_y: centre.y as f32,
            shear: (xy / yy) as f32,
            curve_u: (-half_log2_e * (yy / projected.determinant)) as f32,
            curve_y: (-half_log2_e / yy) as f32,
            width2: (projected.determinant / (half_log2_e * yy)) as f32,
            log2_opacity: f64::from(splat.opacity).log2() as f32,
            colour: splat.colour,
            depth: projected.camera_mean.z as f32,
            extent_y: extent_y as f32,
            extent_x: extent_x as f32,
            widest_y: (xy / xx * extent_x) as f32,
            index,
        };
        footprint.is_finite().then_some(footprint)
    }
}

impl Footprint {
    /// Half the width, pixels, of the row at height `dy` above the mean in which alpha can reach its minimum.
    #[inline(always)]
    pub(super) fn half_width(&self, dy: f32) -> f32 {
        let room = self.log2_opacity - LOG2_ALPHA_MIN + self.curve_y * dy * dy;
        (room.max(0.0) * self.width2).sqrt()
    }

    #[inline(always)]
    fn is_finite(&self) -> bool {
        let sum = self.mean_x + self.mean_y + self.shear + self.curve_u + self.curve_y + self.width2;
        let rest = self.colour.iter().sum::<f32>()
            + self.log2_opacity
            + self.depth
            + self.extent_x
            + self.extent_y
            + self.widest_y;
        sum.is_finite() && rest.is_finite()
    }
}

#[inline(always)]
fn vector(v: [f32; 3]) -> DVec3 {
    DVec3::from_array(v.map(f64::from))
}

/// The rows of a map to the image, its places drawn apart.
#[inline(always)]
fn bent(bend: DMat2, rows: [DVec3; 2]) -> [DVec3; 2] {
    [0, 1].map(|k| bend.x_axis[k] * rows[0] + bend.y_axis[k] * rows[1])
}

/// At least as many standard deviations as those at which alpha falls to its minimum, with room for rounding.
#[inline(always)]
fn largest_reach(opacity: f32) -> f64 {
    const OF_OPAQUE: f64 = 3.33;
    if opacity <= 1.0 { OF_OPAQUE } else { (2.0 * (f64::from(opacity) / f64::from(ALPHA_MIN)).ln()).sqrt() + 1e-2 }
}

/// The unit quaternion and the norm; the identity and 0 where there is no direction.
#[inline(always)]
fn normalise(q: [f64; 4]) -> ([f64; 4], f64) {
    let norm = q.iter().map(|v| v * v).sum::<f64>().sqrt();
    // What is not a number stays so: the footprint is then not finite and nothing is drawn.
    if norm == 0.0 { ([1.0, 0.0, 0.0, 0.0], 0.0) } else { (q.map(|v| v / norm), norm) }
}

/// The rotation of a unit quaternion (w, x, y, z).
#[inline(always)]
fn rotation_of([w, x, y, z]: [f64; 4]) -> DMat3 {
    DMat3::from_cols(
        DVec3::new(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)),
        DVec3::new(2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)),
        DVec3::new(2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_has_no_footprint_is_surely_outside() {
        let view = PinholeView {
            width: 80,
            height: 50,
            fx: 60.0,
            fy: 70.0,
            cx: 35.0,
            cy: 30.0,
            camera_from_clip: [[0.8, 0.0, 0.6, 0.2], [0.0, 1.0, 0.0, 0.1], [-0.6, 0.0, 0.8, 0.3]],
            time: 0.2,
            shutter: None,
            pixel_side: 1.0,
        };
        let projector = Projector::new(&view);
        let at = |i: u32, salt: f32| ((i as f32 * 12.9898 + salt).sin() * 43_758.547).fract();
        let (mut outside, mut shown, mut missed) = (0, 0, 0);
        for i in 0..20_000 {
            let reach = 10.0_f32.powf(2.0 * at(i, 9.0));
            let splat = Splat {
                mean: [0.1, 0.7, 1.3].map(|salt| reach * at(i, salt)),
                quat: [at(i, 2.0), at(i, 3.0), at(i, 4.0), at(i, 5.0)],
                scale: [6.0, 7.0, 8.0].map(|salt| 10.0_f32.powf(2.0 * at(i, salt) - 1.0)),
                opacity: at(i, 10.0).abs(),
                velocity: [1.0, 0.0, -1.0],
                ..Splat::default()
            };
            let sight = projector.sight(&splat);
            let drawn = splat.opacity >= ALPHA_MIN && projector.exact_footprint(&splat, &sight, i).is_some();
            let culled = projector.is_surely_outside(&splat, &sight);
            assert!(!(drawn && culled), "Gaussian {i}: {splat:?}");
            outside += usize::from(culled);
            shown += usize::from(drawn);
            missed += usize::from(!drawn && !culled);
        }
        assert!(outside > 5000 && shown > 2000 && missed < outside / 4, "{outside} {shown} {missed}");
        let spoilt = Splat { mean: [f32::NAN; 3], ..Splat::default() };
        assert!(!projector.is_surely_outside(&spoilt, &projector.sight(&spoilt)));
        assert!(projector.footprint(&spoilt, 0).is_none());
    }
}
