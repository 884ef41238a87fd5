//! Thin Gaussians on planes that are told by their inverse depths in an image.

use glam::{Mat3, Quat, Vec3};

use super::{LOG_SCALE, MEAN, NUM_ATTRIBUTES, QUAT};
use crate::views::{PinholeView, Projected};

/// Variance that the renderer adds to every projected Gaussian, square pixels.
pub(super) const BLUR: f32 = 0.3;
/// Smallest projected standard deviation before that, pixels.
const SIGMA_PX: f32 = 0.12;
/// Thickness over the shorter of the two other axes.
const THICKNESS: f32 = 0.2;
/// Largest change of the inverse depth over the standard deviations of a disc, a share of it: what is steeper is taken to be so steep.
const STEEPEST: f32 = 0.2;

/// Inverse depth around an image position, which is linear over a plane of the scene: `at + by_column x + by_row y`, x and y in pixels
/// from the position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Plane {
    /// Inverse depth at the position, 1 / metres.
    pub(super) at: f32,
    /// Its change by a pixel to the right.
    pub(super) by_column: f32,
    /// Its change by a pixel down.
    pub(super) by_row: f32,
}

impl Plane {
    /// Inverse depth so many pixels to the right and down, 1 / metres.
    pub(super) fn inverse(&self, [x, y]: [f32; 2]) -> f32 {
        self.at + self.by_column * x + self.by_row * y
    }
}

/// Standard deviations along columns and rows, pixels, of a Gaussian that is drawn as wide as `share` of these sides of a rectangle,
/// pixels: less what the renderer adds, and at least 0.12.
pub(super) fn sigmas(size: [usize; 2], share: f32) -> [f32; 2] {
    size.map(|side| {
        let drawn = share * side as f32;
        (drawn * drawn - BLUR).max(SIGMA_PX * SIGMA_PX).sqrt()
    })
}

/// Puts a Gaussian on a plane around an image position, as a disc whose projection has standard deviations `sigmas` along columns
/// and rows, pixels; mean, scales and rotation are set. One that is narrower than a pixel both ways is round.
///
/// # Formula
/// With P(u, v) the point of the plane behind a position: axes of `a a' + b b'`, `a = sigma_u dP/du`, `b = sigma_v dP/dv`, and a third
/// one, across the plane, a fifth as long as the shorter of these.
pub(super) fn put(
    row: &mut [f32; NUM_ATTRIBUTES],
    view: &PinholeView,
    place: [f32; 2],
    plane: Plane,
    sigmas: [f32; 2],
) {
    let [u, v] = place;
    let depth = 1.0 / plane.at;
    row[MEAN].copy_from_slice(&view.unproject(Projected { u, v, depth }));
    if sigmas[0] == sigmas[1] && sigmas[0] < 1.0 {
        row[LOG_SCALE].fill((sigmas[0] * depth / view.fx).ln());
        row[QUAT].copy_from_slice(&[1.0, 0.0, 0.0, 0.0]);
        return;
    }
    let change = (plane.by_column * sigmas[0]).hypot(plane.by_row * sigmas[1]) / plane.at;
    let kept = (STEEPEST / change.max(STEEPEST)) / plane.at;
    let ray = Vec3::new((u - view.cx) / view.fx, (v - view.cy) / view.fy, 1.0);
    let a = sigmas[0] * depth * (Vec3::X / view.fx - ray * (kept * plane.by_column));
    let b = sigmas[1] * depth * (Vec3::Y / view.fy - ray * (kept * plane.by_row));
    let turn = 0.5 * (2.0 * a.dot(b)).atan2(a.length_squared() - b.length_squared());
    let (sin, cos) = turn.sin_cos();
    let (first, second) = (a * cos + b * sin, b * cos - a * sin);
    let lengths = [first.length(), second.length()];
    let axes = [first / lengths[0], second / lengths[1]];
    let m = &view.exposing(place).camera_from_clip;
    let clip_from_camera = Mat3::from_cols(
        Vec3::new(m[0][0], m[0][1], m[0][2]),
        Vec3::new(m[1][0], m[1][1], m[1][2]),
        Vec3::new(m[2][0], m[2][1], m[2][2]),
    );
    let turn = Quat::from_mat3(&(clip_from_camera * Mat3::from_cols(axes[0], axes[1], axes[0].cross(axes[1]))));
    let thickness = THICKNESS * lengths[0].min(lengths[1]);
    row[LOG_SCALE].copy_from_slice(&[lengths[0].ln(), lengths[1].ln(), thickness.ln()]);
    row[QUAT].copy_from_slice(&[turn.w, turn.x, turn.y, turn.z]);
}

