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

/// Checks that the header of a PNG or JPEG file says the declared size.
pub(super) fn check_size(path: &Path, camera: &Camera) -> Result<()> {
    compare_size(path, dimensions(path)?, camera)
}

/// Width and height that the header of a PNG or JPEG file says.
pub(super) fn dimensions(path: &Path) -> Result<(u32, u32)> {
    file_size(path, MAX_DATA_BYTES)?;
    let file = File::open(path).map_err(|e| FormatError::io(path, "read", e))?;
    let (reader, _) = reader(path, BufReader::new(file))?;
    reader.into_dimensions().map_err(|e| damaged(path, &e))
}

/// `[H, W, 3]` bytes of the PNG or JPEG file `path`, which holds `bytes`, of the declared size; alpha is dropped, grey is spread.
pub(super) fn rgb8(path: &Path, bytes: &[u8], camera: &Camera) -> Result<Vec<u8>> {
    let (image, _) = decode(path, bytes, camera)?;
    Ok(image.into_rgb8().into_raw())
}

/// `[H, W]` bytes of a grey PNG file of at most 8 bits and of the declared size.
pub(super) fn grey8(path: &Path, camera: &Camera) -> Result<Vec<u8>> {
    let (image, format) = decode(path, &read_file(path, MAX_DATA_BYTES)?, camera)?;
    match (image, format) {
        (DynamicImage::ImageLuma8(grey), ImageFormat::Png) => Ok(grey.into_raw()),
        (image, format) => {
            let found = format!("{:?} {format:?}", image.color());
            Err(FormatError::invalid(path, "pixel format", format!("{:?} Png (8-bit grey)", ColorType::L8), found))
        }
    }
}

/// `[H, W]` values of a 16-bit grey PNG file of the declared size.
pub(super) fn grey16(path: &Path, camera: &Camera) -> Result<Vec<u16>> {
    let (image, format) = decode(path, &read_file(path, MAX_DATA_BYTES)?, camera)?;
    match (image, format) {
        (DynamicImage::ImageLuma16(grey), ImageFormat::Png) => Ok(grey.into_raw()),
        (image, format) => {
            let found = format!("{:?} {format:?}", image.color());
            Err(FormatError::invalid(path, "pixel format", format!("{:?} Png (16-bit grey)", ColorType::L16), found))
        }
    }
}

