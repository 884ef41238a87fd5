//! Elementary functions whose results are the same bits on every machine (libm's software versions instead of the
//! platform's), and the few numeric conversions that scenes need.

use glam::{DMat3, DVec3, Mat3, Vec3};
pub(crate) use lgs_formats::casts::{to_f32, to_f32 as narrow};

/// Sine and cosine of `angle` radians.
pub(crate) fn sin_cos(angle: f64) -> (f64, f64) {
    libm::sincos(angle)
}

/// The rotation about z that turns x towards y by `yaw` radians.
pub(crate) fn rotation_z(yaw: f64) -> DMat3 {
    let (s, c) = sin_cos(yaw);
    DMat3::from_cols(DVec3::new(c, s, 0.0), DVec3::new(-s, c, 0.0), DVec3::Z)
}

/// The rotation about y that turns x down (towards -z) by `pitch` radians.
pub(crate) fn rotation_y(pitch: f64) -> DMat3 {
    let (s, c) = sin_cos(pitch);
    DMat3::from_cols(DVec3::new(c, 0.0, -s), DVec3::Y, DVec3::new(s, 0.0, c))
}

/// The rotation about x that turns y towards z by `roll` radians.
pub(crate) fn rotation_x(roll: f64) -> DMat3 {
    let (s, c) = sin_cos(roll);
    DMat3::from_cols(DVec3::X, DVec3::new(0.0, c, s), DVec3::new(0.0, -s, c))
}

/// The vector rounded to f32.
pub(crate) const fn narrow3(v: DVec3) -> Vec3 {
    Vec3::new(to_f32(v.x), to_f32(v.y), to_f32(v.z))
}

/// The matrix rounded to f32.
pub(crate) fn narrow_mat(m: DMat3) -> Mat3 {
    Mat3::from_cols(narrow3(m.x_axis), narrow3(m.y_axis), narrow3(m.z_axis))
}

/// The index of the unit cell that holds `value`: its floor, saturating.
#[expect(clippy::cast_possible_truncation, reason = "`as` saturates, and cells beyond i32 are not told apart")]
pub(crate) fn cell(value: f32) -> i32 {
    // `f32::floor` is a function call where the baseline instruction set has no rounding.
    let truncated = value as i32;
    truncated.saturating_sub(i32::from(truncated as f32 > value))
}

/// `value` without its fraction as a count; zero for what is negative.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates at both ends")]
pub(crate) fn count(value: f64) -> usize {
    value.floor() as usize
}

/// 0 at `a` and before, 1 at `b` and after, a smooth cubic between; `a` may be the larger one.
pub(crate) fn smoothstep(a: f32, b: f32, x: f32) -> f32 {
    let t = ((x - a) / (b - a)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// `a` at 0, `b` at 1.
pub(crate) fn mix(a: f32, b: f32, t: f32) -> f32 {
    a + (b - a) * t
}

/// 32 well mixed bits of a lattice cell.
pub(crate) const fn hash(x: i32, y: i32, seed: u32) -> u32 {
    mixed(hash_x(x) ^ hash_y(y, seed))
}

/// The share of [`hash`] that depends on `x`: [`mixed`] of both shares' exclusive or is the hash.
pub(crate) const fn hash_x(x: i32) -> u32 {
    x.cast_unsigned().wrapping_mul(0x9E37_79B1)
}

/// The share of [`hash`] that depends on `y` and the seed.
pub(crate) const fn hash_y(y: i32, seed: u32) -> u32 {
    y.cast_unsigned().wrapping_mul(0x85EB_CA77).rotate_left(13).wrapping_add(seed.wrapping_mul(0xC2B2_AE3D))
}

/// The bits after each has touched all higher ones twice.
pub(crate) const fn mixed(bits: u32) -> u32 {
    let h = (bits ^ (bits >> 16)).wrapping_mul(0x7FEB_352D);
    let h = (h ^ (h >> 15)).wrapping_mul(0x846C_A68B);
    h ^ (h >> 16)
}

/// A value in 0..1 of 32 bits.
pub(crate) const fn unit(bits: u32) -> f32 {
    (bits >> 8) as f32 * (1.0 / 16_777_216.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotations_turn_the_way_their_docs_say() {
        let quarter = std::f64::consts::FRAC_PI_2;
        assert!((rotation_z(quarter) * DVec3::X - DVec3::Y).length() < 1e-12);
        assert!((rotation_y(quarter) * DVec3::X + DVec3::Z).length() < 1e-12);
        assert!((rotation_x(quarter) * DVec3::Y - DVec3::Z).length() < 1e-12);
    }

    #[test]
    fn cells_are_floors() {
        for value in [-2.0_f32, -1.5, -0.1, -0.0, 0.0, 0.9, 1.0, 7.25, -1e6] {
            assert_eq!(f64::from(cell(value)), f64::from(value).floor());
        }
        assert_eq!((cell(1e20), cell(-1e20), cell(f32::NAN)), (i32::MAX, i32::MIN, 0));
    }

    #[test]
    fn hashed_cells_are_spread_evenly() {
        let n = 200;
        let mean: f32 = (0..n * n).map(|i| unit(hash(i % n, i / n, 7))).sum::<f32>() / (n * n) as f32;
        assert!((mean - 0.5).abs() < 0.01, "mean {mean}");
        assert_ne!(hash(1, 2, 3), hash(2, 1, 3));
    }
}
