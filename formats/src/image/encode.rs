//! PNG files from images, grey maps and labels.

use std::path::Path;

use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};

use crate::{
    error::{FormatError, Result},
    image::{PixelLabel, RgbImage},
    write::write_atomic,
};

/// Writes an 8-bit RGB PNG; values are clamped to 0..=1 and rounded, NaN becomes 0.
///
/// # Errors
/// Data whose length is not that of the size, and a path that cannot be written to.
pub fn write_png(path: &Path, image: &RgbImage) -> Result<()> {
    write_atomic(path, &encode_png(path, image)?)
}

/// The bytes that [`write_png`] writes; `path` is what errors name.
///
/// # Errors
/// Data whose length is not that of the size.
pub fn encode_png(path: &Path, image: &RgbImage) -> Result<Vec<u8>> {
    let bytes: Vec<u8> = image.data.iter().map(|&v| to_byte(v)).collect();
    encode(path, image.width, image.height, &bytes, ExtendedColorType::Rgb8)
}

/// Writes `[H, W]` values in 0..=1 as an 8-bit grey PNG, rounded as [`write_png`] does.
///
/// # Errors
/// Data whose length is not that of the size, and a path that cannot be written to.
pub fn write_grey(path: &Path, width: usize, height: usize, values: &[f32]) -> Result<()> {
    let bytes: Vec<u8> = values.iter().map(|&v| to_byte(v)).collect();
    write_atomic(path, &encode(path, width, height, &bytes, ExtendedColorType::L8)?)
}

/// Writes `[H, W]` labels as a mask file.
///
/// # Errors
/// Labels whose number is not that of the size, and a path that cannot be written to.
pub fn write_mask(path: &Path, width: usize, height: usize, labels: &[PixelLabel]) -> Result<()> {
    let bytes: Vec<u8> = labels.iter().map(|label| label.grey()).collect();
    write_atomic(path, &encode(path, width, height, &bytes, ExtendedColorType::L8)?)
}

/// The byte of a value in 0..=1: clamped and rounded, 0 for NaN.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0..=255.5 after the clamp, NaN gives 0")]
pub fn to_byte(value: f32) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}

pub(super) fn encode(
    path: &Path,
    width: usize,
    height: usize,
    bytes: &[u8],
    colour: ExtendedColorType,
) -> Result<Vec<u8>> {
    let bytes_each = usize::from(colour.bits_per_pixel() / 8);
    let expected = width.checked_mul(height).and_then(|pixels| pixels.checked_mul(bytes_each));
    let (Ok(w), Ok(h), true) = (u32::try_from(width), u32::try_from(height), expected == Some(bytes.len())) else {
        let expected = format!("{bytes_each} bytes for each pixel of width {width} and height {height}");
        return Err(FormatError::invalid(path, "image data", expected, format!("{} bytes", bytes.len())));
    };
    let mut png = Vec::new();
    PngEncoder::new(&mut png)
        .write_image(bytes, w, h, colour)
        .map_err(|e| FormatError::syntax(path, "image", e.to_string()))?;
    Ok(png)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn bytes_of(path: &Path) -> Vec<u8> {
        image::open(path).unwrap().into_bytes()
    }

    #[test]
    fn values_are_clamped_and_rounded() {
        let data = vec![-1.0, 0.0, 0.499 / 255.0, 0.501 / 255.0, 1.0, 2.0, f32::NAN, f32::INFINITY, 254.5 / 255.0];
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.png");
        write_png(&path, &RgbImage { width: 3, height: 1, data: data.clone() }).unwrap();
        assert_eq!(bytes_of(&path), [0, 0, 0, 1, 255, 255, 0, 255, 255]);
        write_grey(&path, 1, 9, &data).unwrap();
        assert_eq!(bytes_of(&path), [0, 0, 0, 1, 255, 255, 0, 255, 255]);
        let labels = [PixelLabel::Ignored, PixelLabel::Dynamic, PixelLabel::Static];
        write_mask(&path, 3, 1, &labels).unwrap();
        assert_eq!(bytes_of(&path).into_iter().map(PixelLabel::from_grey).collect::<Vec<_>>(), labels);
    }

    #[test]
    fn data_of_another_size_are_refused() {
        let path = Path::new("no/a.png");
        for (width, height, len) in [(1, 1, 4), (0, 0, 3), (usize::MAX, 2, 3), (1 << 33, 0, 0), (0, 0, 0)] {
            let message = write_png(path, &RgbImage { width, height, data: vec![0.0; len] }).unwrap_err().to_string();
            assert!(message.contains("no/a.png: image"), "{message}");
        }
        assert!(write_grey(path, 2, 2, &[0.0; 3]).is_err());
    }

    proptest! {
        #[test]
        fn bytes_survive(data in prop::collection::vec(any::<u8>(), 12)) {
            let image = RgbImage { width: 2, height: 2, data: data.iter().map(|&b| f32::from(b) / 255.0).collect() };
            let png = encode_png(Path::new("a.png"), &image).unwrap();
            prop_assert_eq!(image::load_from_memory(&png).unwrap().into_bytes(), data);
        }
    }
}
