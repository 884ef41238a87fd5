//! Images on the host: decoded, undistorted and resized on the way in, PNG on the way out.

mod decode;
mod depth;
mod encode;
mod lens;
mod resample;

use std::{fmt, path::Path, str::FromStr};

use crate::{
    camera::Camera,
    clip::CameraRecord,
    error::{FormatError, Result},
};

pub use depth::{DepthMap, check_depth, load_depth, write_depth_metres, write_depth_png};
pub use encode::{encode_png, to_byte, write_grey, write_mask, write_png};

/// Largest width or height of an image, pixels.
pub const MAX_IMAGE_SIDE: u32 = 16384;

/// An RGB image with values in 0..=1, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct RgbImage {
    /// Width, pixels.
    pub width: usize,
    /// Height, pixels.
    pub height: usize,
    /// `[H, W, 3]` values in 0..=1.
    pub data: Vec<f32>,
}

/// What a pixel of a mask file says. Grey value 0: ignored (own vehicle, outside the lens); 255: static; any
/// other value: a moving object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PixelLabel {
    /// Takes part in nothing: neither loss nor figures nor colours.
    Ignored,
    /// Belongs to a moving object.
    Dynamic,
    /// Belongs to the static scene.
    Static,
}

impl PixelLabel {
    /// The label of a grey value of a mask file.
    pub const fn from_grey(grey: u8) -> Self {
        match grey {
            0 => Self::Ignored,
            255 => Self::Static,
            _ => Self::Dynamic,
        }
    }

    /// A grey value that [`PixelLabel::from_grey`] turns into this label.
    pub const fn grey(self) -> u8 {
        match self {
            Self::Ignored => 0,
            Self::Dynamic => 128,
            Self::Static => 255,
        }
    }
}

/// A decoded, undistorted, resized image with what its mask says.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedImage {
    /// The colours.
    pub rgb: RgbImage,
    /// `[H, W]` labels; `None` when every pixel is valid and the clip brings no mask.
    pub labels: Option<Vec<PixelLabel>>,
    /// The camera of `rgb`: rectified, at the size of `rgb`.
    pub camera: Camera,
    /// When its pixels were exposed: `[a, b, c]`, seconds after the camera's timestamp `a + b u + c v`, where `u` and `v` are shares of the width and
    /// the height; `None` where that is at once.
    pub moments: Option<[f64; 3]>,
}

/// Size of an image, written `HxW`; each side is 1 to [`MAX_IMAGE_SIDE`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageSize {
    /// Height, pixels.
    pub height: usize,
    /// Width, pixels.
    pub width: usize,
}

/// A text that is no image size.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected HxW in pixels, each 1 to {MAX_IMAGE_SIDE} (for example 304x484), found `{0}`")]
pub struct ImageSizeError(String);

impl FromStr for ImageSize {
    type Err = ImageSizeError;

    fn from_str(text: &str) -> std::result::Result<Self, ImageSizeError> {
        let side = |digits: &str| -> Option<usize> {
            let only_digits = digits.bytes().all(|b| b.is_ascii_digit());
            let side = digits.parse::<u32>().ok().filter(|s| only_digits && (1..=MAX_IMAGE_SIDE).contains(s))?;
            usize::try_from(side).ok()
        };
        let sides = text.split_once('x').and_then(|(h, w)| Some(Self { height: side(h)?, width: side(w)? }));
        sides.ok_or_else(|| ImageSizeError(text.to_owned()))
    }
}

impl fmt::Display for ImageSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.height, self.width)
    }
}

/// Checks that the header of the image or mask file `path` says the size that `camera` declares.
///
/// # Errors
/// A file that is no PNG or JPEG image, or of another size.
pub fn check_size(path: &Path, camera: &Camera) -> Result<()> {
    decode::check_size(path, camera)
}

/// Width and height that the header of a PNG or JPEG file says, pixels.
///
/// # Errors
/// A file that is no PNG or JPEG image.
pub(crate) fn dimensions(path: &Path) -> Result<[u32; 2]> {
    decode::dimensions(path).map(|(width, height)| [width, height])
}

/// Checks that the image of a record, whose file holds `bytes`, can be decoded whole.
///
/// # Errors
/// An image that is damaged or of another size than declared.
pub(crate) fn check_whole(root: &Path, record: &CameraRecord, bytes: &[u8]) -> Result<()> {
    decode::rgb8(&root.join(&record.file), bytes, &record.camera).map(drop)
}