#[cfg(test)]
mod tests {
    use glam::{Mat3, Quat, Vec3};

    use super::{Plane, put, sigmas};
    use crate::{
        gaussians::{LOG_SCALE, MEAN, NUM_ATTRIBUTES, QUAT},
        views::{PinholeView, samples::ahead},
    };

    /// A camera that looks somewhere.
    fn turned() -> PinholeView {
        let turn = Mat3::from_quat(Quat::from_euler(glam::EulerRot::XYZ, 0.4, -0.9, 0.3));
        let row = |k: usize| [turn.row(k).x, turn.row(k).y, turn.row(k).z, [0.3, -1.0, 2.0][k]];
        PinholeView { camera_from_clip: [row(0), row(1), row(2)], ..ahead(80, 60, 70.0) }
    }

    fn made(place: [f32; 2], plane: Plane, sigmas: [f32; 2]) -> [f32; NUM_ATTRIBUTES] {
        let mut row = [0.0; NUM_ATTRIBUTES];
        put(&mut row, &turned(), place, plane, sigmas);
        row
    }

    /// Mean and axes, each as long as its standard deviation.
    fn shape(row: &[f32; NUM_ATTRIBUTES]) -> (Vec3, [Vec3; 3]) {
        let [w, x, y, z] = std::array::from_fn(|k| row[QUAT.start + k]);
        let turn = Quat::from_xyzw(x, y, z, w);
        (Vec3::from_slice(&row[MEAN]), [0, 1, 2].map(|k| turn * Vec3::AXES[k] * row[LOG_SCALE.start + k].exp()))
    }

    #[test]
    fn a_disc_is_drawn_as_wide_as_asked() {
        let (view, plane) = (turned(), Plane { at: 0.1, by_column: 2e-3, by_row: -3e-3 });
        for wanted in [[4.0, 4.0], [1.5, 3.0], [2.0, 0.12]] {
            let (mean, axes) = shape(&made([50.0, 20.0], plane, wanted));
            let at = view.project(mean.to_array()).unwrap();
            assert!((at.u - 50.0).abs() < 1e-3 && (at.v - 20.0).abs() < 1e-3 && (at.depth - 10.0).abs() < 1e-3);
            let mut covariance = [0.0_f32; 3];
            for axis in &axes[..2] {
                let step = 1e-3;
                let moved = view.project((mean + step * *axis).to_array()).unwrap();
                let [x, y] = [(moved.u - at.u) / step, (moved.v - at.v) / step];
                covariance = [covariance[0] + x * x, covariance[1] + x * y, covariance[2] + y * y];
            }
            let [a, b] = wanted.map(|s: f32| s * s);
            for (got, want) in covariance.into_iter().zip([a, 0.0, b]) {
                assert!((got - want).abs() < 0.02 * a.max(b), "{covariance:?} {wanted:?}");
            }
        }
    }

    #[test]
    fn a_disc_lies_on_its_plane() {
        let (view, plane) = (turned(), Plane { at: 0.1, by_column: 2e-3, by_row: -3e-3 });
        let (mean, axes) = shape(&made([50.0, 20.0], plane, [4.0, 4.0]));
        for axis in &axes[..2] {
            let at = view.project((mean + 0.5 * *axis).to_array()).unwrap();
            let inverse = plane.inverse([at.u - 50.0, at.v - 20.0]);
            assert!((at.depth * inverse - 1.0).abs() < 1e-3, "{} {}", at.depth, 1.0 / inverse);
        }
        let lengths = axes.map(Vec3::length);
        assert!(lengths[2] < 0.21 * lengths[0].min(lengths[1]), "{lengths:?}");
    }

    #[test]
    fn what_is_steeper_than_a_rectangle_can_show_is_bounded_and_small_ones_are_round() {
        let steep = Plane { at: 0.01, by_column: 1.0, by_row: 0.0 };
        let row = made([40.0, 30.0], steep, [3.0, 3.0]);
        assert!(row.iter().all(|value| value.is_finite()));
        let longest = shape(&row).1.map(Vec3::length).into_iter().fold(0.0, f32::max);
        assert!(longest < 0.25 * 100.0, "{longest} m at 100 m");
        let small = made([40.0, 30.0], steep, sigmas([1, 1], 0.5));
        assert_eq!((small[LOG_SCALE.start], small[QUAT.start]), (small[LOG_SCALE.end - 1], 1.0));
    }

    #[test]
    fn the_blur_of_the_renderer_is_counted() {
        assert!((sigmas([8, 2], 0.5)[0].powi(2) + 0.3 - 16.0).abs() < 1e-4);
        assert_eq!(sigmas([1, 1], 0.5), [0.12; 2]);
    }
}
