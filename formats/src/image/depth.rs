//! Depth maps: read as what they are measured in, rectified and resized without mixing what lies before and behind an edge.

use std::{fs::File, io::Read, path::Path};

use image::ExtendedColorType;

use super::{ImageSize, decode, encode::encode, lens::Lens, sides, to_usize};
use crate::{
    camera::Camera,
    clip::{CameraRecord, DepthKind},
    error::{FormatError, Result},
    numpy::{Element, Npy, is_npy},
    read::{MAX_DATA_BYTES, file_size, read_file},
    write::write_atomic,
};

/// What errors call the content of a depth map.
const FIELD: &str = "depth map";
/// Longest start of an array's file that can hold its header, bytes.
const HEADER_BYTES: u64 = 12 + 65_536;
/// Smallest depth of an array, metres: a map in other units, or none at all, has smaller ones.
const MIN_DEPTH: f32 = 1e-3;
/// Millimetres of a PNG that mean "or farther".
const FARTHEST: u16 = u16::MAX;

/// A depth map at the size and with the camera of its loaded image.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthMap {
    /// What the values say.
    pub kind: DepthKind,
    /// `[H, W]` inverse depths along the camera's z axis: 1 / metres (0: infinitely far) of a metric map; up to a scale above 0 and a
    /// shift of a relative one. NaN where nothing is known.
    pub inverse: Vec<f32>,
}

/// Checks that the header of the depth map `path` says the size that `camera` declares.
///
/// # Errors
/// A file that is neither PNG nor array of floating-point numbers, one of another size, an array with more or fewer values than its header says.
pub fn check_depth(path: &Path, camera: &Camera) -> Result<()> {
    let bytes = file_size(path, MAX_DATA_BYTES)?;
    let file = File::open(path).map_err(|e| FormatError::io(path, "read", e))?;
    let mut start = Vec::new();
    file.take(HEADER_BYTES).read_to_end(&mut start).map_err(|e| FormatError::io(path, "read", e))?;
    if !is_npy(&start) {
        return decode::check_size(path, camera);
    }
    let npy = Npy::parse_start(path, FIELD, &start)?;
    check_array(path, &npy, camera)?;
    let expected = npy.data_size().and_then(|size| (start.len() - npy.data.len()).checked_add(size));
    if expected.map(|size| size as u64) == Some(bytes) {
        return Ok(());
    }
    let expected = expected.map_or("fewer values".to_owned(), |size| format!("{size} bytes"));
    Err(FormatError::invalid(path, FIELD, expected, format!("{bytes} (truncated?)")))
}

fn check_array(path: &Path, npy: &Npy<'_>, camera: &Camera) -> Result<()> {
    if !matches!(npy.element, Element::F16 | Element::F32 | Element::F64) {
        let expected = "an array of floating-point numbers (`<f4`, `<f8` or `<f2`)";
        return Err(FormatError::invalid(path, FIELD, expected, format!("{:?}", npy.element)));
    }
    let [width, height] = camera.file_size().map(to_usize);
    if npy.shape == [height, width] {
        return Ok(());
    }
    Err(FormatError::invalid(path, FIELD, format!("shape [{height}, {width}] as declared"), format!("{:?}", npy.shape)))
}

/// The depth map of a record, rectified as [`load`](super::load) rectifies its image and brought to `size` if given; `None` when the
/// record names none.
///
/// Every pixel takes the value of the pixel of the file that shows its centre: a mean over an edge would lie where nothing is.
///
/// # Errors
/// A file that is missing, damaged, of another size or form than declared, or that holds a depth below 1 mm, or an infinite relative
/// value; a `size` whose sides are out of range.
pub fn load_depth(root: &Path, record: &CameraRecord, size: Option<ImageSize>) -> Result<Option<DepthMap>> {
    let Some(depth) = &record.depth else { return Ok(None) };
    let (path, camera) = (root.join(&depth.file), &record.camera);
    let values = read(&path, camera, depth.kind)?;
    let [file_width, file_height] = camera.file_size().map(to_usize);
    let [height, width] = [camera.height, camera.width].map(to_usize);
    let size = size.unwrap_or(ImageSize { height, width });
    sides(&path, size)?;
    let lens = Lens::new(camera);
    if lens.is_none() && (size.height, size.width) == (height, width) {
        return Ok(Some(DepthMap { kind: depth.kind, inverse: values }));
    }
    let mut inverse = Vec::with_capacity(size.height * size.width);
    for row in 0..size.height {
        let v = (row as f64 + 0.5) * height as f64 / size.height as f64;
        for column in 0..size.width {
            let u = (column as f64 + 0.5) * width as f64 / size.width as f64;
            let at = lens.as_ref().map_or(Some([u, v]), |lens| lens.source_of(u, v));
            let value = at.and_then(|at| pixel_of(at, file_width, file_height)).map_or(f32::NAN, |pixel| values[pixel]);
            inverse.push(lens.as_ref().map_or(value, |lens| along(lens.inverse_depth_share(u, v), value)));
        }
    }
    Ok(Some(DepthMap { kind: depth.kind, inverse }))
}

