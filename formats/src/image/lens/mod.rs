//! Lens distortion: where a pixel of the rectified image lies in the image file, and when it was exposed.

mod brown_conrady;
mod fisheye;

use crate::camera::{Camera, Distortion, Readout};
use brown_conrady::BrownConrady;
use fisheye::FisheyeLens;

/// Halvings that bring an interval of f64 down to its last bits.
const BISECTIONS: usize = 64;
/// Places along each side of an image at which the moments of a rolling shutter are looked up.
const MOMENTS: u8 = 9;

/// A lens with the pinhole of its rectified image.
#[derive(Clone, Debug)]
pub(super) enum Lens {
    BrownConrady(BrownConrady),
    Fisheye(FisheyeLens),
}

impl Lens {
    /// The lens of a camera; `None` when its image is rectified already.
    pub(super) fn new(camera: &Camera) -> Option<Self> {
        match camera.distortion? {
            Distortion::BrownConrady(coefficients) => coefficients
                .iter()
                .any(|&k| k != 0.0)
                .then(|| Self::BrownConrady(BrownConrady::new(camera, coefficients))),
            Distortion::Fisheye(lens) => Some(Self::Fisheye(FisheyeLens::new(camera, &lens))),
        }
    }

    /// The pixel of the image file that shows what pixel `(u, v)` of the rectified image shows (centres at +0.5); `None` where the
    /// model folds over: there, several rays share a pixel, and only the innermost is real.
    pub(super) fn source_of(&self, u: f64, v: f64) -> Option<[f64; 2]> {
        match self {
            Self::BrownConrady(lens) => lens.source_of(u, v),
            Self::Fisheye(lens) => lens.source_of(u, v),
        }
    }

    /// By how much the inverse depth along the axis of the rectified image is larger than that along the axis of the file's camera, at a pixel of
    /// the rectified image.
    pub(super) fn inverse_depth_share(&self, u: f64, v: f64) -> f64 {
        match self {
            Self::BrownConrady(_) => 1.0,
            Self::Fisheye(lens) => lens.ray(u, v).z,
        }
    }
}

/// When the pixels of the rectified image of a camera are exposed: `[a, b, c]`, seconds after its timestamp `a + b u + c v`, where `u` and `v` are
/// shares of the image's width and height; `None` for a shutter that is not a rolling one.
///
/// # Formula
/// The plane that fits the moments of the pixels of the file best (least squares), which is exact where the lens does not bend.
pub(super) fn moments(camera: &Camera) -> Option<[f64; 3]> {
    let readout = camera.readout.filter(Readout::is_rolling)?;
    let Some(lens) = Lens::new(camera) else {
        let at = |u, v| readout.moment([u, v]);
        return Some([at(0.0, 0.0), at(1.0, 0.0) - at(0.0, 0.0), at(0.0, 1.0) - at(0.0, 0.0)]);
    };
    let [width, height] = camera.file_size().map(f64::from);
    let (mut normal, mut right) = (glam::DMat3::ZERO, glam::DVec3::ZERO);
    let share = |i: u8| f64::from(i) / f64::from(MOMENTS - 1);
    for (u, v) in (0..MOMENTS).flat_map(|j| (0..MOMENTS).map(move |i| (share(i), share(j)))) {
        let Some([x, y]) = lens.source_of(u * f64::from(camera.width), v * f64::from(camera.height)) else { continue };
        let (x, y) = (x / width, y / height);
        if !((0.0..=1.0).contains(&x) && (0.0..=1.0).contains(&y)) {
            continue;
        }
        let row = glam::DVec3::new(1.0, u - 0.5, v - 0.5);
        normal += glam::DMat3::from_cols(row * row.x, row * row.y, row * row.z);
        right += row * readout.moment([x, y]);
    }
    let found = normal.inverse() * right;
    // Where no pixel of the file is in the rectified image, all are exposed in the middle.
    let plane = [found.x - 0.5 * (found.y + found.z), found.y, found.z];
    Some(if found.is_finite() { plane } else { [readout.middle, 0.0, 0.0] })
}

/// The point between `low` (positive value) and `high` (value of at most 0) at which the value stops to be positive.
fn bisect(value: impl Fn(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (low + high);
        if value(middle) > 0.0 { low = middle } else { high = middle }
    }
    low
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::{
        camera::{Fisheye, Intrinsics, ReadoutDirection},
        pose::Pose,
    };

    fn camera(direction: ReadoutDirection, distortion: Option<Distortion>) -> Camera {
        Camera {
            name: "c".to_owned(),
            timestamp: 0.0,
            width: 200,
            height: 100,
            intrinsics: Intrinsics { fx: 100.0, fy: 100.0, cx: 100.0, cy: 50.0 },
            distortion,
            readout: Some(Readout { seconds: 0.04, direction, middle: 0.0 }),
            world_from_camera: Pose::IDENTITY,
        }
    }

    #[test]
    fn moments_run_the_way_of_the_readout_around_the_timestamp() {
        use ReadoutDirection::{BottomToTop, LeftToRight, RightToLeft, TopToBottom};
        let wanted = [
            (TopToBottom, [-0.02, 0.0, 0.04]),
            (BottomToTop, [0.02, 0.0, -0.04]),
            (LeftToRight, [-0.02, 0.04, 0.0]),
            (RightToLeft, [0.02, -0.04, 0.0]),
        ];
        for (direction, want) in wanted {
            assert_eq!(moments(&camera(direction, None)), Some(want));
            let bent = moments(&camera(direction, Some(Distortion::BrownConrady([-0.05, 0.0, 0.0, 0.0, 0.0]))));
            let near = bent.unwrap().iter().zip(want).all(|(a, b)| (a - b).abs() < 4e-3);
            assert!(near, "{bent:?} {want:?}");
        }
        let mut still = camera(TopToBottom, None);
        still.readout = Some(Readout { seconds: 0.0, direction: TopToBottom, middle: -0.01 });
        assert_eq!(moments(&still), Some([-0.01, 0.0, 0.0]));
        still.readout = Some(Readout { seconds: 0.0, direction: TopToBottom, middle: 0.0 });
        assert_eq!(moments(&still), None);
        still.readout = None;
        assert_eq!(moments(&still), None);
    }

    #[test]
    fn a_turned_pinhole_has_the_moments_of_the_pixels_that_it_is_made_of() {
        // The pinhole lies on its side: the rows of the file are its columns.
        let lens = Fisheye {
            coefficients: [0.0; 4],
            width: 200,
            height: 200,
            intrinsics: Intrinsics { fx: 100.0, fy: 100.0, cx: 100.0, cy: 100.0 },
            world_from_fisheye: Pose::IDENTITY,
            fisheye_from_pinhole: DMat3::from_rotation_z(std::f64::consts::FRAC_PI_2),
        };
        let turned = camera(ReadoutDirection::TopToBottom, Some(Distortion::Fisheye(lens)));
        let [a, b, c] = moments(&turned).unwrap();
        assert!(b > 0.02 && c.abs() < 1e-9 && (a + 0.5 * b).abs() < 1e-9, "{a} {b} {c}");
    }
}
