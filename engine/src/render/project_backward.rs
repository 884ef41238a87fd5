//! From the moments of a Gaussian to the gradients of its physical values: the chain rule of `project`, in f64.

use glam::{DMat3, DVec2, DVec3};

use super::backward::{MOMENTS, Moments};
use super::project::{Projected, Projector};
use super::tiles::TileLists;
use crate::gaussians::physical::{Splat, SplatGradient};
use crate::parallel;
use crate::views::PinholeView;

/// `[num_visible]` gradients of the visible Gaussians, nearest first.
pub(super) fn gradients(
    splats: &[Splat],
    view: &PinholeView,
    lists: &TileLists,
    moments: &[Moments],
) -> Vec<SplatGradient> {
    let (projector, arch) = (Projector::new(view), pulp::Arch::new());
    parallel::map(lists.footprints.len(), 1024, &|v| {
        let places_of_splats =
            &lists.places_of_splats[lists.first_of_splat[v] as usize..lists.first_of_splat[v + 1] as usize];
        let mut sums = [0.0_f64; MOMENTS];
        for &place_of_splat in places_of_splats {
            for (sum, &moment) in sums.iter_mut().zip(&moments[place_of_splat as usize]) {
                *sum += f64::from(moment);
            }
        }
        arch.dispatch(|| gradient_of(&projector, &splats[lists.footprints[v].index as usize], &sums))
    })
}

#[expect(clippy::cast_possible_truncation, reason = "gradients are stored in f32")]
#[inline(always)]
fn gradient_of(projector: &Projector, splat: &Splat, sums: &[f64; MOMENTS]) -> SplatGradient {
    if sums.iter().all(|&s| s == 0.0) {
        return SplatGradient::default();
    }
    let Some(p) = projector.project(splat) else { return SplatGradient::default() };
    let image = ImagePlane::of(&p, sums);
    let single = |v: DVec3| v.to_array().map(|x| x as f32);
    let scale = DVec3::from_array(splat.scale.map(f64::from));
    // M = (J W) (R S); cov = M M^T + blur
    let scaled_axes = DMat3::from_cols(p.axes.x_axis * scale.x, p.axes.y_axis * scale.y, p.axes.z_axis * scale.z);
    let m = p.image_from_world.map(|row| scaled_axes.transpose() * row);
    let [v_xx, v_xy, v_yy] = image.v_covariance;
    let v_m = [2.0 * v_xx * m[0] + v_xy * m[1], v_xy * m[0] + 2.0 * v_yy * m[1]];
    let v_jw = v_m.map(|row| scaled_axes * row);
    let outer = |k: usize| p.image_from_world[0] * v_m[0][k] + p.image_from_world[1] * v_m[1][k];
    let v_scaled_axes = [outer(0), outer(1), outer(2)];
    let axes = [p.axes.x_axis, p.axes.y_axis, p.axes.z_axis];
    let v_scale: [f64; 3] = std::array::from_fn(|k| v_scaled_axes[k].dot(axes[k]));
    let v_rotation: [DVec3; 3] = std::array::from_fn(|k| v_scaled_axes[k] * scale[k]);
    // The bend is a constant: gradients pass through its transpose.
    let unbent = |v: DVec2| p.bend.map_or(v, |bend| bend.transpose() * v);
    let image = ImagePlane { v_centre: unbent(image.v_centre), ..image };
    let v_jw = p.bend.map_or(v_jw, |bend| [bend.x_axis, bend.y_axis].map(|a| a.x * v_jw[0] + a.y * v_jw[1]));
    let v_mean = p.rotation.transpose() * camera_mean_gradient(projector, &p, &image, &v_jw, sums[9]);
    SplatGradient {
        mean: single(v_mean),
        quat: quat_gradient(&p, &v_rotation).map(|x| x as f32),
        scale: v_scale.map(|x| x as f32),
        opacity: (sums[0] / f64::from(splat.opacity)) as f32,
        colour: [sums[6] as f32, sums[7] as f32, sums[8] as f32],
        velocity: single(v_mean * p.elapsed),
    }
}

