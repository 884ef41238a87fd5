//! The part of a view that shows most: the same of every rendering, for comparison side by side.

use image::codecs::jpeg::JpegEncoder;
use lgs_formats::image::{RgbImage, to_byte};

use crate::error::{MeasureError, Result};

/// Largest width and height, pixels.
const SIZE: [usize; 2] = [320, 208];
const JPEG_QUALITY: u8 = 90;
/// Places that are tried along each side.
const PLACES: usize = 5;

/// A part of a picture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Crop {
    pixels: image::RgbImage,
}

impl Crop {
    /// The part of `rgb` where `truth`, of the same size, has most detail.
    ///
    /// # Shapes
    /// `rgb` `[H, W, 3]` 0 to 1.
    pub fn of(rgb: &[f32], truth: &RgbImage) -> Self {
        let size = [truth.width.min(SIZE[0]), truth.height.min(SIZE[1])];
        let [left, top] = most_detailed(truth, size);
        let side = |length: usize| u32::try_from(length).unwrap_or(u32::MAX);
        let mut pixels = image::RgbImage::new(side(size[0]), side(size[1]));
        for (i, pixel) in pixels.pixels_mut().enumerate() {
            let at = 3 * ((top + i / size[0]) * truth.width + left + i % size[0]);
            pixel.0 = std::array::from_fn(|k| rgb.get(at + k).map_or(0, |&value| to_byte(value)));
        }
        Self { pixels }
    }

    /// The bytes of a JPEG file.
    ///
    /// # Errors
    /// When the encoder refuses, as it does a picture without pixels.
    pub fn jpeg(&self) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        let encoder = JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY);
        let encoded = self.pixels.write_with_encoder(encoder);
        encoded.map_err(|source| MeasureError::Encode { what: "crop".to_owned(), source })?;
        Ok(bytes)
    }
}

/// Left and top of the window of `size` with the largest sum of absolute differences between neighbours in a row.
fn most_detailed(truth: &RgbImage, size: [usize; 2]) -> [usize; 2] {
    let free = [truth.width - size[0], truth.height - size[1]];
    let places = |side: usize| (0..PLACES).map(move |k| free[side] * k / (PLACES - 1));
    let windows = places(1).flat_map(|top| places(0).map(move |left| [left, top]));
    let detail = |[left, top]: [usize; 2]| -> f64 {
        let rows = (top..top + size[1]).map(|y| &truth.data[3 * (y * truth.width + left)..][..3 * size[0]]);
        rows.map(|row| row.iter().zip(row.iter().skip(3)).map(|(a, b)| f64::from((a - b).abs())).sum::<f64>()).sum()
    };
    let better = |best: Option<([usize; 2], f64)>, window: [usize; 2]| {
        let found = detail(window);
        best.filter(|(_, most)| *most >= found).or(Some((window, found)))
    };
    windows.fold(None, better).map_or([0, 0], |(window, _)| window)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_window_lies_where_things_are_to_be_seen() {
        let (width, height) = (640, 416);
        let mut image = RgbImage { width, height, data: vec![0.5; 3 * width * height] };
        for y in 300..400 {
            for x in 400..600 {
                image.data[3 * (y * width + x)] = if x % 2 == 0 { 0.0 } else { 1.0 };
            }
        }
        assert_eq!(most_detailed(&image, SIZE), [320, 208]);
        let crop = Crop::of(&image.data, &image);
        assert_eq!((crop.pixels.width(), crop.pixels.height()), (320, 208));
        assert_eq!(crop.pixels.get_pixel(400 - 320, 300 - 208).0, [0, 128, 128]);
        assert!(crop.jpeg().unwrap().len() > 100);
    }

    #[test]
    fn a_small_picture_is_shown_whole() {
        let image = RgbImage { width: 2, height: 1, data: vec![0.0, 0.0, 0.0, 1.0, 1.0, 1.0] };
        let crop = Crop::of(&image.data, &image);
        assert_eq!(crop.pixels.as_raw(), &[0, 0, 0, 255, 255, 255]);
    }
}