/// Checks that the file `path` is a whole mask of the size that `camera` declares.
///
/// # Errors
/// A mask that is missing, damaged, of another size, or not an 8-bit grey PNG.
pub(crate) fn check_mask(path: &Path, camera: &Camera) -> Result<()> {
    decode::grey8(path, camera).map(drop)
}

/// `[256]` how many pixels of a record's mask have each grey value; `None` when the record names none.
///
/// # Errors
/// A mask that is missing, damaged, of another size, or not an 8-bit grey PNG.
pub fn mask_values(root: &Path, record: &CameraRecord) -> Result<Option<[usize; 256]>> {
    let Some(mask) = &record.mask else { return Ok(None) };
    let mut counts = [0; 256];
    for grey in decode::grey8(&root.join(mask), &record.camera)? {
        counts[usize::from(grey)] += 1;
    }
    Ok(Some(counts))
}

/// The image of a record, whose file holds `bytes`, rectified to the pinhole of the same intrinsics, then resized to `size` if given.
///
/// Values are the encoded ones (no gamma is undone). Downward, a pixel is the mean of the area that it covers;
/// upward, it is interpolated linearly. Its label is Ignored if any part of that area is ignored or lies outside
/// the source image, else what holds for more than half of it.
///
/// # Errors
/// An image that is damaged or of another size than declared; a mask that is missing, too, or not an 8-bit grey PNG; a
/// `size` outside 1 to [`MAX_IMAGE_SIDE`].
pub(crate) fn load(root: &Path, record: &CameraRecord, bytes: &[u8], size: Option<ImageSize>) -> Result<LoadedImage> {
    let path = root.join(&record.file);
    let declared = &record.camera;
    let [file_width, file_height] = declared.file_size().map(to_usize);
    let source = resample::Source {
        width: file_width,
        height: file_height,
        rectified: [to_usize(declared.width), to_usize(declared.height)],
        rgb: &decode::rgb8(&path, bytes, declared)?,
        mask: record.mask.as_ref().map(|mask| decode::grey8(&root.join(mask), declared)).transpose()?,
        lens: lens::Lens::new(declared),
    };
    let size = size.unwrap_or(ImageSize { height: to_usize(declared.height), width: to_usize(declared.width) });
    let [height, width] = sides(&path, size)?;
    let (rgb, labels) = source.resized(size);
    let (sx, sy) = (f64::from(width) / f64::from(declared.width), f64::from(height) / f64::from(declared.height));
    let intrinsics = declared.intrinsics.scaled(sx, sy);
    let camera = Camera { width, height, intrinsics, distortion: None, ..declared.clone() };
    Ok(LoadedImage { rgb, labels, camera, moments: lens::moments(declared) })
}

/// Height and width of a size that images may be brought to.
///
/// # Errors
/// A side outside 1 to [`MAX_IMAGE_SIDE`].
fn sides(path: &Path, size: ImageSize) -> Result<[u32; 2]> {
    let side = |pixels: usize| u32::try_from(pixels).ok().filter(|side| (1..=MAX_IMAGE_SIDE).contains(side));
    match (side(size.height), side(size.width)) {
        (Some(height), Some(width)) => Ok([height, width]),
        _ => Err(FormatError::invalid(path, "size", format!("sides of 1 to {MAX_IMAGE_SIDE}"), size.to_string())),
    }
}

/// A side of at most [`MAX_IMAGE_SIDE`] pixels as an index.
fn to_usize(side: u32) -> usize {
    usize::try_from(side).unwrap_or(usize::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_size_is_height_x_width() {
        let size: ImageSize = "304x484".parse().unwrap();
        assert_eq!((size.height, size.width, size.to_string()), (304, 484, "304x484".to_owned()));
        for bad in
            ["", "x", "3", "3x", "x3", "0x3", "3x0", "-3x3", "+3x3", "3x3x3", "3X3", " 3x3", "16385x1", "3x99999999999"]
        {
            let message = bad.parse::<ImageSize>().unwrap_err().to_string();
            assert!(message.starts_with("expected HxW") && message.ends_with(&format!("found `{bad}`")), "{message}");
        }
    }

    #[test]
    fn grey_values_and_labels_belong_together() {
        for label in [PixelLabel::Ignored, PixelLabel::Dynamic, PixelLabel::Static] {
            assert_eq!(PixelLabel::from_grey(label.grey()), label);
        }
        assert_eq!([1, 254].map(PixelLabel::from_grey), [PixelLabel::Dynamic; 2]);
    }
}
