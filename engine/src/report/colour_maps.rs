//! Colour maps: a value in 0..=1 to a colour whose lightness follows it.

use lgs_formats::image::to_byte;

/// A perceptually even colour map, as a polynomial per channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ColourMap {
    /// `[7, 3]`: coefficient of `x^0`, `x^1`, ... of red, green, blue.
    coefficients: [[f32; 3]; 7],
}

/// Black over purple and orange to pale yellow.
///
/// # Source
/// matplotlib's `inferno` (CC0), in the polynomial fit of M. Zucker (CC0).
pub(super) const INFERNO: ColourMap = ColourMap {
    coefficients: [
        [0.000_218_940_37, 0.001_651_004_6, -0.019_480_899],
        [0.106_513_42, 0.563_956_44, 3.932_712_4],
        [11.602_493, -3.972_854, -15.942_394],
        [-41.703_995, 17.436_4, 44.354_145],
        [77.162_93, -33.402_36, -81.807_31],
        [-71.319_43, 32.626_064, 73.209_52],
        [25.131_126, -12.242_669, -23.070_325],
    ],
};

/// Purple over green to yellow.
///
/// # Source
/// matplotlib's `viridis` (CC0), in the polynomial fit of M. Zucker (CC0).
pub(super) const VIRIDIS: ColourMap = ColourMap {
    coefficients: [
        [0.277_727_34, 0.005_407_344_4, 0.334_099_8],
        [0.105_093_04, 1.404_613_5, 1.384_590_2],
        [-0.330_861_84, 0.214_847_56, 0.095_095_165],
        [-4.634_230_5, -5.799_101, -19.332_441],
        [6.228_27, 14.179_934, 56.690_55],
        [4.776_385, -13.745_145, -65.353_04],
        [-5.435_456, 4.645_852_6, 26.312_435],
    ],
};

impl ColourMap {
    /// The colour of `value`, which is brought into 0..=1 first; what is not a number gets that of 0.
    pub(super) fn colour(&self, value: f32) -> [u8; 3] {
        let x = if value.is_nan() { 0.0 } else { value.clamp(0.0, 1.0) };
        std::array::from_fn(|k| to_byte(self.coefficients.iter().rev().fold(0.0, |sum, row| sum * x + row[k])))
    }

    /// The map as a CSS gradient from 0 to 1 towards a side.
    pub(super) fn css_gradient(&self, side: &str) -> String {
        let stops: Vec<String> = (0_u8..=16)
            .map(|k| {
                let [r, g, b] = self.colour(f32::from(k) / 16.0);
                format!("rgb({r},{g},{b})")
            })
            .collect();
        format!("linear-gradient(to {side},{})", stops.join(","))
    }
}

#[cfg(test)]
mod tests {
    use super::{ColourMap, INFERNO, VIRIDIS};

    fn luminance(map: ColourMap, step: u8) -> f32 {
        let [r, g, b] = map.colour(f32::from(step) / 255.0).map(f32::from);
        0.2126 * r + 0.7152 * g + 0.0722 * b
    }

    #[test]
    fn lightness_rises_with_the_value() {
        for map in [INFERNO, VIRIDIS] {
            let all: Vec<f32> = (0..=255).map(|step| luminance(map, step)).collect();
            let worst = all.windows(2).map(|pair| pair[1] - pair[0]).fold(f32::INFINITY, f32::min);
            assert!(worst > -1.0, "luminance falls by {}", -worst);
            assert!(all[255] - all[0] > 150.0);
        }
    }

    #[test]
    fn ends_are_those_of_the_originals_and_strange_values_have_a_colour() {
        let near = |got: [u8; 3], want: [u8; 3]| got.iter().zip(want).all(|(&g, w)| g.abs_diff(w) <= 8);
        assert!(near(INFERNO.colour(0.0), [0, 0, 4]) && near(INFERNO.colour(1.0), [252, 255, 164]));
        assert!(near(VIRIDIS.colour(0.0), [68, 1, 84]) && near(VIRIDIS.colour(1.0), [253, 231, 37]));
        assert_eq!(INFERNO.colour(f32::NAN), INFERNO.colour(0.0));
        assert_eq!(INFERNO.colour(f32::INFINITY), INFERNO.colour(1.0));
    }
}
