//! Splat clouds to PLY files.

use std::path::Path;

use super::{
    COLOUR, FRAME, HIGHER_COLOUR_PREFIX, MAX_FRAME, NORMAL, NUM_HIGHER, OPACITY, POSITION, ROTATION, SCALE,
    fixed_names, header::MAX_HEADER_BYTES, is_extra,
};
use crate::{
    cloud::SplatCloud,
    error::{FormatError, Result},
    write::write_atomic,
};

/// Writes the cloud in the layout of [`crate::ply`], so that [`crate::ply::read_ply`] gives it back bit for bit.
///
/// # Errors
/// Columns of different lengths, a value that is not finite, an extra column whose name is taken or is not one word
/// of printable ASCII, and a path that cannot be written to.
pub fn write_ply(path: &Path, cloud: &SplatCloud) -> Result<()> {
    write_atomic(path, &to_bytes(path, cloud)?)
}

/// Which spherical harmonics beyond the first a plain file has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Higher {
    /// None: every splat has one colour.
    None,
    /// All 45 of degree 3, `f_rest_0` to `f_rest_44`, zeros, for programs that ask for them (SIBR, plugins of Unity).
    Zeros,
}

/// Writes the properties alone that every viewer of 3D Gaussian splatting knows: no velocities, times, frames or further
/// columns.
///
/// # Errors
/// Those of [`write_ply`].
pub fn write_plain_ply(path: &Path, cloud: &SplatCloud, higher: Higher) -> Result<()> {
    check_lengths(path, cloud)?;
    let rest: Vec<String> = match higher {
        Higher::None => Vec::new(),
        Higher::Zeros => (0..NUM_HIGHER).map(|k| format!("{HIGHER_COLOUR_PREFIX}{k}")).collect(),
    };
    let first: Vec<&str> = [POSITION, NORMAL, COLOUR].into_iter().flatten().collect();
    let last: Vec<&str> = [&[OPACITY][..], &SCALE, &ROTATION].into_iter().flatten().copied().collect();
    let names: Vec<&str> =
        first.iter().copied().chain(rest.iter().map(String::as_str)).chain(last.iter().copied()).collect();
    let bytes = encode(path, &names, cloud.len(), |index| {
        let values = record(cloud, index).into_iter();
        let behind = values.clone().skip(first.len()).take(last.len());
        values.take(first.len()).chain(std::iter::repeat_n(0.0, rest.len())).chain(behind)
    })?;
    write_atomic(path, &bytes)
}

/// The bytes of the file that [`write_ply`] writes; `path` is what errors name.
///
/// # Errors
/// Those of [`write_ply`], but for the path.
pub fn to_bytes(path: &Path, cloud: &SplatCloud) -> Result<Vec<u8>> {
    check_lengths(path, cloud)?;
    check_extra_names(path, cloud)?;
    let frames = cloud.frames.as_deref();
    if let Some((index, found)) = frames.unwrap_or_default().iter().enumerate().find(|(_, frame)| **frame > MAX_FRAME) {
        let (field, expected) = (format!("vertex {index} {FRAME}"), format!("a whole number from 0 to {MAX_FRAME}"));
        return Err(FormatError::invalid(path, field, expected, found.to_string()));
    }
    let frame_name = frames.map(|_| FRAME);
    let extra_names = cloud.extra.iter().map(|(name, _)| name.as_str());
    let names: Vec<&str> = fixed_names().map(|name| -> &str { name }).chain(frame_name).chain(extra_names).collect();
    encode(path, &names, cloud.len(), |index| {
        let frame = frames.map(|frames| frames[index] as f32);
        let extra = cloud.extra.iter().map(move |(_, column)| column[index]);
        record(cloud, index).into_iter().chain(frame).chain(extra)
    })
}

/// The bytes of a file of `count` records, whose values stand in the order of `names`.
pub(crate) fn encode<V: Iterator<Item = f32>>(
    path: &Path,
    names: &[&str],
    count: usize,
    record: impl Fn(usize) -> V,
) -> Result<Vec<u8>> {
    let mut bytes = format!("ply\nformat binary_little_endian 1.0\nelement vertex {count}\n").into_bytes();
    for name in names {
        bytes.extend_from_slice(format!("property float {name}\n").as_bytes());
    }
    bytes.extend_from_slice(b"end_header\n");
    if bytes.len() > MAX_HEADER_BYTES {
        let found = format!("{} of {} bytes", names.len(), bytes.len());
        return Err(FormatError::invalid(path, "extra", format!("names of {MAX_HEADER_BYTES} bytes in all"), found));
    }
    bytes.reserve_exact(count * names.len() * size_of::<f32>());
    for index in 0..count {
        for (name, value) in names.iter().zip(record(index)) {
            if !value.is_finite() {
                let field = format!("vertex {index} {name}");
                return Err(FormatError::invalid(path, field, "a finite f32", value.to_string()));
            }
            bytes.extend_from_slice(&value.to_le_bytes());
        }
    }
    Ok(bytes)
}

/// The values of one splat in the order of [`fixed_names`].
fn record(cloud: &SplatCloud, index: usize) -> [f32; 21] {
    let ([x, y, z], [sx, sy, sz]) = (cloud.means[index], cloud.log_scales[index]);
    let ([w, i, j, k], [r, g, b]) = (cloud.quats[index], cloud.sh_dc[index]);
    let ([vx, vy, vz], t) = (cloud.velocities[index], cloud.times[index]);
    let opacity = cloud.logit_opacities[index];
    [x, y, z, 0.0, 0.0, 0.0, r, g, b, opacity, sx, sy, sz, w, i, j, k, vx, vy, vz, t]
}

pub(crate) fn check_lengths(path: &Path, cloud: &SplatCloud) -> Result<()> {
    let fixed = [
        ("log_scales", cloud.log_scales.len()),
        ("quats", cloud.quats.len()),
        ("logit_opacities", cloud.logit_opacities.len()),
        ("sh_dc", cloud.sh_dc.len()),
        ("velocities", cloud.velocities.len()),
        ("times", cloud.times.len()),
    ];
    let frames = cloud.frames.as_ref().map(|frames| ("frames", frames.len()));
    let extra = cloud.extra.iter().map(|(name, column)| (name.as_str(), column.len()));
    match fixed.into_iter().chain(frames).chain(extra).find(|&(_, length)| length != cloud.len()) {
        None => Ok(()),
        Some((name, length)) => {
            let expected = format!("{} values as means", cloud.len());
            Err(FormatError::invalid(path, name, expected, length.to_string()))
        }
    }
}

fn check_extra_names(path: &Path, cloud: &SplatCloud) -> Result<()> {
    for (index, (name, _)) in cloud.extra.iter().enumerate() {
        let is_word = !name.is_empty() && name.len() <= 100 && name.bytes().all(|b| b.is_ascii_graphic());
        let is_taken = !is_extra(name) || cloud.extra[..index].iter().any(|(other, _)| other == name);
        if !is_word || is_taken {
            let expected = "a free name of one word of at most 100 ASCII characters";
            return Err(FormatError::invalid(path, format!("extra[{index}]"), expected, format!("{name:?}")));
        }
    }
    Ok(())
}
