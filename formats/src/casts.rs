//! Conversions of numbers that may lose something, with what happens then.

/// The nearest f32; an infinity beyond its range.
#[expect(clippy::cast_possible_truncation, reason = "rounding to single precision is the purpose")]
pub const fn to_f32(value: f64) -> f32 {
    value as f32
}

/// The number in 32 bits; the largest of them for more, which no count of a scene comes to.
#[expect(clippy::cast_possible_truncation, reason = "held to the range before the cast")]
pub const fn to_u32(value: usize) -> u32 {
    if value > u32::MAX as usize { u32::MAX } else { value as u32 }
}

/// The whole part of a number; 0 for what is negative or no number, the largest for what is too large.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates at both ends")]
pub const fn whole(value: f32) -> usize {
    value as usize
}

/// The nearest whole number; 0 for what is negative or no number, the largest for what is too large.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates at both ends")]
pub fn rounded(value: f64) -> usize {
    value.round() as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_fit_is_held_to_the_ends() {
        assert_eq!((to_f32(0.1), to_f32(1e300)), (0.1_f32, f32::INFINITY));
        assert_eq!((to_u32(7), to_u32(usize::MAX)), (7, u32::MAX));
        assert_eq!((whole(2.9), whole(-1.0), whole(f32::NAN), whole(f32::INFINITY)), (2, 0, 0, usize::MAX));
        assert_eq!((rounded(2.5), rounded(-0.6), rounded(f64::NAN)), (3, 0, 0));
    }
}
