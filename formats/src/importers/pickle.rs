//! Pickled frames of pandas, without Python: nothing is ever called.
//!
//! A pickle is a program for a stack machine that may name any function and call it. [`machine`] runs the stack only: where
//! Python would call, it keeps an inert record of what would have been called with which arguments, and it refuses names
//! that no frame needs. [`frame`] then recognises the records that pandas and numpy write.

mod frame;
mod heap;
mod machine;

use std::{fs::File, io::Read, path::Path};

use flate2::read::MultiGzDecoder;

use super::{table::Table, values::At};
use crate::{
    error::{FormatError, Result},
    read::{MAX_DATA_BYTES, file_size, read_file, read_unpacked},
};

/// What a gzip file starts with.
const GZIP: [u8; 2] = [0x1f, 0x8b];

/// The frame of a pickle file, compressed with gzip or not.
///
/// # Errors
/// A file that is cut off, is no pickle of a frame, or names anything that a frame does not need.
pub(super) fn read_frame(file: &Path) -> Result<Table> {
    frame_of(At { file, field: "pickle" }, &decompressed(file)?)
}

fn frame_of(at: At<'_>, bytes: &[u8]) -> Result<Table> {
    let heap = machine::run(at, bytes)?;
    frame::table(at, &heap)
}

fn decompressed(file: &Path) -> Result<Vec<u8>> {
    let packed = file_size(file, MAX_DATA_BYTES)?;
    let mut start = [0; 2];
    let io = |e| FormatError::io(file, "read", e);
    let is_gzip = File::open(file).map_err(io)?.read_exact(&mut start).is_ok() && start == GZIP;
    if !is_gzip {
        return read_file(file, MAX_DATA_BYTES);
    }
    read_unpacked(file, "gzip", packed, MultiGzDecoder::new(File::open(file).map_err(io)?))
}

#[cfg(test)]
mod tests;
