//! Feather files (version 2): the IPC file format of Apache Arrow, for flat columns of numbers and texts.
//!
//! A footer at the end says which columns there are and where the batches of rows lie.
//!
//! # Source
//! <https://arrow.apache.org/docs/format/Columnar.html>, and `File.fbs`, `Schema.fbs` and `Message.fbs` of Arrow for the numbers of the fields.

mod batch;
mod buffers;
mod columns;
mod flatbuffer;

use std::path::Path;

use self::{
    batch::{Block, record_batch},
    columns::{Kind, kinds},
};
use super::{
    table::{Column, Named, Table},
    values::At,
};
use crate::{
    error::Result,
    read::{MAX_DATA_BYTES, read_file},
};

const MAGIC: &[u8] = b"ARROW1";
/// Fields of a footer.
const SCHEMA: usize = 1;
const RECORD_BATCHES: usize = 3;

/// The table of a feather file.
///
/// # Errors
/// A file that is no feather file of version 2, is cut off, or contradicts itself.
pub(super) fn read_feather(file: &Path) -> Result<Table> {
    let bytes = read_file(file, MAX_DATA_BYTES)?;
    let at = At { file, field: "footer" };
    let footer = footer_bytes(&bytes).ok_or_else(|| {
        let found = format!("{} other bytes (truncated, or feather version 1?)", bytes.len());
        at.error("an Arrow file, `ARROW1` at both ends", found)
    })?;
    let footer = flatbuffer::Table::root(at, footer)?;
    let kinds = kinds(&at, &footer.table(SCHEMA)?.ok_or_else(|| at.error("a schema", "none"))?)?;
    let blocks: Vec<Block> = footer.vector(RECORD_BATCHES)?.iter().map(Block::parse).collect();
    check_disjoint(&at, &blocks, bytes.len())?;
    let mut columns: Vec<Named> =
        kinds.iter().map(|field| Named { name: field.name.clone(), column: field.kind.empty() }).collect();
    let mut len = 0;
    for (index, block) in blocks.iter().enumerate() {
        let at = At { file, field: &format!("batch {index}") };
        len = record_batch(&at, &bytes, block, &kinds, &mut columns)?.saturating_add(len);
    }
    for (field, named) in kinds.iter().zip(&mut columns) {
        if let Kind::Other(what) = &field.kind {
            named.column = Column::Other(what.clone());
        }
    }
    Table::new(file, len, columns)
}

/// Succeeds when the batches fit into the file side by side: many that share their bytes would make much of a small file.
///
/// # Errors
/// When they do not.
fn check_disjoint(at: &At<'_>, blocks: &[Block], file_bytes: usize) -> Result<()> {
    let bytes = blocks.iter().fold(0, |sum: usize, block| sum.saturating_add(block.body_bytes.unwrap_or(0)));
    if bytes <= file_bytes {
        return Ok(());
    }
    Err(at.error(format!("batches of at most {file_bytes} bytes in all"), format!("{bytes} bytes (truncated?)")))
}

/// The footer between the blocks and its own length at the end of the file.
fn footer_bytes(bytes: &[u8]) -> Option<&[u8]> {
    let rest = bytes.strip_prefix(MAGIC)?.strip_suffix(MAGIC)?;
    let (rest, length) = rest.split_last_chunk::<4>()?;
    let length = usize::try_from(i32::from_le_bytes(*length)).ok()?;
    rest.get(rest.len().checked_sub(length)?..)
}

#[cfg(test)]
mod tests;
