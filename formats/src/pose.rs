//! Rigid transforms, in f64.

use std::ops::Mul;

use glam::{DMat3, DVec3};

/// Largest deviation of `R^T R` from the identity, and of `det R` from 1, that still counts as a rotation.
pub const RIGID_TOLERANCE: f64 = 1e-4;

/// Rigid transform `a_from_b`: `p_a = rotation * p_b + translation` (metres).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    rotation: DMat3,
    translation: DVec3,
}

impl Pose {
    /// The transform of a frame to itself.
    pub const IDENTITY: Self = Self { rotation: DMat3::IDENTITY, translation: DVec3::ZERO };

    /// A pose from a rotation and a translation that are already known to be rigid and finite.
    pub const fn new(rotation: DMat3, translation: DVec3) -> Self {
        Self { rotation, translation }
    }

    /// A pose from the rows of a 4x4 matrix.
    ///
    /// # Errors
    /// A sentence that says what was found: a non-finite entry, a last row other than `0 0 0 1`, or a left upper
    /// block that is no rotation within [`RIGID_TOLERANCE`].
    pub fn from_rows(rows: &[[f64; 4]; 4]) -> Result<Self, String> {
        if let Some((r, c)) = (0..16).map(|k| (k / 4, k % 4)).find(|&(r, c)| !rows[r][c].is_finite()) {
            return Err(format!("row {r} column {c} is {}", rows[r][c]));
        }
        if rows[3] != [0.0, 0.0, 0.0, 1.0] {
            return Err(format!("last row is {:?}", rows[3]));
        }
        let rotation = DMat3::from_cols_array_2d(&[0, 1, 2].map(|c| [rows[0][c], rows[1][c], rows[2][c]]));
        let residual = rotation.transpose() * rotation - DMat3::IDENTITY;
        let skew = residual.to_cols_array().iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        let determinant = rotation.determinant();
        if skew > RIGID_TOLERANCE || (determinant - 1.0).abs() > RIGID_TOLERANCE {
            return Err(format!("not rigid: |R^T R - I| = {skew:.3e}, det R = {determinant:.6}"));
        }
        Ok(Self { rotation, translation: DVec3::new(rows[0][3], rows[1][3], rows[2][3]) })
    }

    /// The rows of the 4x4 matrix.
    pub fn rows(&self) -> [[f64; 4]; 4] {
        let (r, t) = (self.rotation, self.translation);
        let row = |i: usize| [r.col(0)[i], r.col(1)[i], r.col(2)[i], t[i]];
        [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
    }

    /// `b_from_a` of an `a_from_b`.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self { rotation, translation: -(rotation * self.translation) }
    }

    /// The point `p_b` (metres) in frame a.
    pub fn transform_point(&self, point: DVec3) -> DVec3 {
        self.rotation * point + self.translation
    }

    /// The rotation part of `a_from_b`.
    pub const fn rotation(&self) -> DMat3 {
        self.rotation
    }

    /// The origin of b in frame a (metres).
    pub const fn translation(&self) -> DVec3 {
        self.translation
    }
}

impl Mul for Pose {
    type Output = Self;

    /// `a_from_c = a_from_b * b_from_c`.
    fn mul(self, b_from_c: Self) -> Self {
        Self { rotation: self.rotation * b_from_c.rotation, translation: self.transform_point(b_from_c.translation) }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn pose((axis, angle, translation): ([f64; 3], f64, [f64; 3])) -> Pose {
        let axis = DVec3::from(axis).try_normalize().unwrap_or(DVec3::X);
        Pose::new(DMat3::from_axis_angle(axis, angle), DVec3::from(translation))
    }

    prop_compose! {
        fn any_pose()(
            axis in prop::array::uniform3(-1.0_f64..1.0),
            angle in -3.2_f64..3.2,
            translation in prop::array::uniform3(-1e3_f64..1e3),
        ) -> Pose {
            pose((axis, angle, translation))
        }
    }

    proptest! {
        #[test]
        fn rows_hold_the_pose_to_the_bit(pose in any_pose()) {
            prop_assert_eq!(Pose::from_rows(&pose.rows()), Ok(pose));
        }

        #[test]
        fn a_pose_and_its_inverse_leave_points_where_they_are(pose in any_pose(), p in prop::array::uniform3(-1e3_f64..1e3)) {
            let p = DVec3::from(p);
            prop_assert!(pose.inverse().transform_point(pose.transform_point(p)).distance(p) < 1e-9);
            prop_assert!((pose.inverse() * pose).transform_point(p).distance(p) < 1e-9);
        }

        #[test]
        fn a_product_applies_its_right_side_first(a in any_pose(), b in any_pose(), p in prop::array::uniform3(-1e3_f64..1e3)) {
            let p = DVec3::from(p);
            prop_assert!((a * b).transform_point(p).distance(a.transform_point(b.transform_point(p))) < 1e-9);
        }
    }

    #[test]
    fn rows_that_are_no_rigid_pose_are_refused_with_what_was_found() {
        let with = |row: usize, column: usize, value: f64| {
            let mut rows = Pose::IDENTITY.rows();
            rows[row][column] = value;
            Pose::from_rows(&rows)
        };
        assert_eq!(with(1, 3, 7.0).unwrap().translation(), DVec3::new(0.0, 7.0, 0.0));
        assert_eq!(with(2, 1, f64::NAN).unwrap_err(), "row 2 column 1 is NaN");
        assert_eq!(with(0, 3, f64::INFINITY).unwrap_err(), "row 0 column 3 is inf");
        assert_eq!(with(3, 0, 0.5).unwrap_err(), "last row is [0.5, 0.0, 0.0, 1.0]");
        assert!(with(0, 0, 1.001).unwrap_err().starts_with("not rigid: "));
        assert!(with(0, 1, 1e-3).unwrap_err().starts_with("not rigid: "));
        assert!(with(2, 2, -1.0).unwrap_err().ends_with("det R = -1.000000"));
        assert!(with(0, 1, 5e-5).is_ok());
    }
}
