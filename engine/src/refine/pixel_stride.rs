//! Which pixels of the images a step looks at.

use std::{fmt, num::NonZeroUsize, str::FromStr};

use lgs_formats::image::PixelLabel;
use serde::{Deserialize, Serialize};

use crate::parallel;
use crate::views::View;

/// Most that anybody may ask for.
const MOST: usize = 64;
/// Largest stride that is chosen.
const MOST_CHOSEN: usize = 2;
/// Least PSNR with which the pixels that are left out follow from those that are drawn, decibels. Scenes of real drives come to 20 to 30 dB in new
/// views: what is finer than that they do not show. `measure/NEEDS.md` has what a stride of 2 costs by this figure.
const ENOUGH_DB: f64 = 30.0;

/// How far apart the pixels are that a step of a refinement draws, in columns and in rows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum PixelStride {
    /// 2 where the images are so smooth, or so large, that the pixels in between follow from those that are drawn; else 1.
    #[default]
    Auto,
    /// So many pixels.
    Every(NonZeroUsize),
}

impl PixelStride {
    /// Every pixel.
    pub const ALL: Self = Self::Every(NonZeroUsize::MIN);

    /// Whether it is as usual.
    pub(crate) fn is_auto(&self) -> bool {
        *self == Self::Auto
    }

    /// The distance for these views, pixels.
    pub fn of(self, views: &[&View]) -> usize {
        match self {
            Self::Every(stride) => stride.get(),
            Self::Auto => {
                let is_enough = |stride: &usize| follows_db(views, *stride) >= ENOUGH_DB;
                (2..=MOST_CHOSEN).take_while(is_enough).last().unwrap_or(1)
            }
        }
    }
}

impl FromStr for PixelStride {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let count = || text.parse().ok().filter(|count: &NonZeroUsize| count.get() <= MOST);
        match text {
            "auto" => Ok(Self::Auto),
            _ => count()
                .map(Self::Every)
                .ok_or_else(|| format!("expected auto or a number from 1 to {MOST}, found {text}")),
        }
    }
}

impl TryFrom<String> for PixelStride {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<PixelStride> for String {
    fn from(stride: PixelStride) -> Self {
        stride.to_string()
    }
}

impl fmt::Display for PixelStride {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Every(stride) => stride.fmt(f),
        }
    }
}

/// PSNR of the pixels that a stride leaves out, each taken as the bilinear mean of those around it that the stride draws, decibels; infinite where
/// none differs. Ignored pixels do not count.
fn follows_db(views: &[&View], stride: usize) -> f64 {
    let (mut square, mut count) = (0.0, 0.0);
    for view in views {
        let rows = view.pinhole.height.saturating_sub(1) / stride * stride;
        let sums = parallel::map(rows, 16, &|row| row_error(view, row, stride));
        square += sums.iter().map(|sum| sum[0]).sum::<f64>();
        count += sums.iter().map(|sum| sum[1]).sum::<f64>();
    }
    if square > 0.0 { 10.0 * (count / square).log10() } else { f64::INFINITY }
}

