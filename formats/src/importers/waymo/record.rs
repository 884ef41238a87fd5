//! `TFRecord` files: records behind each other, each with its length and checksums of the length and of the content.
//!
//! # Source
//! tensorflow, `tensorflow/core/lib/io/record_writer.h`.

use std::{
    fs::File,
    io::{Read, Seek, SeekFrom},
    ops::Range,
    path::Path,
};

use super::crc32c::{Crc32c, masked};
use crate::{
    error::{FormatError, Result},
    read::file_size,
};

/// Bytes before a record: its length, the checksum of the length.
const HEAD: usize = 12;
/// Bytes behind a record: the checksum of its content.
const TAIL: usize = 4;
/// Most records of a file.
const MAX_RECORDS: usize = 1_000_000;
/// Bytes that are read at once.
const PIECE: usize = 1 << 20;

/// Whether a file begins with the head of a record.
pub(super) fn is_of(file: &Path) -> bool {
    let mut head = [0; HEAD];
    file.is_file()
        && File::open(file).and_then(|mut file| file.read_exact(&mut head)).is_ok()
        && length_of(&head).is_some()
}

/// The length that a head says, when its checksum is right.
fn length_of(head: &[u8; HEAD]) -> Option<u64> {
    let (length, checksum) = head.split_first_chunk::<8>()?;
    let checksum = u32::from_le_bytes(*checksum.first_chunk()?);
    (masked(length) == checksum).then_some(u64::from_le_bytes(*length))
}

/// Where the contents of the records of a file are, by their heads alone. Whatever is wrong comes as the last entry: records before it are good.
///
/// # Errors
/// A file that is missing or cannot be read.
pub(super) fn index(path: &Path) -> Result<Vec<Result<Range<u64>>>> {
    let size = file_size(path, u64::MAX)?;
    let mut file = File::open(path).map_err(|e| FormatError::io(path, "read", e))?;
    let (mut records, mut at) = (Vec::new(), 0);
    while at < size {
        let field = format!("record {}", records.len());
        let truncated = |found: String| FormatError::invalid(path, &field, "a whole record", found + " (truncated?)");
        let mut head = [0; HEAD];
        if size - at < HEAD as u64 {
            records.push(Err(truncated(format!("{} bytes", size - at))));
            break;
        }
        file.seek(SeekFrom::Start(at))
            .and_then(|_| file.read_exact(&mut head))
            .map_err(|e| FormatError::io(path, "read", e))?;
        let Some(length) = length_of(&head) else {
            let expected = "a length with the checksum behind it";
            records.push(Err(FormatError::invalid(
                path,
                field,
                expected,
                "another checksum (damaged, or compressed?)",
            )));
            break;
        };
        let start = at + HEAD as u64;
        let rest = size - start;
        if length.checked_add(TAIL as u64).is_none_or(|whole| whole > rest) {
            records.push(Err(truncated(format!("{rest} of {} bytes", length.saturating_add(TAIL as u64)))));
            break;
        }
        records.push(Ok(start..start + length));
        if records.len() > MAX_RECORDS {
            return Err(FormatError::invalid(path, "records", format!("at most {MAX_RECORDS}"), "more"));
        }
        at = start + length + TAIL as u64;
    }
    Ok(records)
}

/// Checks that the content of a record has the checksum behind it. The content is read in pieces.
///
/// # Errors
/// Another checksum; a file that cannot be read.
pub(super) fn check(path: &Path, index: usize, content: &Range<u64>) -> Result<()> {
    let io = |e| FormatError::io(path, "read", e);
    let mut file = File::open(path).map_err(io)?;
    file.seek(SeekFrom::Start(content.start)).map_err(io)?;
    let (mut rest, mut crc) = (content.end - content.start, Crc32c::new());
    let mut piece = vec![0; PIECE.min(usize::try_from(rest).unwrap_or(PIECE))];
    while rest > 0 {
        let take = piece.len().min(usize::try_from(rest).unwrap_or(PIECE));
        file.read_exact(&mut piece[..take]).map_err(io)?;
        crc.update(&piece[..take]);
        rest -= take as u64;
    }
    let mut stored = [0; TAIL];
    file.read_exact(&mut stored).map_err(io)?;
    let (found, expected) = (crc.masked(), u32::from_le_bytes(stored));
    if found == expected {
        return Ok(());
    }
    let expected = format!("content with the masked CRC-32C {expected:08x}");
    Err(FormatError::invalid(path, format!("record {index}"), expected, format!("{found:08x} (damaged?)")))
}
