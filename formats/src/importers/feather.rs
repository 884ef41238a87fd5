//! Feather files (version 2): the IPC file format of Apache Arrow, for flat columns of numbers and texts.
//!
//! The tables of the format come from `arrow-ipc`, whose accessors are safe once a table is verified; the buffers are taken
//! apart here, since its own reader trusts their offsets and lengths.
//!
//! # Source
//! <https://arrow.apache.org/docs/format/Columnar.html>

mod body;
mod columns;

use std::path::Path;

use arrow_ipc::root_as_footer;

use self::{
    body::{aligned, record_batch},
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

/// The table of a feather file.
///
/// # Errors
/// A file that is no feather file of version 2, is cut off, or contradicts itself.
pub(super) fn read_feather(file: &Path) -> Result<Table> {
    let bytes = read_file(file, MAX_DATA_BYTES)?;
    let at = At { file, field: "footer" };
    let footer = aligned(footer_bytes(&bytes).ok_or_else(|| {
        let found = format!("{} other bytes (truncated, or feather version 1?)", bytes.len());
        at.error("an Arrow file, `ARROW1` at both ends", found)
    })?);
    let footer = root_as_footer(footer.bytes()).map_err(|e| at.error("tables of Arrow", e.to_string()))?;
    let kinds = kinds(&at, footer.schema())?;
    let mut columns: Vec<Named> =
        kinds.iter().map(|field| Named { name: field.name.clone(), column: field.kind.empty() }).collect();
    let mut len = 0;
    for (index, block) in footer.recordBatches().into_iter().flatten().enumerate() {
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

/// The footer between the blocks and its own length at the end of the file.
fn footer_bytes(bytes: &[u8]) -> Option<&[u8]> {
    let rest = bytes.strip_prefix(MAGIC)?.strip_suffix(MAGIC)?;
    let (rest, length) = rest.split_last_chunk::<4>()?;
    let length = usize::try_from(i32::from_le_bytes(*length)).ok()?;
    rest.get(rest.len().checked_sub(length)?..)
}

#[cfg(test)]
mod tests;
