//! How coarse the scene is that a network or an optimisation begins with.

use std::{fmt, str::FromStr};

use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

/// Steps of a coarseness in a whole one.
const STEPS: f64 = 1000.0;
/// Largest coarseness.
const MOST: f64 = 8.0;
/// Pixels of an image for which the tolerances hold as they are. Held-out PSNR of images of 2 million pixels at the factor that this gives and
/// at 1: 25.88 and 25.89 dB, 26.77 and 26.76, 33.01 and 33.01, 22.06 and 21.98, 19.66 and 19.43, with a third of the Gaussians less; images of
/// half a million lose 0.1 dB at twice the factor.
pub(super) const USUAL_PIXELS: f64 = 524_288.0;
/// Pixels of an image below which tolerances shrink no further. Held-out PSNR of eight clips of 0.12 to 0.15 million pixels, the mean, at the factors
/// 1, 0.7 and 0.5: 26.16, 26.26 and 26.26 dB, with 12 and 24 % more Gaussians than at 1.
const FEWEST_PIXELS: f64 = 262_144.0;

/// How different, times the usual, the pixels or returns may be that one Gaussian stands for, and above 1 how many they may be, too: 0 to
/// 8, in thousandths. At 0 every return and every uncovered pixel has a Gaussian of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Coarseness(u32);

impl Coarseness {
    /// One Gaussian for every return and every uncovered pixel.
    pub const FINEST: Self = Self(0);

    /// Factor by which tolerances and sizes are multiplied.
    pub fn factor(self) -> f32 {
        lgs_formats::casts::to_f32(f64::from(self.0) / STEPS)
    }

    /// That of an image of so many pixels: what is as large in the scene is more pixels of a larger image, and the more of them show a place the
    /// less of their detail is in the same place in the next image.
    ///
    /// # Formula
    /// `factor sqrt(max(pixels, 2^18) / 2^19)`
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most some thousand times 8000")]
    pub(super) fn of_image(self, pixels: usize) -> Self {
        let wider = ((pixels as f64).max(FEWEST_PIXELS) / USUAL_PIXELS).sqrt();
        Self((f64::from(self.0) * wider).round() as u32)
    }

    /// Largest number of pixels, of `usual` ones, beside each other that one Gaussian stands for: one where there is no tolerance, more than
    /// usual where there is more.
    pub(super) fn most(self, usual: f32) -> f32 {
        if self == Self::FINEST { 1.0 } else { usual * self.factor().max(1.0) }
    }

    /// Largest variance of the colours of so many pixels around their mean. It falls with the root of their number: what is spread over more
    /// pixels is seen more easily.
    ///
    /// # Formula
    /// `(factor usual)^2 / sqrt(pixels / 4)`, `usual` the root mean square for four pixels.
    pub(super) fn colour_variance(self, usual: f32, pixels: f32) -> f32 {
        let most = self.factor() * usual;
        most * most / (pixels / 4.0).sqrt()
    }

    /// The coarseness nearest to a number; `None` beyond 0 to 8 and for what is no number.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 to 8000")]
    pub fn new(factor: f64) -> Option<Self> {
        (0.0..=MOST).contains(&factor).then(|| Self((factor * STEPS).round() as u32))
    }

    /// Whether it is the usual one.
    pub fn is_usual(&self) -> bool {
        *self == Self::default()
    }
}

impl Default for Coarseness {
    fn default() -> Self {
        Self(1000)
    }
}

impl fmt::Display for Coarseness {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", f64::from(self.0) / STEPS)
    }
}

impl FromStr for Coarseness {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parsed = text.parse().ok().and_then(Self::new);
        parsed.ok_or_else(|| format!("expected a number from 0 to {MOST}, found {text}"))
    }
}

impl Serialize for Coarseness {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        (f64::from(self.0) / STEPS).serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Coarseness {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let factor = f64::deserialize(deserializer)?;
        Self::new(factor).ok_or_else(|| D::Error::custom(format!("expected 0 to {MOST}, found {factor}")))
    }
}

#[cfg(test)]
mod tests {
    use super::Coarseness;

    #[test]
    fn what_is_written_is_read() {
        for text in ["0", "0.25", "1", "1.001", "8"] {
            let read: Coarseness = text.parse().unwrap();
            assert_eq!(read.to_string(), text);
            let json = serde_json::to_string(&read).unwrap();
            assert_eq!(serde_json::from_str::<Coarseness>(&json).unwrap(), read);
        }
        assert_eq!("1".parse(), Ok(Coarseness::default()));
        assert_eq!("0".parse(), Ok(Coarseness::FINEST));
    }

    #[test]
    fn larger_images_are_as_coarse_by_angle() {
        let usual = Coarseness::default();
        assert_eq!(
            [1, 1 << 18, 1 << 19, 1 << 21].map(|pixels| usual.of_image(pixels).factor()),
            [0.707, 0.707, 1.0, 2.0]
        );
        assert_eq!(Coarseness::FINEST.of_image(1 << 24), Coarseness::FINEST);
    }

    #[test]
    fn what_is_none_is_refused() {
        for text in ["-0.1", "8.001", "nan", "inf", "", "1x"] {
            assert!(text.parse::<Coarseness>().is_err(), "{text}");
        }
        assert!(serde_json::from_str::<Coarseness>("-1").is_err());
    }
}
