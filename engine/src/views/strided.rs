//! Some of a view's pixels as a view of its own: every N-th of every N-th row.

use std::borrow::Cow;

use lgs_formats::image::{DepthMap, RgbImage};

use super::{DepthSample, PinholeView, View};
use crate::parallel;

/// Every `stride`-th pixel of every `stride`-th row of `views`, begun elsewhere in each view and each turn: after `stride^2` turns every pixel
/// had its own. Nothing is copied for a stride of 1.
pub(crate) fn strided<'a>(views: &[&'a View], stride: usize, turn: usize) -> Vec<Cow<'a, View>> {
    match stride {
        0 | 1 => views.iter().map(|&view| Cow::Borrowed(view)).collect(),
        _ => parallel::map(views.len(), 1, &|k| Cow::Owned(views[k].strided(stride, first_of(stride, turn + k)))),
    }
}

/// The first column and row of a turn: those of turns that follow each other are apart in both.
const fn first_of(stride: usize, turn: usize) -> [usize; 2] {
    [(turn + turn / stride) % stride, turn % stride]
}

impl PinholeView {
    /// The camera of every `stride`-th pixel of every `stride`-th row of this one, from a first column and row on. What a pixel sees stays as
    /// it is.
    fn strided(&self, stride: usize, first: [usize; 2]) -> Self {
        let (by, [left, top]) = (stride as f32, first.map(|at| at as f32 + 0.5 - 0.5 * stride as f32));
        let count = |size: usize, first: usize| (size - first).div_ceil(stride);
        Self {
            width: count(self.width, first[0]),
            height: count(self.height, first[1]),
            fx: self.fx / by,
            fy: self.fy / by,
            cx: (self.cx - left) / by,
            cy: (self.cy - top) / by,
            shutter: self.shutter.map(|shutter| shutter.cropped([left, top]).reduced(by)),
            pixel_side: self.pixel_side / by,
            ..*self
        }
    }
}

impl View {
    fn strided(&self, stride: usize, first: [usize; 2]) -> Self {
        let full = &self.pinhole;
        let [left, top] = [first[0] % full.width, first[1] % full.height];
        let pinhole = full.strided(stride, [left, top]);
        let (width, columns) = (full.width, pinhole.width);
        let taken = (0..pinhole.height)
            .flat_map(|row| (0..columns).map(move |column| (top + row * stride) * width + left + column * stride));
        let sample_of = |sample: &DepthSample| {
            let (row, column) = (sample.pixel as usize / width, sample.pixel as usize % width);
            let is_taken = row % stride == top % stride && column % stride == left % stride;
            let pixel = u32::try_from(row / stride * columns + column / stride).ok().filter(|_| is_taken)?;
            Some(DepthSample { pixel, ..*sample })
        };
        let colours = taken.clone().flat_map(|pixel| [0, 1, 2].map(|channel| self.image.data[3 * pixel + channel]));
        let depths = |map: &DepthMap| DepthMap {
            kind: map.kind,
            inverse: taken.clone().map(|pixel| map.inverse[pixel]).collect(),
        };
        Self {
            image: RgbImage { width: pinhole.width, height: pinhole.height, data: colours.collect() },
            labels: self.labels.as_ref().map(|labels| taken.clone().map(|pixel| labels[pixel]).collect()),
            depth_map: self.depth_map.as_ref().map(depths),
            depth_samples: self.depth_samples.iter().filter_map(sample_of).collect(),
            camera: self.camera.clone(),
            pinhole,
            ..*self
        }
    }
}

#[cfg(test)]
mod tests {
    use lgs_formats::clip::DepthKind;
    use lgs_formats::image::PixelLabel;

    use super::*;
    use crate::views::samples::{ahead, seen};

    /// A view whose every colour, label, depth and return tells the number of its pixel.
    fn view(width: usize, height: usize) -> View {
        let numbers = || (0_u8..).take(width * height).map(f32::from);
        let label = |number: f32| if number % 3.0 == 0.0 { PixelLabel::Dynamic } else { PixelLabel::Static };
        let sample = |(pixel, number): (u32, f32)| DepthSample { pixel, depth: 1.0 + number };
        View {
            labels: Some(numbers().map(label).collect()),
            depth_map: Some(DepthMap {
                kind: DepthKind::Metric,
                inverse: numbers().map(|number| 1.0 / (1.0 + number)).collect(),
            }),
            depth_samples: (0..).zip(numbers()).map(sample).collect(),
            ..seen(ahead(width, height, 30.0), numbers().flat_map(|number| [number; 3]).collect())
        }
    }

    #[test]
    fn every_pixel_has_its_turn_with_all_that_belongs_to_it() {
        for (width, height, stride) in [(7, 5, 2), (8, 6, 3), (4, 4, 4), (2, 1, 3)] {
            let full = view(width, height);
            let mut found = Vec::new();
            for turn in 0..stride * stride {
                let views = strided(&[&full], stride, turn);
                let some = &views[0];
                let numbers: Vec<f32> = some.image.data.chunks(3).map(|colour| colour[0]).collect();
                let (labels, depths) = (some.labels.as_ref().unwrap(), &some.depth_map.as_ref().unwrap().inverse);
                assert_eq!([numbers.len(), some.depth_samples.len()], [some.pinhole.num_pixels(); 2]);
                for (((number, label), inverse), (pixel, sample)) in
                    numbers.iter().zip(labels).zip(depths).zip((0..).zip(&some.depth_samples))
                {
                    assert_eq!(*label == PixelLabel::Dynamic, number % 3.0 == 0.0);
                    assert_eq!((sample.pixel, sample.depth, *inverse), (pixel, 1.0 + number, 1.0 / (1.0 + number)));
                }
                found.extend(numbers);
            }
            found.sort_by(f32::total_cmp);
            found.dedup();
            assert_eq!(found, full.image.data.chunks(3).map(|colour| colour[0]).collect::<Vec<f32>>());
        }
    }

    #[test]
    fn a_point_is_seen_by_the_pixel_that_saw_it() {
        let numbers = (0_u16..1200).flat_map(|number| [f32::from(number); 3]).collect();
        let full = seen(ahead(40, 30, 30.0), numbers);
        for turn in 0..9 {
            let views = strided(&[&full, &full], 3, turn);
            assert_ne!(views[0].image, views[1].image);
            for (k, some) in views.iter().enumerate() {
                let [left, top] = first_of(3, turn + k);
                // The middle of a pixel that is drawn.
                let at =
                    full.pinhole.project([(left as f32 + 12.5 - 20.0) / 30.0, (top as f32 + 15.5 - 15.0) / 30.0, 1.0]);
                let at = at.unwrap();
                let drawn = some.pinhole.project(full.pinhole.unproject(at)).unwrap();
                assert!((drawn.u - 4.5).abs() < 1e-4 && (drawn.v - 5.5).abs() < 1e-4, "{drawn:?}");
                assert_eq!(some.image.data[3 * drawn.pixel(some.pinhole.width)], full.image.data[3 * at.pixel(40)]);
            }
        }
        assert!(matches!(strided(&[&full], 1, 5)[0], Cow::Borrowed(_)));
    }
}
