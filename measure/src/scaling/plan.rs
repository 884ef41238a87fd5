//! Which sizes are measured.

use lgs_formats::image::ImageSize;
use serde::{Deserialize, Serialize};

/// About what a return costs, in what a pixel of the input views costs; for who tells how far the work is.
const RETURN_COST: u64 = 4;
/// Input views of a clip.
const NUM_VIEWS: u64 = 6;

/// How large a clip is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Size {
    /// `LiDAR` returns of all sweeps, about.
    pub points: usize,
    /// Height of the images, pixels.
    pub height: usize,
    /// Width of the images, pixels.
    pub width: usize,
}

/// What changes from clip to clip while the rest stays.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Axis {
    /// The number of returns.
    Points,
    /// The size of the images.
    Pixels,
}

/// The sizes along both axes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Numbers of returns, at [`Plan::image_size`].
    pub points: Vec<usize>,
    /// Sizes of images, at [`Plan::num_points`].
    pub image_sizes: Vec<ImageSize>,
    /// Number of returns of the clips along the axis of pixels.
    pub num_points: usize,
    /// Size of the images of the clips along the axis of points.
    pub image_size: ImageSize,
}

impl Size {
    fn new(points: usize, ImageSize { height, width }: ImageSize) -> Self {
        Self { points, height, width }
    }

    /// About what it costs to measure, for who tells how far the work is.
    pub fn weight(&self) -> u64 {
        self.points as u64 * RETURN_COST + self.height as u64 * self.width as u64 * NUM_VIEWS
    }
}

impl std::fmt::Display for Size {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "{} points, {}x{}", self.points, self.height, self.width)
    }
}

impl Axis {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Points, Self::Pixels];

    /// Its name for people.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Points => "points",
            Self::Pixels => "pixels",
        }
    }
}

impl Plan {
    /// The sizes along an axis, ascending, each once.
    pub fn along(&self, axis: Axis) -> Vec<Size> {
        let mut sizes: Vec<Size> = match axis {
            Axis::Points => self.points.iter().map(|&points| Size::new(points, self.image_size)).collect(),
            Axis::Pixels => self.image_sizes.iter().map(|&size| Size::new(self.num_points, size)).collect(),
        };
        sizes.sort_by_key(|size| (size.weight(), size.height));
        sizes.dedup();
        sizes
    }

    /// Every size once, the cheapest first.
    pub fn sizes(&self) -> Vec<Size> {
        let mut sizes = self.along(Axis::Points);
        for size in self.along(Axis::Pixels) {
            if !sizes.contains(&size) {
                sizes.push(size);
            }
        }
        sizes.sort_by_key(Size::weight);
        sizes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_both_axes_share_is_measured_once_and_the_cheapest_comes_first() {
        let size = |height| ImageSize { height, width: 2 * height };
        let plan = Plan {
            points: vec![5000, 1000, 1000],
            image_sizes: vec![size(64), size(32), size(128)],
            num_points: 1000,
            image_size: size(64),
        };
        assert_eq!(plan.along(Axis::Points).iter().map(|s| s.points).collect::<Vec<_>>(), [1000, 5000]);
        let all: Vec<(usize, usize)> = plan.sizes().iter().map(|s| (s.points, s.height)).collect();
        assert_eq!(all, [(1000, 32), (1000, 64), (5000, 64), (1000, 128)]);
        assert_eq!(plan.sizes()[0].to_string(), "1000 points, 32x64");
    }
}
