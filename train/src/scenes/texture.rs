//! Band-limited procedural patterns: value noise and box-filtered stripes. `footprint` is the width of a pixel on the
//! surface, in the unit of the coordinates; what is finer fades to its mean.

use super::maths::{cell, hash_x, hash_y, mix, mixed, smoothstep, unit};

/// Smooth value noise in -1..1 with one cell per unit.
pub(crate) fn noise(u: f32, v: f32, seed: u32) -> f32 {
    let (i, j) = (cell(u), cell(v));
    let (fu, fv) = (u - i as f32, v - j as f32);
    let (su, sv) = (fu * fu * (3.0 - 2.0 * fu), fv * fv * (3.0 - 2.0 * fv));
    let (left, right) = (hash_x(i), hash_x(i.wrapping_add(1)));
    let (lower, upper) = (hash_y(j, seed), hash_y(j.wrapping_add(1), seed));
    let corner = |x, y| unit(mixed(x ^ y));
    let near = mix(corner(left, lower), corner(right, lower), su);
    let far = mix(corner(left, upper), corner(right, upper), su);
    2.0 * mix(near, far, sv) - 1.0
}

/// Share of detail with `frequency` features per unit that survives a pixel of this footprint.
pub(crate) fn survives(frequency: f32, footprint: f32) -> f32 {
    1.0 - smoothstep(0.3, 0.9, frequency * footprint)
}

/// A sum of octaves of noise in about -1..1: the first has `frequency` cells per unit, each next one twice as many
/// and 0.6 of the amplitude.
pub(crate) fn octaves(u: f32, v: f32, frequency: f32, num_octaves: u32, footprint: f32, seed: u32) -> f32 {
    let (mut sum, mut amplitude, mut f) = (0.0, 0.55, frequency);
    for octave in 0..num_octaves {
        let kept = survives(f, footprint);
        if kept <= 0.0 {
            break;
        }
        sum += amplitude * kept * noise(u * f, v * f, seed.wrapping_add(octave));
        f *= 2.03;
        amplitude *= 0.6;
    }
    sum
}

/// Part of a pixel of width `footprint` around `x` that lies in `low..high`.
pub(crate) fn pulse(x: f32, low: f32, high: f32, footprint: f32) -> f32 {
    let w = footprint.max(1e-4);
    let inside = (x + 0.5 * w).min(high) - (x - 0.5 * w).max(low);
    (inside / w).clamp(0.0, 1.0)
}

/// Part of a pixel around `x` that lies in stripes of `width` starting at every multiple of `period`.
pub(crate) fn stripes(x: f32, period: f32, width: f32, footprint: f32) -> f32 {
    // Integral of the stripes from 0 to x, differenced over the pixel.
    let integral = |x: f32| {
        let turns = cell(x / period) as f32;
        turns * width + (x - turns * period).min(width)
    };
    let w = footprint.max(1e-4);
    ((integral(x + 0.5 * w) - integral(x - 0.5 * w)) / w).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_continuous_and_varied() {
        let (mut low, mut high) = (1.0_f32, -1.0_f32);
        for k in 0..2000_u16 {
            let u = f32::from(k) * 0.037;
            let value = noise(u, 3.3, 5);
            assert!((noise(u + 1e-4, 3.3, 5) - value).abs() < 2e-3);
            low = low.min(value);
            high = high.max(value);
        }
        assert!(low < -0.7 && high > 0.7);
    }

    #[test]
    fn stripes_fade_to_their_mean_and_are_sharp_nearby() {
        assert!((stripes(0.33, 0.1, 0.02, 5.0) - 0.2).abs() < 0.01);
        assert!(stripes(1.01, 0.5, 0.1, 0.001) > 0.999);
        assert_eq!(stripes(-0.2, 0.5, 0.1, 0.001), 0.0);
        assert!((stripes(1.0, 0.5, 0.1, 0.02) - 0.5).abs() < 1e-3);
    }

    #[test]
    fn octaves_vanish_under_a_wide_pixel() {
        assert_eq!(octaves(3.7, 1.2, 4.0, 4, 10.0, 1), 0.0);
        assert!(pulse(0.5, 0.0, 1.0, 0.1) == 1.0 && pulse(1.0, 0.0, 1.0, 0.1) > 0.49);
    }
}
