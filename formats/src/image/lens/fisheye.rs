//! Fisheye lenses by the model of four coefficients.

use std::f64::consts::PI;

use glam::{DMat3, DVec3};

use super::bisect;
use crate::camera::{Camera, Fisheye, Intrinsics};

/// Angles from the axis at which the growth of the radius is looked at.
const ANGLES: u16 = 1024;

/// A fisheye with a pinhole that is cut out of its image.
#[derive(Clone, Debug)]
pub(in crate::image) struct FisheyeLens {
    pinhole: Intrinsics,
    lens: Intrinsics,
    coefficients: [f64; 4],
    fisheye_from_pinhole: DMat3,
    /// Angle from the axis (radians) at which the radius stops to grow.
    fold: f64,
}

impl FisheyeLens {
    /// The lens of a camera that is a part of its image.
    pub(super) fn new(camera: &Camera, lens: &Fisheye) -> Self {
        Self {
            pinhole: camera.intrinsics,
            lens: lens.intrinsics,
            coefficients: lens.coefficients,
            fisheye_from_pinhole: lens.fisheye_from_pinhole,
            fold: fold(&lens.coefficients),
        }
    }

    /// The ray through a pixel of the pinhole in the axes of the fisheye, of depth 1 in those of the pinhole.
    pub(super) fn ray(&self, u: f64, v: f64) -> DVec3 {
        let Intrinsics { fx, fy, cx, cy } = self.pinhole;
        self.fisheye_from_pinhole * DVec3::new((u - cx) / fx, (v - cy) / fy, 1.0)
    }

    /// The pixel of the fisheye's image that shows what pixel `(u, v)` of the pinhole shows; `None` beyond the fold.
    ///
    /// # Source
    /// Kannala and Brandt, "A generic camera model and calibration method", 2006, in the form of `OpenCV`.
    pub(super) fn source_of(&self, u: f64, v: f64) -> Option<[f64; 2]> {
        let ray = self.ray(u, v);
        let across = ray.x.hypot(ray.y);
        let angle = across.atan2(ray.z);
        let Intrinsics { fx, fy, cx, cy } = self.lens;
        (angle < self.fold).then(|| {
            let share = if across > 0.0 { radius(&self.coefficients, angle) / across } else { 0.0 };
            [fx * share * ray.x + cx, fy * share * ray.y + cy]
        })
    }
}

/// Distance from the principal point at focal length 1.
fn radius([k1, k2, k3, k4]: &[f64; 4], angle: f64) -> f64 {
    let s = angle * angle;
    angle * (1.0 + s * (k1 + s * (k2 + s * (k3 + s * k4))))
}

/// The smallest angle (radians) at which the radius no longer grows, at most a half turn.
fn fold([k1, k2, k3, k4]: &[f64; 4]) -> f64 {
    let growth = |angle: f64| {
        let s = angle * angle;
        1.0 + s * (3.0 * k1 + s * (5.0 * k2 + s * (7.0 * k3 + s * 9.0 * k4)))
    };
    let at = |i: u16| PI * f64::from(i) / f64::from(ANGLES);
    let falls = |angle: f64| growth(angle).is_nan() || growth(angle) <= 0.0;
    (1..=ANGLES).find(|&i| falls(at(i))).map_or(PI, |i| bisect(growth, at(i - 1), at(i)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{camera::Distortion, image::lens::Lens, pose::Pose};

    fn camera(coefficients: [f64; 4], fisheye_from_pinhole: DMat3) -> Camera {
        let lens = Fisheye {
            coefficients,
            width: 400,
            height: 300,
            intrinsics: Intrinsics { fx: 120.0, fy: 110.0, cx: 201.0, cy: 149.0 },
            world_from_fisheye: Pose::IDENTITY,
            fisheye_from_pinhole,
        };
        Camera {
            name: "c".to_owned(),
            timestamp: 0.0,
            width: 200,
            height: 100,
            intrinsics: Intrinsics { fx: 100.0, fy: 100.0, cx: 100.0, cy: 50.0 },
            distortion: Some(Distortion::Fisheye(lens)),
            readout: None,
            world_from_camera: Pose::new(fisheye_from_pinhole, DVec3::ZERO),
        }
    }

    #[test]
    fn a_ray_falls_where_the_formula_says() {
        let lens = Lens::new(&camera([0.1, -0.02, 0.003, -0.0004], DMat3::IDENTITY)).unwrap();
        assert_eq!(lens.source_of(100.0, 50.0), Some([201.0, 149.0]));
        let [u, v] = lens.source_of(175.0, 150.0).unwrap(); // x = 0.75, y = 1, r = 1.25
        let t = 1.25_f64.atan();
        let d = t * (1.0 + 0.1 * t.powi(2) - 0.02 * t.powi(4) + 0.003 * t.powi(6) - 0.0004 * t.powi(8));
        assert!((u - (120.0 * d * 0.6 + 201.0)).abs() < 1e-10 && (v - (110.0 * d * 0.8 + 149.0)).abs() < 1e-10);
    }

    #[test]
    fn a_pinhole_may_look_to_the_side_and_behind() {
        // A quarter turn to the right: what it has in its middle is at 90 degrees in the fisheye.
        let right = DMat3::from_rotation_y(PI / 2.0);
        let lens = Lens::new(&camera([0.0; 4], right)).unwrap();
        let [u, v] = lens.source_of(100.0, 50.0).unwrap();
        assert!((u - (120.0 * PI / 2.0 + 201.0)).abs() < 1e-9 && (v - 149.0).abs() < 1e-9, "{u} {v}");
        assert!(lens.inverse_depth_share(0.0, 50.0) > 0.9 && lens.inverse_depth_share(199.0, 50.0) < 0.0);
    }

    #[test]
    fn beyond_the_largest_radius_there_is_nothing() {
        // t (1 - t^2 / 3) grows up to 1 radian.
        let coefficients = [-1.0 / 3.0, 0.0, 0.0, 0.0];
        assert!((fold(&coefficients) - 1.0).abs() < 1e-12);
        let lens = Lens::new(&camera(coefficients, DMat3::IDENTITY)).unwrap();
        assert!(lens.source_of(100.0 + 100.0 * 0.99_f64.tan(), 50.0).is_some());
        assert!(lens.source_of(100.0 + 100.0 * 1.01_f64.tan(), 50.0).is_none());
        assert_eq!(fold(&[0.0; 4]), PI);
        for absurd in [[f64::MAX; 4], [-f64::MAX; 4], [1e300, -1e300, 1e300, -1e300]] {
            let lens = Lens::new(&camera(absurd, DMat3::IDENTITY)).unwrap();
            assert!(lens.source_of(0.0, 0.0).is_none_or(|at| at.iter().any(|v| v.is_nan() || v.abs() > 1e9)));
        }
    }
}
