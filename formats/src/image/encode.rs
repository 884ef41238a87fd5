//! PNG files from images, grey maps and labels.

use std::path::Path;

use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};

use crate::{
    error::{FormatError, Result},
    image::{PixelLabel, RgbImage},
    write::write_atomic,
};

/// Nothing: writes an 8-bit RGB PNG; values are clamped to 0..=1 and rounded, NaN becomes 0.
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

/// Nothing: writes `[H, W]` values in 0..=1 as an 8-bit grey PNG, rounded as [`write_png`] does.
///
/// # Errors
/// Data whose length is not that of the size, and a path that cannot be written to.
pub fn write_grey(path: &Path, width: usize, height: usize, values: &[f32]) -> Result<()> {
    let bytes: Vec<u8> = values.iter().map(|&v| to_byte(v)).collect();
    write_atomic(path, &encode(path, width, height, &bytes, ExtendedColorType::L8)?)
}

/// Nothing: writes `[H, W]` labels as a mask file.
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

fn encode(path: &Path, width: usize, height: usize, bytes: &[u8], colour: ExtendedColorType) -> Result<Vec<u8>> {
    let channels = usize::from(colour.channel_count());
    let expected = width.checked_mul(height).and_then(|pixels| pixels.checked_mul(channels));
    let (Ok(w), Ok(h), true) = (u32::try_from(width), u32::try_from(height), expected == Some(bytes.len())) else {
        let expected = format!("{channels} values for each pixel of width {width} and height {height}");
        return Err(FormatError::invalid(path, "image data", expected, format!("{} values", bytes.len())));
    };
    let mut png = Vec::new();
    PngEncoder::new(&mut png)
        .write_image(bytes, w, h, colour)
        .map_err(|e| FormatError::syntax(path, "image", e.to_string()))?;
    Ok(png)
}
