//! Radial and tangential distortion by Brown and Conrady.

use super::bisect;
use crate::camera::{Camera, Intrinsics};

/// A Brown-Conrady lens with the pinhole of its rectified image: the same intrinsics.
#[derive(Clone, Debug)]
pub(in crate::image) struct BrownConrady {
    intrinsics: Intrinsics,
    distortion: [f64; 5],
    /// Squared radius (in the plane z = 1) at which the radial function stops to grow.
    fold: f64,
}

impl BrownConrady {
    /// The lens with coefficients `[k1, k2, p1, p2, k3]` of a camera.
    pub(super) fn new(camera: &Camera, distortion: [f64; 5]) -> Self {
        let k = camera.intrinsics;
        let farthest =
            |size: u32, focal: f64, centre: f64| (centre / focal).abs().max((f64::from(size) - centre).abs() / focal);
        let (x, y) = (farthest(camera.width, k.fx, k.cx), farthest(camera.height, k.fy, k.cy));
        let [k1, k2, _, _, k3] = distortion;
        let fold = first_fold(k1, k2, k3, x * x + y * y);
        Self { intrinsics: k, distortion, fold }
    }

    /// The pixel of the image file that shows what pixel `(u, v)` of the rectified image shows (centres at +0.5);
    /// `None` where the model folds over: there, several rays share a pixel, and only the innermost is real.
    ///
    /// # Formula
    /// With `(x, y) = K^-1 (u, v)`, `r2 = x^2 + y^2`, `radial = 1 + k1 r2 + k2 r2^2 + k3 r2^3`:
    /// `x' = x radial + 2 p1 x y + p2 (r2 + 2 x^2)`, `y' = y radial + p1 (r2 + 2 y^2) + 2 p2 x y`.
    /// The map is valid inside the first fold of `r radial` and where its Jacobian, which is symmetric, is
    /// positive definite.
    ///
    /// # Source
    /// D. C. Brown, "Close-range camera calibration", 1971, in the coefficients and order of `OpenCV`.
    pub(super) fn source_of(&self, u: f64, v: f64) -> Option<[f64; 2]> {
        let Intrinsics { fx, fy, cx, cy } = self.intrinsics;
        let [k1, k2, p1, p2, k3] = self.distortion;
        let (x, y) = ((u - cx) / fx, (v - cy) / fy);
        let (xx, xy, yy) = (x * x, x * y, y * y);
        let r2 = xx + yy;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let slope = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3); // d radial / d r2
        let dx_dx = radial + 2.0 * xx * slope + 2.0 * p1 * y + 6.0 * p2 * x;
        let dx_dy = 2.0 * (xy * slope + p1 * x + p2 * y);
        let dy_dy = radial + 2.0 * yy * slope + 6.0 * p1 * y + 2.0 * p2 * x;
        let valid = r2 < self.fold && dx_dx > 0.0 && dx_dx * dy_dy > dx_dy * dx_dy;
        valid.then(|| {
            let x_source = x * radial + 2.0 * p1 * xy + p2 * (r2 + 2.0 * xx);
            let y_source = y * radial + p1 * (r2 + 2.0 * yy) + 2.0 * p2 * xy;
            [fx * x_source + cx, fy * y_source + cy]
        })
    }
}

/// The smallest squared radius `s` in `0..=end` at which `d(r radial)/dr = 1 + 3 k1 s + 5 k2 s^2 + 7 k3 s^3` is no
/// longer positive; infinity when there is none.
fn first_fold(k1: f64, k2: f64, k3: f64, end: f64) -> f64 {
    let growth = |s: f64| 1.0 + s * (3.0 * k1 + s * (5.0 * k2 + s * 7.0 * k3));
    // Between the roots of its derivative the polynomial is monotonic, so that a change of sign is one root.
    let mut bounds = quadratic_roots(21.0 * k3, 10.0 * k2, 3.0 * k1).map(|s| if s > 0.0 && s < end { s } else { end });
    bounds.sort_by(f64::total_cmp);
    let mut low = 0.0;
    for high in [bounds[0], bounds[1], end] {
        if growth(high) <= 0.0 {
            return bisect(growth, low, high);
        }
        low = high;
    }
    f64::INFINITY
}