fn decode(path: &Path, bytes: &[u8], camera: &Camera) -> Result<(DynamicImage, ImageFormat)> {
    let (mut reader, format) = reader(path, Cursor::new(bytes))?;
    let mut limits = Limits::no_limits();
    limits.max_alloc =
        Some(camera.file_size().map(u64::from).iter().product::<u64>() * MAX_PIXEL_BYTES + DECODER_BYTES);
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

fn reader<R: BufRead + Seek>(path: &Path, bytes: R) -> Result<(ImageReader<R>, ImageFormat)> {
    let reader = ImageReader::new(bytes).with_guessed_format().map_err(|e| FormatError::io(path, "read", e))?;
    match reader.format() {
        Some(format @ (ImageFormat::Png | ImageFormat::Jpeg)) => Ok((reader, format)),
        other => {
            let found = other.map_or("unknown content".to_owned(), |format| format!("{format:?}"));
            Err(FormatError::invalid(path, "image format", "PNG or JPEG", found))
        }
    }
}

fn compare_size(path: &Path, (width, height): (u32, u32), camera: &Camera) -> Result<()> {
    let [declared_width, declared_height] = camera.file_size();
    if (width, height) == (declared_width, declared_height) {
        return Ok(());
    }
    let expected = format!("width {declared_width} and height {declared_height} as declared");
    Err(FormatError::invalid(path, "image size", expected, format!("width {width} and height {height}")))
}

fn damaged(path: &Path, error: &ImageError) -> FormatError {
    FormatError::syntax(path, "image", error.to_string())
}

#[cfg(test)]
mod tests {
    use image::{ExtendedColorType, ImageEncoder, codecs::jpeg::JpegEncoder, codecs::png::PngEncoder};

    use super::*;
    use crate::{camera::Intrinsics, pose::Pose};

    const SIZE: (u32, u32) = (16, 8);

    fn camera(width: u32, height: u32) -> Camera {
        let intrinsics = Intrinsics { fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0 };
        let name = "c".to_owned();
        let world_from_camera = Pose::IDENTITY;
        Camera { name, timestamp: 0.0, width, height, intrinsics, distortion: None, readout: None, world_from_camera }
    }

    fn png(bytes: &[u8], colour: ExtendedColorType) -> Vec<u8> {
        let mut out = Vec::new();
        PngEncoder::new(&mut out).write_image(bytes, SIZE.0, SIZE.1, colour).unwrap();
        out
    }

    fn jpeg(bytes: &[u8]) -> Vec<u8> {
        let mut out = Vec::new();
        JpegEncoder::new_with_quality(&mut out, 95)
            .write_image(bytes, SIZE.0, SIZE.1, ExtendedColorType::Rgb8)
            .unwrap();
        out
    }

    fn rgb8(path: &Path, camera: &Camera) -> Result<Vec<u8>> {
        super::rgb8(path, &std::fs::read(path).unwrap(), camera)
    }

    fn on<T>(bytes: &[u8], act: fn(&Path, &Camera) -> Result<T>) -> std::result::Result<T, String> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("image");
        std::fs::write(&path, bytes).unwrap();
        act(&path, &camera(SIZE.0, SIZE.1)).map_err(|e| e.to_string())
    }

    #[test]
    fn every_pixel_layout_becomes_rgb() {
        let grey: Vec<u8> = (0..128).collect();
        let spread: Vec<u8> = grey.iter().flat_map(|&v| [v, v, v]).collect();
        let alpha: Vec<u8> = grey.iter().flat_map(|&v| [v, v, v, 7]).collect();
        let deep: Vec<u8> = grey.iter().flat_map(|&v| [v, v]).collect();
        assert_eq!(on(&png(&grey, ExtendedColorType::L8), rgb8).unwrap(), spread);
        assert_eq!(on(&png(&alpha, ExtendedColorType::Rgba8), rgb8).unwrap(), spread);
        assert_eq!(on(&png(&deep, ExtendedColorType::L16), rgb8).unwrap(), spread);
        let far = on(&jpeg(&spread), rgb8).unwrap().iter().zip(&spread).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(far.unwrap() <= 3, "{far:?}");
    }

    #[test]
    fn a_mask_is_grey_png_only() {
        let grey: Vec<u8> = (0..128).collect();
        assert_eq!(on(&png(&grey, ExtendedColorType::L8), grey8).unwrap(), grey);
        let message = on(&png(&[0; 384], ExtendedColorType::Rgb8), grey8).unwrap_err();
        assert!(message.ends_with("pixel format: expected L8 Png (8-bit grey), found Rgb8 Png"), "{message}");
        let message = on(&png(&[0; 256], ExtendedColorType::L16), grey8).unwrap_err();
        assert!(message.ends_with("found L16 Png"), "{message}");
        assert!(on(&jpeg(&[0; 384]), grey8).unwrap_err().ends_with("found Rgb8 Jpeg"));
    }

    #[test]
    fn truncated_images_are_errors_wherever_they_end() {
        let noise: Vec<u8> = (0..384_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        let (png, jpeg) = (png(&noise, ExtendedColorType::Rgb8), jpeg(&noise));
        assert!(on(&png, rgb8).is_ok() && on(&jpeg, rgb8).is_ok());
        for end in (0..png.len() - 16).step_by(5) {
            assert!(on(&png[..end], rgb8).is_err(), "png of {end} bytes");
        }
        for end in (0..jpeg.len() - 1).step_by(5) {
            assert!(on(&jpeg[..end], rgb8).is_err(), "jpeg of {end} bytes");
        }
        let message = on(&jpeg[..jpeg.len() - 20], rgb8).unwrap_err();
        assert!(message.ends_with("image: expected an end-of-image marker, found none (truncated?)"), "{message}");
    }

    #[test]
    fn damaged_images_never_panic() {
        let noise: Vec<u8> = (0..384_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        for good in [png(&noise, ExtendedColorType::Rgb8), jpeg(&noise)] {
            for place in 0..good.len() {
                let mut bad = good.clone();
                bad[place] ^= 0x55;
                if let Err(message) = on(&bad, rgb8) {
                    assert!(!message.contains('\n'), "{message}");
                }
            }
        }
    }

    #[test]
    fn a_header_that_announces_a_huge_image_is_refused_before_it_is_decoded() {
        let mut huge = png(&[0; 384], ExtendedColorType::Rgb8);
        huge[16..24].copy_from_slice(&[0, 0, 0x40, 0, 0, 0, 0x40, 0]); // width and height of the IHDR chunk
        for act in [check_size as fn(&Path, &Camera) -> Result<()>, |p, c| rgb8(p, c).map(drop)] {
            assert!(on(&huge, act).is_err());
        }
    }
}
