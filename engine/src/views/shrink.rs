//! A view with fewer pixels, for work that does not need all of them.

use lgs_formats::casts::to_f32;
use lgs_formats::image::{DepthMap, PixelLabel, RgbImage};

use super::{DepthSample, PinholeView, View};

impl PinholeView {
    /// The camera of an image whose pixels are blocks of `factor` x `factor` of this one's; rows and columns at the end that do not fill a
    /// block are left out, but for the last one that there is.
    pub(crate) fn reduced(&self, factor: usize) -> Self {
        let share = 1.0 / factor as f32;
        Self {
            width: (self.width / factor).max(1),
            height: (self.height / factor).max(1),
            fx: self.fx * share,
            fy: self.fy * share,
            cx: self.cx * share,
            cy: self.cy * share,
            shutter: self.shutter.map(|shutter| shutter.reduced(factor as f32)),
            ..*self
        }
    }

    /// Row-major indices of the pixels of this image that make up one pixel of the image reduced by `factor`.
    pub(crate) fn block(&self, row: usize, column: usize, factor: usize) -> impl Iterator<Item = usize> + Clone {
        let columns = column * factor..((column + 1) * factor).min(self.width);
        let rows = row * factor..((row + 1) * factor).min(self.height);
        let width = self.width;
        rows.flat_map(move |y| columns.clone().map(move |x| y * width + x))
    }
}

impl View {
    /// This view, `factor` times smaller in width and height: mean colours; a pixel is ignored where any part of it is, and dynamic where
    /// more than half of it is; the nearest return of each pixel.
    pub(crate) fn reduced(&self, factor: usize) -> Self {
        if factor <= 1 {
            return self.clone();
        }
        let (full, pinhole) = (&self.pinhole, self.pinhole.reduced(factor));
        let pixels = (0..pinhole.height).flat_map(|row| (0..pinhole.width).map(move |column| (row, column)));
        let data = pixels.clone().flat_map(|(row, column)| self.mean_colour(full.block(row, column, factor))).collect();
        let label_of = |labels: &[PixelLabel], (row, column)| joint_label(labels, full.block(row, column, factor));
        Self {
            image: RgbImage { width: pinhole.width, height: pinhole.height, data },
            labels: self.labels.as_ref().map(|labels| pixels.map(|pixel| label_of(labels, pixel)).collect()),
            depth_map: self.depth_map.as_ref().map(|map| fewer_depths(map, full.width, &pinhole, factor)),
            depth_samples: fewer_samples(&self.depth_samples, full.width, &pinhole, factor),
            camera: self.camera.clone(),
            pinhole,
            ..*self
        }
    }

    pub(super) fn mean_colour(&self, pixels: impl Iterator<Item = usize>) -> [f32; 3] {
        let (mut sum, mut count) = ([0.0_f64; 3], 0.0_f64);
        for pixel in pixels {
            let colour = &self.image.data[3 * pixel..3 * pixel + 3];
            sum = std::array::from_fn(|k| sum[k] + f64::from(colour[k]));
            count += 1.0;
        }
        sum.map(|channel| to_f32(channel / count.max(1.0)))
    }
}

fn joint_label(labels: &[PixelLabel], pixels: impl Iterator<Item = usize> + Clone) -> PixelLabel {
    let count = |label| pixels.clone().filter(|&pixel| labels[pixel] == label).count();
    match count(PixelLabel::Ignored) {
        0 if 2 * count(PixelLabel::Dynamic) > pixels.clone().count() => PixelLabel::Dynamic,
        0 => PixelLabel::Static,
        _ => PixelLabel::Ignored,
    }
}

/// The inverse depth in the middle of every pixel of the smaller image: a mean over an edge would lie where nothing is.
fn fewer_depths(map: &DepthMap, width: usize, small: &PinholeView, factor: usize) -> DepthMap {
    let height = map.inverse.len() / width;
    let middle = |at: usize, size: usize| (at * factor + factor / 2).min(size - 1);
    let of_pixel = |pixel: usize| {
        let (row, column) = (middle(pixel / small.width, height), middle(pixel % small.width, width));
        map.inverse[row * width + column]
    };
    DepthMap { kind: map.kind, inverse: (0..small.num_pixels()).map(of_pixel).collect() }
}

/// The nearest of the returns in every pixel of the smaller image.
fn fewer_samples(samples: &[DepthSample], width: usize, small: &PinholeView, factor: usize) -> Vec<DepthSample> {
    let mut moved: Vec<DepthSample> = samples
        .iter()
        .filter_map(|sample| {
            let pixel = sample.pixel as usize;
            let (row, column) = (pixel / width / factor, pixel % width / factor);
            let inside = row < small.height && column < small.width;
            let pixel = u32::try_from(row * small.width + column).ok().filter(|_| inside)?;
            Some(DepthSample { pixel, depth: sample.depth })
        })
        .collect();
    moved.sort_by(|a, b| a.pixel.cmp(&b.pixel).then(a.depth.total_cmp(&b.depth)));
    moved.dedup_by_key(|sample| sample.pixel);
    moved
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::views::samples::{ahead, seen};

    fn view(width: usize, height: usize) -> View {
        let pinhole = PinholeView { fy: 6.0, time: 0.5, ..ahead(width, height, 8.0) };
        View { frame: 3, ..seen(pinhole, (0..3 * width * height).map(|i| i as f32).collect()) }
    }

    #[test]
    fn pixels_are_means_and_the_camera_looks_the_same_way() {
        let (full, half) = (view(5, 4), view(5, 4).reduced(2));
        assert_eq!((half.pinhole.width, half.pinhole.height, half.image.data.len()), (2, 2, 12));
        // Red of pixels 0, 1, 5, 6 of the first block.
        assert_eq!(half.image.data[0], (0.0 + 3.0 + 15.0 + 18.0) / 4.0);
        let at = full.pinhole.project([0.05, -0.1, 1.0]).unwrap();
        let small = half.pinhole.project([0.05, -0.1, 1.0]).unwrap();
        assert_eq!((small.u, small.v, small.depth), (at.u / 2.0, at.v / 2.0, at.depth));
        assert_eq!(full.reduced(1), full);
    }

    #[test]
    fn one_pixel_is_left_of_any_image() {
        let one = view(3, 2).reduced(16);
        assert_eq!((one.pinhole.width, one.pinhole.height), (1, 1));
        assert_eq!(one.image.data, [7.5, 8.5, 9.5]);
    }

    #[test]
    fn labels_and_returns_stay_on_the_safe_side() {
        use PixelLabel::{Dynamic, Ignored, Static};
        let labels = [
            [Static, Dynamic, Dynamic, Dynamic],
            [Static, Ignored, Dynamic, Static], //
        ];
        let sample = |pixel, depth| DepthSample { pixel, depth };
        let full = View {
            labels: Some(labels.concat()),
            depth_samples: vec![sample(0, 4.0), sample(1, 3.0), sample(6, 2.0)],
            ..view(4, 2)
        };
        let half = full.reduced(2);
        assert_eq!(half.labels, Some(vec![Ignored, Dynamic]));
        assert_eq!(half.depth_samples, [sample(0, 3.0), sample(1, 2.0)]);
    }
}