/// The real roots of `a s^2 + b s + c`, NaN or infinity where there is none.
fn quadratic_roots(a: f64, b: f64, c: f64) -> [f64; 2] {
    let q = -0.5 * (b + (b * b - 4.0 * a * c).sqrt().copysign(b));
    [q / a, c / q]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        camera::{Camera, Distortion},
        image::lens::Lens,
        pose::Pose,
    };

    fn camera(distortion: [f64; 5]) -> Camera {
        Camera {
            name: "c".to_owned(),
            timestamp: 0.0,
            width: 200,
            height: 100,
            intrinsics: Intrinsics { fx: 100.0, fy: 90.0, cx: 101.0, cy: 49.0 },
            distortion: Some(Distortion::BrownConrady(distortion)),
            readout: None,
            world_from_camera: Pose::IDENTITY,
        }
    }

    #[test]
    fn no_distortion_is_no_lens() {
        assert!(Lens::new(&camera([0.0; 5])).is_none());
        assert!(Lens::new(&Camera { distortion: None, ..camera([0.0; 5]) }).is_none());
    }

    #[test]
    fn the_formula_has_opencv_order_of_coefficients() {
        let lens = Lens::new(&camera([-0.2, 0.05, 0.01, -0.02, 0.003])).unwrap();
        let [u, v] = lens.source_of(151.0, 4.0).unwrap(); // x = 0.5, y = -0.5, r2 = 0.5
        let radial = 1.0 - 0.1 + 0.0125 + 0.000_375;
        let x = 0.5 * radial - 2.0 * 0.01 * 0.25 - 0.02 * (0.5 + 0.5);
        let y = -0.5 * radial + 0.01 * (0.5 + 0.5) + 2.0 * 0.02 * 0.25;
        assert!((u - (100.0 * x + 101.0)).abs() < 1e-12 && (v - (90.0 * y + 49.0)).abs() < 1e-12, "{u} {v}");
    }

    #[test]
    fn the_fold_is_where_the_radius_is_largest() {
        // r (1 - r2 / 3) grows up to r = 1.
        assert!((first_fold(-1.0 / 3.0, 0.0, 0.0, 4.0) - 1.0).abs() < 1e-12);
        assert!(first_fold(-1.0 / 3.0, 0.0, 0.0, 0.9).is_infinite());
        assert!(first_fold(0.3, 0.1, 0.0, 9.0).is_infinite());
        // 1 + s - s^2 = 0 at the golden ratio; k2 = -1/5, k1 = 1/3.
        assert!((first_fold(1.0 / 3.0, -0.2, 0.0, 9.0) - 0.5 * (1.0 + 5.0_f64.sqrt())).abs() < 1e-12);
        // (1 - s)(2 - s)(3 - s) / 6: three roots, the first counts.
        let fold = first_fold(-11.0 / 18.0, 1.0 / 5.0, -1.0 / 42.0, 9.0);
        assert!((fold - 1.0).abs() < 1e-12, "{fold}");
    }

    #[test]
    fn what_lies_beyond_the_fold_has_no_source() {
        let lens = Lens::new(&camera([-1.0 / 3.0, 0.0, 0.0, 0.0, 0.0])).unwrap();
        assert!(lens.source_of(101.0 + 99.0, 49.0).is_some());
        assert!(lens.source_of(101.0 + 101.0, 49.0).is_none());
        assert!(lens.source_of(101.0 + 300.0, 49.0).is_none());
    }

    #[test]
    fn absurd_coefficients_give_no_source_and_no_panic() {
        for k in [[f64::MAX; 5], [-f64::MAX; 5], [1e300, -1e300, 1e300, -1e300, 1e300]] {
            let lens = Lens::new(&camera(k)).unwrap();
            assert!(
                lens.source_of(0.5, 0.5)
                    .is_none_or(|[u, v]| u.is_nan() || v.is_nan() || u.abs() > 1e9 || v.abs() > 1e9)
            );
        }
    }
}
