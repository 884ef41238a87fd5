//! PNG and JPEG files to bytes, only if they are what the clip declares.

use std::{
    fs::File,
    io::{BufRead, BufReader, Cursor, Seek},
    path::Path,
};

use image::{ColorType, DynamicImage, ImageDecoder, ImageError, ImageFormat, ImageReader, Limits};

use crate::{
    camera::Camera,
    error::{FormatError, Result},
    read::{MAX_DATA_BYTES, file_size, read_file},
};

/// Largest number of bytes of a decoded pixel (16-bit RGBA).
const MAX_PIXEL_BYTES: u64 = 8;
/// Room for the decoders' own tables, bytes.
const DECODER_BYTES: u64 = 64 << 20;
/// The marker that ends a JPEG image.
const JPEG_END: [u8; 2] = [0xff, 0xd9];

/// Nothing, when the header of the file says the declared size.
pub(super) fn check_size(path: &Path, camera: &Camera) -> Result<()> {
    file_size(path, MAX_DATA_BYTES)?;
    let file = File::open(path).map_err(|e| FormatError::io(path, "read", e))?;
    let reader = reader(path, BufReader::new(file))?;
    let size = reader.into_dimensions().map_err(|e| damaged(path, &e))?;
    compare_size(path, size, camera)
}

/// `[H, W, 3]` bytes of a PNG or JPEG file of the declared size; alpha is dropped, grey is spread.
pub(super) fn rgb8(path: &Path, camera: &Camera) -> Result<Vec<u8>> {
    let (image, _) = decode(path, camera)?;
    Ok(image.into_rgb8().into_raw())
}

/// `[H, W]` bytes of a grey PNG file of at most 8 bits and of the declared size.
pub(super) fn grey8(path: &Path, camera: &Camera) -> Result<Vec<u8>> {
    let (image, format) = decode(path, camera)?;
    match (image, format) {
        (DynamicImage::ImageLuma8(grey), ImageFormat::Png) => Ok(grey.into_raw()),
        (image, format) => {
            let found = format!("{:?} {format:?}", image.color());
            Err(FormatError::invalid(path, "pixel format", format!("{:?} Png (8-bit grey)", ColorType::L8), found))
        }
    }
}

fn decode(path: &Path, camera: &Camera) -> Result<(DynamicImage, ImageFormat)> {
    let bytes = read_file(path, MAX_DATA_BYTES)?;
    let mut reader = reader(path, Cursor::new(&bytes))?;
    let format = reader.format().unwrap_or(ImageFormat::Png);
    let mut limits = Limits::no_limits();
    limits.max_alloc = Some(u64::from(camera.width) * u64::from(camera.height) * MAX_PIXEL_BYTES + DECODER_BYTES);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(|e| damaged(path, &e))?;
    compare_size(path, decoder.dimensions(), camera)?;
    if format == ImageFormat::Jpeg && !bytes.windows(2).rev().any(|pair| pair == JPEG_END) {
        // The decoder fills the missing rows with grey.
        return Err(FormatError::invalid(path, "image", "an end-of-image marker", "none (truncated?)"));
    }
    let image = DynamicImage::from_decoder(decoder).map_err(|e| damaged(path, &e))?;
    Ok((image, format))
}

fn reader<R: BufRead + Seek>(path: &Path, bytes: R) -> Result<ImageReader<R>> {
    let reader = ImageReader::new(bytes).with_guessed_format().map_err(|e| FormatError::io(path, "read", e))?;
    match reader.format() {
        Some(ImageFormat::Png | ImageFormat::Jpeg) => Ok(reader),
        other => {
            let found = other.map_or("unknown content".to_owned(), |format| format!("{format:?}"));
            Err(FormatError::invalid(path, "image format", "PNG or JPEG", found))
        }
    }
}

fn compare_size(path: &Path, (width, height): (u32, u32), camera: &Camera) -> Result<()> {
    if (width, height) == (camera.width, camera.height) {
        return Ok(());
    }
    let expected = format!("width {} and height {} as clip.json declares", camera.width, camera.height);
    Err(FormatError::invalid(path, "image size", expected, format!("width {width} and height {height}")))
}

fn damaged(path: &Path, error: &ImageError) -> FormatError {
    FormatError::syntax(path, "image", error.to_string())
}