/// The sum of squares and the number of values of a row.
fn row_error(view: &View, row: usize, stride: usize) -> [f64; 2] {
    let width = view.pinhole.width;
    let is_ignored = |pixel: usize| view.labels.as_ref().is_some_and(|labels| labels[pixel] == PixelLabel::Ignored);
    let (above, down) = (row / stride * stride, row % stride);
    let share = |part: usize| part as f32 / stride as f32;
    let mut sums = [0.0; 2];
    for column in 0..width.saturating_sub(1) / stride * stride {
        let (left, right) = (column / stride * stride, column % stride);
        if (down == 0 && right == 0) || is_ignored(row * width + column) {
            continue;
        }
        for channel in 0..3 {
            let at = |row: usize, column: usize| view.image.data[3 * (row * width + column) + channel];
            let line = |row: usize| at(row, left) + share(right) * (at(row, left + stride) - at(row, left));
            let followed = line(above) + share(down) * (line(above + stride) - line(above));
            sums[0] += f64::from(at(row, column) - followed).powi(2);
            sums[1] += 1.0;
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gaussians::physical::Splat;
    use crate::render::render;
    use crate::views::samples::{ahead, seen};
    use crate::views::{PinholeView, Shutter, strided};
    use lgs_formats::camera_motion::CameraMotion;
    use lgs_formats::pose::Pose;

    fn waves(step: f32) -> View {
        let pinhole = ahead(40, 30, 30.0);
        let value = |i: usize| 0.5 + 0.4 * (step * (i % 40) as f32).sin() * (step * (i / 40) as f32).cos();
        seen(pinhole, (0..40 * 30).flat_map(|i| [value(i); 3]).collect())
    }

    #[test]
    fn fine_images_are_seen_by_every_pixel_and_smooth_ones_by_some() {
        let (smooth, fine) = (waves(0.2), waves(1.5));
        assert_eq!([&smooth, &fine].map(|view| PixelStride::Auto.of(&[view])), [2, 1]);
        // Together they are as fine as the worse of them, nearly.
        assert_eq!(PixelStride::Auto.of(&[&smooth, &fine]), 1);
        assert_eq!(PixelStride::ALL.of(&[&smooth]), 1);
        // What is ignored is not looked at.
        let ignored = View { labels: Some(vec![PixelLabel::Ignored; 40 * 30]), ..fine };
        assert_eq!(PixelStride::Auto.of(&[&smooth, &ignored]), 2);
    }

    #[test]
    fn a_plane_follows_from_its_corners() {
        let plane =
            seen(ahead(9, 7, 8.0), (0..63).flat_map(|i| [0.02 * (i % 9) as f32 + 0.05 * (i / 9) as f32; 3]).collect());
        assert!([2, 3, 4].iter().all(|&stride| follows_db(&[&plane], stride) > 120.0));
        // A row of one pixel has nothing between.
        assert_eq!(follows_db(&[&seen(ahead(1, 1, 8.0), vec![0.5; 3])], 2), f64::INFINITY);
    }

    #[test]
    fn strides_are_read_as_they_are_written() {
        for text in ["auto", "1", "64"] {
            let stride: PixelStride = text.parse().unwrap();
            assert_eq!(stride.to_string(), text);
            assert_eq!(serde_json::from_str::<PixelStride>(&serde_json::to_string(&stride).unwrap()).unwrap(), stride);
        }
        for text in ["0", "65", "every", ""] {
            assert!(text.parse::<PixelStride>().unwrap_err().contains("from 1 to 64"), "{text}");
        }
    }

    /// What some of the pixels show is what they show among all: with a rolling shutter too.
    #[test]
    fn pixels_that_are_drawn_are_those_of_the_whole_image() {
        let still = ahead(62, 46, 50.0);
        let motion = CameraMotion { turn: [0.0, 0.3, 0.1].into(), velocity: [1.0, 0.0, 9.0].into() };
        let shutter = Shutter::new([-0.015, 0.0, 0.03], [62, 46], &motion, &Pose::IDENTITY);
        let at = |i: usize, salt: f32| (i as f32 * 78.233 + salt).sin() * 43_758.547 % 1.0;
        let splat = |i: usize| Splat {
            mean: [3.0 * at(i, 0.1), 2.0 * at(i, 0.7), 4.5 + 2.0 * at(i, 1.3)],
            quat: [1.0, at(i, 2.0), 0.3, 0.0],
            scale: [0.04, 0.1, 0.02],
            opacity: 0.1 + 0.8 * at(i, 5.0).abs(),
            colour: [at(i, 6.0).abs(), 0.5, at(i, 7.0).abs()],
            ..Splat::default()
        };
        let splats: Vec<Splat> = (0..300).map(splat).collect();
        for pinhole in [still, PinholeView { shutter: Some(shutter), ..still }] {
            let whole = render(&splats, &pinhole, [0.1; 3]);
            let view = seen(pinhole, whole.rgb);
            for turn in 0..4 {
                let some = strided(&[&view], 2, turn).remove(0);
                let drawn = render(&splats, &some.pinhole, [0.1; 3]);
                let farthest = drawn.rgb.iter().zip(&some.image.data).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                assert!(farthest < 2e-4, "turn {turn}: {farthest}");
            }
        }
    }
}
