//! One Gaussian's footprint in the image, with derivatives.

use super::dual::Dual;
use super::{Camera, Gaussian};

/// Depth, metres, at and below which a Gaussian is not drawn.
const NEAR: f64 = 0.01;
/// Variance, square pixels, added to both axes of every footprint.
const BLUR: f64 = 0.3;
/// How far outside the image the Jacobian is still taken where the Gaussian is, in half fields of view.
const MARGIN: f64 = 0.3;
/// Length under which a quaternion is divided by this instead.
const MIN_NORM: f64 = 1e-12;

pub(super) const MEAN: usize = 0;
pub(super) const QUAT: usize = 3;
pub(super) const SCALE: usize = 7;

type Matrix3 = [[Dual; 3]; 3];

/// Place, shape and depth of a footprint, with their derivatives by the ten parameters.
#[derive(Clone, Copy, Debug)]
pub(super) struct Projection {
    /// Centre, pixels.
    pub(super) mean2d: [Dual; 2],
    /// Inverse covariance `[xx, xy, yy]`, per square pixel.
    pub(super) conic: [Dual; 3],
    /// Depth along the camera's axis, metres.
    pub(super) depth: Dual,
}

/// The footprint of a Gaussian; `None` behind the near plane.
///
/// # Formula
/// `t = W (x + v dt) + b`, `mean2d = (fx tx/tz + cx, fy ty/tz + cy)`, `cov2d = J W R S S^T R^T W^T J^T + 0.3 I`.
pub(super) fn project(gaussian: &Gaussian, camera: &Camera) -> Option<Projection> {
    let elapsed = camera.time - gaussian.time;
    let rows = &camera.camera_from_world;
    let mean: [Dual; 3] = std::array::from_fn(|k| Dual::parameter(gaussian.mean[k], MEAN + k));
    let moved: [Dual; 3] = std::array::from_fn(|k| gaussian.velocity[k] * elapsed + mean[k]);
    let t: [Dual; 3] =
        std::array::from_fn(|r| rows[r][3] + (rows[r][0] * moved[0] + rows[r][1] * moved[1] + rows[r][2] * moved[2]));
    if t[2].value.is_nan() || t[2].value <= NEAR {
        return None;
    }
    let view: Matrix3 = std::array::from_fn(|r| std::array::from_fn(|c| Dual::constant(rows[r][c])));
    let own: Matrix3 = scaled_axes(gaussian);
    let seen = product(&view, &own);
    let jacobian = jacobian(t, camera);
    let half: [[Dual; 3]; 2] = std::array::from_fn(|r| std::array::from_fn(|c| dot(jacobian[r], column(&seen, c))));
    let xx = BLUR + dot(half[0], half[0]);
    let xy = dot(half[0], half[1]);
    let yy = BLUR + dot(half[1], half[1]);
    let determinant = xx * yy - xy * xy;
    Some(Projection {
        mean2d: [camera.cx + camera.fx * (t[0] / t[2]), camera.cy + camera.fy * (t[1] / t[2])],
        conic: [yy / determinant, -(xy / determinant), xx / determinant],
        depth: t[2],
    })
}

/// `R S`: the columns are the Gaussian's axes, as long as its standard deviations.
fn scaled_axes(gaussian: &Gaussian) -> Matrix3 {
    let quat: [Dual; 4] = std::array::from_fn(|k| Dual::parameter(gaussian.quat[k], QUAT + k));
    let scale: [Dual; 3] = std::array::from_fn(|k| Dual::parameter(gaussian.scale[k], SCALE + k));
    let square = quat[0] * quat[0] + quat[1] * quat[1] + quat[2] * quat[2] + quat[3] * quat[3];
    let norm = if square.value > MIN_NORM * MIN_NORM { square.sqrt() } else { Dual::constant(MIN_NORM) };
    let [w, x, y, z] = quat.map(|q| q / norm);
    let one = Dual::constant(1.0);
    let rotation = [
        [one - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), one - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), one - 2.0 * (x * x + y * y)],
    ];
    rotation.map(|row| [row[0] * scale[0], row[1] * scale[1], row[2] * scale[2]])
}

/// `d mean2d / d t`, taken no further outside the image than the margin.
fn jacobian(t: [Dual; 3], camera: &Camera) -> [[Dual; 3]; 2] {
    let (width, height) = (camera.width as f64, camera.height as f64);
    let margin_x = MARGIN * 0.5 * width / camera.fx;
    let margin_y = MARGIN * 0.5 * height / camera.fy;
    let x = (t[0] / t[2]).clamp(-(camera.cx / camera.fx + margin_x), (width - camera.cx) / camera.fx + margin_x);
    let y = (t[1] / t[2]).clamp(-(camera.cy / camera.fy + margin_y), (height - camera.cy) / camera.fy + margin_y);
    let zero = Dual::constant(0.0);
    let per_depth = Dual::constant(1.0) / t[2];
    [
        [camera.fx * per_depth, zero, -(camera.fx * (x * per_depth))],
        [zero, camera.fy * per_depth, -(camera.fy * (y * per_depth))],
    ]
}

fn product(a: &Matrix3, b: &Matrix3) -> Matrix3 {
    std::array::from_fn(|r| std::array::from_fn(|c| dot(a[r], column(b, c))))
}

fn column(matrix: &Matrix3, c: usize) -> [Dual; 3] {
    matrix.map(|row| row[c])
}

fn dot(a: [Dual; 3], b: [Dual; 3]) -> Dual {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
