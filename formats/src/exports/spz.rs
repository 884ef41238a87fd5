//! SPZ, the small files of web viewers: one moment, quantised.
//!
//! # Source
//! Version 3 of <https://github.com/nianticlabs/spz>.

mod quantised;

use std::{io::Read, path::Path};

use flate2::{Compression, bufread::GzEncoder};

use self::quantised::{Splat, packed};
use crate::{
    cloud::SplatCloud,
    error::{FormatError, Result},
    ply::check_lengths,
    write::write_atomic,
};

/// Positions are 24-bit integers of 1/4096 m: what lies farther out cannot be written.
const REACH: f32 = 2047.0;
/// Turns the clip's axes (x forward, y left, z up) into those of SPZ (x right, y up, z back): a quaternion w, x, y, z.
const TURN: [f32; 4] = [0.5, -0.5, 0.5, 0.5];

/// What came into the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Written {
    /// Splats in the file.
    pub kept: usize,
    /// Splats farther than 2047 m from the origin, which the format cannot hold.
    pub too_far: usize,
}

/// What came into the file: the cloud as it stands at its means, upright in viewers whose y axis points up.
///
/// Positions are exact to 0.13 mm, log scales to 1/32, opacities and colours to 1/510, rotations to 0.1 degrees.
///
/// # Errors
/// Columns of different lengths, more than 2^31 splats, a path that cannot be written to.
pub fn write_spz(path: &Path, cloud: &SplatCloud) -> Result<Written> {
    check_lengths(path, cloud)?;
    let near = |i: &usize| cloud.means[*i].iter().all(|v| v.abs() <= REACH);
    let kept: Vec<usize> = (0..cloud.len()).filter(near).collect();
    let too_many = |error: std::num::TryFromIntError| {
        FormatError::invalid(path, "splats", "at most 2147483647", format!("{}: {error}", kept.len()))
    };
    let count = i32::try_from(kept.len()).map_err(too_many)?;
    let bytes = packed(count, kept.iter().map(|&i| splat(cloud, i)));
    let mut zipped = Vec::new();
    let read = GzEncoder::new(bytes.as_slice(), Compression::default()).read_to_end(&mut zipped);
    read.map_err(|e| FormatError::io(path, "compress", e))?;
    write_atomic(path, &zipped)?;
    Ok(Written { kept: kept.len(), too_far: cloud.len() - kept.len() })
}

/// A splat of the cloud in the axes of SPZ.
fn splat(cloud: &SplatCloud, i: usize) -> Splat {
    Splat {
        position: turned(cloud.means[i]),
        log_scales: cloud.log_scales[i],
        rotation: rotation(cloud.quats[i]),
        logit_opacity: cloud.logit_opacities[i],
        sh_dc: cloud.sh_dc[i],
    }
}

fn turned([x, y, z]: [f32; 3]) -> [f32; 3] {
    [-y, z, -x]
}

/// The rotation in SPZ's axes and order: x, y, z, w.
fn rotation([w, x, y, z]: [f32; 4]) -> [f32; 4] {
    let [a, b, c, d] = TURN;
    [
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
        a * w - b * x - c * y - d * z,
    ]
}

#[cfg(test)]
mod tests;