/// An inverse depth along another axis; NaN behind it.
#[expect(clippy::cast_possible_truncation, reason = "the quotient of two depths, kept as f32 like these")]
fn along(share: f64, inverse: f32) -> f32 {
    if share > 0.0 { inverse * share as f32 } else { f32::NAN }
}

/// Row-major index of the pixel that a position falls into; `None` outside the image.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside the image after the check")]
fn pixel_of([u, v]: [f64; 2], width: usize, height: usize) -> Option<usize> {
    let inside = u >= 0.0 && v >= 0.0 && u < width as f64 && v < height as f64;
    inside.then(|| v as usize * width + u as usize)
}

/// `[H, W]` values of the file as [`DepthMap`] has them.
fn read(path: &Path, camera: &Camera, kind: DepthKind) -> Result<Vec<f32>> {
    let mut start = [0; 6];
    let mut file = File::open(path).map_err(|e| FormatError::io(path, "read", e))?;
    let is_array = file.read_exact(&mut start).is_ok() && is_npy(&start);
    if !is_array {
        let of_png = |value: u16| match kind {
            DepthKind::Relative => f32::from(value),
            DepthKind::Metric => match value {
                0 => f32::NAN,
                FARTHEST => 0.0,
                millimetres => 1000.0 / f32::from(millimetres),
            },
        };
        return Ok(decode::grey16(path, camera)?.into_iter().map(of_png).collect());
    }
    let bytes = read_file(path, MAX_DATA_BYTES)?;
    let npy = Npy::parse(path, FIELD, &bytes)?;
    check_array(path, &npy, camera)?;
    #[expect(clippy::cast_possible_truncation, reason = "depths need no more than f32")]
    let values = npy.element.floats(npy.data).into_iter().map(|value| value as f32);
    let of_value = |(pixel, value): (usize, f32)| match kind {
        DepthKind::Metric if value.is_nan() || value == 0.0 => Ok(f32::NAN),
        DepthKind::Metric if value >= MIN_DEPTH => Ok(1.0 / value),
        DepthKind::Relative if !value.is_infinite() => Ok(value),
        _ => {
            let (row, column) = (pixel / to_usize(camera.file_size()[0]), pixel % to_usize(camera.file_size()[0]));
            let expected = match kind {
                DepthKind::Metric => "metres from 0.001 to infinity, 0 or NaN for unknown ones",
                DepthKind::Relative => "finite values, NaN for unknown ones",
            };
            Err(FormatError::invalid(path, format!("{FIELD}[{row}][{column}]"), expected, value.to_string()))
        }
    };
    values.enumerate().map(of_value).collect()
}

/// Writes `[H, W]` values as a 16-bit grey PNG.
///
/// # Errors
/// Values whose number is not that of the size, and a path that cannot be written to.
pub fn write_depth_png(path: &Path, width: usize, height: usize, values: &[u16]) -> Result<()> {
    // The encoder takes samples in the machine's own order of bytes.
    let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_ne_bytes()).collect();
    write_atomic(path, &encode(path, width, height, &bytes, ExtendedColorType::L16)?)
}

/// Writes `[H, W]` depths (metres, infinity for sky) as an array of numpy.
///
/// # Errors
/// Depths whose number is not that of the size, and a path that cannot be written to.
pub fn write_depth_metres(path: &Path, width: usize, height: usize, depths: &[f32]) -> Result<()> {
    if width.checked_mul(height) != Some(depths.len()) {
        let expected = format!("a value for each pixel of width {width} and height {height}");
        return Err(FormatError::invalid(path, FIELD, expected, format!("{} values", depths.len())));
    }
    let mut bytes = crate::numpy::header_of(&[height, width]);
    bytes.extend(depths.iter().flat_map(|depth| depth.to_le_bytes()));
    write_atomic(path, &bytes)
}

#[cfg(test)]
mod tests;
