//! The columns of an SPZ file before they are compressed.

use std::f32::consts::FRAC_1_SQRT_2;

/// What a file begins with, and the version that these columns are of.
const MAGIC: [u8; 4] = *b"NGSP";
const VERSION: u32 = 3;
/// Bits of a position behind the point.
const FRACTION_BITS: u8 = 12;
/// Steps of a log scale in one.
const SCALE_STEPS: f32 = 16.0;
/// The log scale that is stored as 0.
const LEAST_SCALE: f32 = -10.0;
/// What the colours are multiplied by before they become bytes around the middle: higher bands of the harmonics may bring more back.
const COLOUR_FACTOR: f32 = 0.15;
/// Largest magnitude of a component of a rotation: 9 bits, beside which stands the sign.
const MOST: u32 = 0x1ff;

/// A splat in the axes of the file.
#[derive(Clone, Copy, Debug)]
pub(super) struct Splat {
    /// Metres.
    pub(super) position: [f32; 3],
    pub(super) log_scales: [f32; 3],
    /// x, y, z, w.
    pub(super) rotation: [f32; 4],
    pub(super) logit_opacity: f32,
    pub(super) sh_dc: [f32; 3],
}

/// The file of `count` splats: a header, then one column after the other.
pub(super) fn packed(count: i32, splats: impl Iterator<Item = Splat> + Clone) -> Vec<u8> {
    let mut bytes = Vec::new();
    bytes.extend(MAGIC);
    bytes.extend(VERSION.to_le_bytes());
    bytes.extend(count.to_le_bytes());
    bytes.extend([0, FRACTION_BITS, 0, 0]); // degree of the harmonics, fraction, flags, reserved
    bytes.extend(splats.clone().flat_map(|splat| splat.position).flat_map(fixed));
    bytes.extend(splats.clone().map(|splat| byte(255.0 / (1.0 + (-splat.logit_opacity).exp()))));
    bytes.extend(splats.clone().flat_map(|splat| splat.sh_dc).map(|v| byte(v * (COLOUR_FACTOR * 255.0) + 127.5)));
    bytes.extend(splats.clone().flat_map(|splat| splat.log_scales).map(|v| byte((v - LEAST_SCALE) * SCALE_STEPS)));
    bytes.extend(splats.flat_map(|splat| smallest_three(splat.rotation)));
    bytes
}

/// A coordinate as a 24-bit number with 12 bits behind the point.
#[expect(clippy::cast_possible_truncation, reason = "what lies out of reach is left out before")]
fn fixed(value: f32) -> [u8; 3] {
    let [a, b, c, _] = ((value * f32::from(1_u16 << FRACTION_BITS)).round() as i32).to_le_bytes();
    [a, b, c]
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0..=255 after the clamp, NaN gives 0")]
fn byte(value: f32) -> u8 {
    value.clamp(0.0, 255.0).round() as u8
}

/// The rotation but for its largest component, which follows from the others: which one that is, then sign and magnitude of the others.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "magnitudes of 0 to 511, NaN gives 0")]
fn smallest_three(rotation: [f32; 4]) -> [u8; 4] {
    let unit = unit(rotation);
    let mut largest = 0;
    for (i, value) in unit.iter().enumerate() {
        if value.abs() > unit[largest].abs() {
            largest = i;
        }
    }
    let mut bits = largest as u32;
    for (_, value) in unit.iter().enumerate().filter(|&(i, _)| i != largest) {
        // A rotation and its negative are the same: the largest component counts as positive.
        let sign = u32::from((*value < 0.0) != (unit[largest] < 0.0));
        let magnitude = (511.0 * (value.abs() / FRAC_1_SQRT_2) + 0.5).floor() as u32;
        bits = bits << 10 | sign << 9 | magnitude.min(MOST);
    }
    bits.to_le_bytes()
}

fn unit(q: [f32; 4]) -> [f32; 4] {
    let square = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
    if square < f32::EPSILON {
        return [0.0, 0.0, 0.0, 1.0];
    }
    q.map(|v| v * (1.0 / square.sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What the crate `spz` 0.0.6 makes of the splats below, at the limits of the format and beyond.
    #[rustfmt::skip]
    const WANTED: [u8; 96] = [
        78, 71, 83, 80, 3, 0, 0, 0, 4, 0, 0, 0, 0, 12, 0, 0,
        0, 224, 255, 0, 48, 0, 0, 240, 255, 0, 252, 255, 0, 240, 124, 0, 72, 1, 0, 0, 0, 255, 255, 255, 0, 240, 127, 85, 5, 0, 171, 250, 255, 0, 0, 0,
        159, 0, 255, 128,
        143, 89, 173, 0, 128, 255, 254, 1, 128, 166, 108, 137,
        144, 128, 107, 0, 0, 160, 255, 254, 0, 88, 90, 86,
        222, 80, 170, 196, 222, 82, 170, 36, 0, 0, 0, 192, 76, 196, 92, 110,
    ];

    #[test]
    fn the_columns_are_those_of_another_writer() {
        let splat = |position, log_scales, rotation, logit_opacity, sh_dc| Splat {
            position,
            log_scales,
            rotation,
            logit_opacity,
            sh_dc,
        };
        let splats = [
            splat([-2.0, 3.0, -1.0], [-1.03, -2.0, -3.3], [0.1, -0.2, 0.3, 0.9], 0.5, [0.4, -1.0, 1.2]),
            splat([-0.25, 1999.0, 20.5], [-20.0, -10.0, 0.0], [-0.9, 0.1, 0.2, 0.3], -9.0, [-9.0, 0.0, 9.0]),
            splat([0.0001, -0.0002, 2047.0], [6.0, 5.9, -9.97], [0.0; 4], 9.0, [3.3, -3.3, 0.01]),
            splat([1.0 / 3.0, -1.0 / 3.0, -0.0], [-4.5, -4.4, -4.6], [0.3, -0.8, 0.4, -0.1], 0.0, [1.0, -0.5, 0.25]),
        ];
        assert_eq!(packed(4, splats.into_iter()), WANTED);
    }
}