/// Gradients by the projected mean (pixels) and by the projected covariance (xx, xy as one number, yy).
struct ImagePlane {
    v_centre: DVec2,
    v_covariance: [f64; 3],
}

impl ImagePlane {
    /// # Formula
    /// `sigma = (A u^2 + C dy^2) / 2`, `u = dx - s dy`, `A = yy / det`, `C = 1 / yy`, `s = xy / yy`.
    #[inline(always)]
    fn of(p: &Projected, sums: &[f64; MOMENTS]) -> Self {
        let [_, xy, yy] = p.covariance;
        let (a, c, s) = (yy / p.determinant, 1.0 / yy, xy / yy);
        let [_, g_dy, g_dydy, g_u, g_udy, g_uu, ..] = *sums;
        // The moments hold g = -v_sigma.
        let (v_a, v_c, v_s) = (-0.5 * g_uu, -0.5 * g_dydy, a * g_udy);
        let a_s = xy / p.determinant;
        Self {
            v_centre: DVec2::new(a * g_u, c * g_dy - a_s * g_u),
            v_covariance: [-a * a * v_a, 2.0 * a * a_s * v_a + c * v_s, -a_s * a_s * v_a - c * c * v_c - s * c * v_s],
        }
    }
}

/// Gradient by the mean in the camera frame: through the centre, the Jacobian and the depth.
#[inline(always)]
fn camera_mean_gradient(
    projector: &Projector,
    p: &Projected,
    image: &ImagePlane,
    v_jw: &[DVec3; 2],
    v_depth: f64,
) -> DVec3 {
    let (t, j) = (p.camera_mean, p.jacobian_mean);
    let z = t.z;
    let w = p.rotation.transpose();
    let mut v_t = DVec3::new(0.0, 0.0, v_depth);
    for axis in 0..2 {
        let focal = projector.focal[axis];
        let v_centre = image.v_centre[axis];
        v_t[axis] += v_centre * focal / z;
        v_t.z -= v_centre * focal * t[axis] / (z * z);
        // Row `axis` of J: focal / z in its own column, -focal j / z^2 in the last.
        let v_diagonal = v_jw[axis].dot(w.col(axis));
        let v_last = v_jw[axis].dot(w.z_axis);
        v_t.z -= v_diagonal * focal / (z * z);
        if p.clamped[axis] {
            // j = limit z: the entry is -focal limit / z.
            v_t.z += v_last * focal * j[axis] / (z * z * z);
        } else {
            v_t[axis] -= v_last * focal / (z * z);
            v_t.z += 2.0 * v_last * focal * j[axis] / (z * z * z);
        }
    }
    v_t
}

/// Gradient by the unnormalised quaternion, from that by the columns of the rotation.
#[inline(always)]
fn quat_gradient(p: &Projected, v: &[DVec3; 3]) -> [f64; 4] {
    if p.quat_norm == 0.0 {
        return [0.0; 4];
    }
    let [w, x, y, z] = p.quat;
    // v[column][row]
    let (xx, yy, zz) = (v[0].x, v[1].y, v[2].z);
    let (r01, r10) = (v[1].x, v[0].y);
    let (r02, r20) = (v[2].x, v[0].z);
    let (r12, r21) = (v[2].y, v[1].z);
    let unit = [
        2.0 * (x * (r21 - r12) + y * (r02 - r20) + z * (r10 - r01)),
        2.0 * (-2.0 * x * (yy + zz) + y * (r01 + r10) + z * (r02 + r20) + w * (r21 - r12)),
        2.0 * (x * (r01 + r10) - 2.0 * y * (xx + zz) + z * (r12 + r21) + w * (r02 - r20)),
        2.0 * (x * (r02 + r20) + y * (r12 + r21) - 2.0 * z * (xx + yy) + w * (r10 - r01)),
    ];
    let along: f64 = unit.iter().zip(&p.quat).map(|(a, b)| a * b).sum();
    std::array::from_fn(|k| (unit[k] - along * p.quat[k]) / p.quat_norm)
}
