//! Batches of rows: a message that says where the buffers are, and a body that holds them.

use super::{
    buffers::{Buffers, Codec, Slot},
    columns::{Field, Kind},
    flatbuffer::{Table, index, words},
};
use crate::{
    error::Result,
    importers::{table::Named, values::At},
};

/// What stands before a message's length.
const CONTINUATION: [u8; 4] = [0xff; 4];
/// Fields of a message, and the code of one that holds rows.
const HEADER_CODE: usize = 1;
const HEADER: usize = 2;
const RECORD_BATCH: [u8; 1] = [3];
/// Fields of a batch.
const LENGTH: usize = 0;
const NODES: usize = 1;
const BUFFERS: usize = 2;
const COMPRESSION: usize = 3;
/// Field of a compression.
const CODEC: usize = 0;

/// Where a batch lies in the file; `None` stands for negative numbers.
#[derive(Clone, Copy, Debug)]
pub(super) struct Block {
    start: Option<usize>,
    head_bytes: Option<usize>,
    pub(super) body_bytes: Option<usize>,
}

impl Block {
    /// The block of a footer. The number in its middle has 32 bits, and padding.
    pub(super) fn parse(bytes: &[u8; 24]) -> Self {
        let [start, head, body] = words(bytes);
        let [a, b, c, d, ..] = head.to_le_bytes();
        Self {
            start: index(start),
            head_bytes: index(i32::from_le_bytes([a, b, c, d]).into()),
            body_bytes: index(body),
        }
    }

    /// The message and the body within the file.
    fn of<'a>(&self, file: &'a [u8]) -> Option<(&'a [u8], &'a [u8])> {
        let (message, rest) = file.get(self.start?..)?.split_at_checked(self.head_bytes?)?;
        let message = message.strip_prefix(&CONTINUATION).unwrap_or(message);
        Some((message.get(4..)?, rest.get(..self.body_bytes?)?))
    }
}

/// The number of rows of a batch, whose values are added to `columns`.
///
/// # Errors
/// A batch that lies outside the file, contradicts itself or has fewer values than rows.
pub(super) fn record_batch(
    at: &At<'_>,
    file: &[u8],
    block: &Block,
    fields: &[Field],
    columns: &mut [Named],
) -> Result<usize> {
    let parts = block.of(file);
    let (message, body) =
        parts.ok_or_else(|| at.error("a message and its body", "an end outside the file (truncated?)"))?;
    let message = Table::root(*at, message)?;
    let rows = if message.number(HEADER_CODE)? == RECORD_BATCH { message.table(HEADER)? } else { None };
    let rows = rows.ok_or_else(|| at.error("rows", "another message"))?;
    let length = i64::from_le_bytes(rows.number(LENGTH)?);
    let len = index(length).ok_or_else(|| at.error("a number of rows", length.to_string()))?;
    let codec = rows.table(COMPRESSION)?.map(|table| table.number(CODEC)).transpose()?;
    let codec = codec.map(|[code]| Codec::parse(at, code)).transpose()?;
    let slots: Vec<Slot> = rows.vector(BUFFERS)?.iter().map(Slot::parse).collect();
    check_disjoint(at, &slots, body.len())?;
    let nodes: &[[u8; 16]] = rows.vector(NODES)?;
    let mut next = 0;
    for (f, (field, named)) in fields.iter().zip(columns).enumerate() {
        let at = At { file: at.file, field: &format!("{}: {}", at.field, field.name) };
        let (Some(node), Some(own)) = (nodes.get(f), slots.get(next..next + field.num_buffers)) else {
            return Err(at.error(format!("{} buffers", field.num_buffers), "fewer"));
        };
        next += field.num_buffers;
        let [num_values, num_nulls] = words(node);
        if index(num_values) != Some(len) {
            return Err(at.error(format!("{len} values"), num_values.to_string()));
        }
        let reader = Buffers { at: &at, body, codec };
        match (&field.kind, own) {
            (Kind::Number(_), _) if num_nulls != 0 => return Err(at.error("a value in every row", "rows without")),
            (Kind::Number(element), [_, values]) => reader.numbers(values, *element, len, &mut named.column)?,
            (Kind::Text { end_bytes }, [valid, ends, bytes]) => {
                let valid = if num_nulls != 0 { Some(reader.bytes(valid, len.div_ceil(8))?) } else { None };
                let ends = reader.ends(ends, *end_bytes, len)?;
                reader.texts(&ends, bytes, valid.as_deref(), &mut named.column)?;
            }
            _ => {}
        }
    }
    Ok(len)
}

/// Succeeds when the buffers fit into the body side by side: many that share their bytes would make much of a small file.
///
/// # Errors
/// When they do not.
fn check_disjoint(at: &At<'_>, slots: &[Slot], body_bytes: usize) -> Result<()> {
    let bytes = slots.iter().fold(0, |sum: usize, slot| sum.saturating_add(slot.len.unwrap_or(0)));
    if bytes <= body_bytes {
        return Ok(());
    }
    Err(at.error(format!("buffers of at most {body_bytes} bytes in all"), format!("{bytes} bytes (truncated?)")))
}
