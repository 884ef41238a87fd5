//! Batches of rows: a message that says where the buffers are, and the buffers.

use std::{borrow::Cow, io::Read};

use arrow_ipc::{Block, CompressionType, RecordBatch, root_as_message};

use super::columns::{Field, Kind};
use crate::{
    error::Result,
    importers::{
        table::{Column, Named},
        values::At,
    },
    numpy::Element,
    read::unpacked_limit,
};

/// What stands before a message's length.
const CONTINUATION: [u8; 4] = [0xff; 4];

/// Bytes at an address that tables of 8-byte values can be read from.
pub(super) struct Aligned {
    words: Vec<u64>,
    len: usize,
}

impl Aligned {
    pub(super) fn bytes(&self) -> &[u8] {
        &bytemuck::cast_slice(&self.words)[..self.len]
    }
}

/// A copy of `bytes`.
pub(super) fn aligned(bytes: &[u8]) -> Aligned {
    let mut words = vec![0_u64; bytes.len().div_ceil(8)];
    bytemuck::cast_slice_mut(&mut words)[..bytes.len()].copy_from_slice(bytes);
    Aligned { words, len: bytes.len() }
}

/// The number of rows of a batch, whose values are added to `columns`.
pub(super) fn record_batch(
    at: &At<'_>,
    file: &[u8],
    block: &Block,
    fields: &[Field],
    columns: &mut [Named],
) -> Result<usize> {
    let truncated = || at.error("a message and its body", "an end outside the file (truncated?)");
    let part = |start: usize, length: usize| file.get(start..start.checked_add(length)?);
    let (start, head) = (index(block.offset()), index(i64::from(block.metaDataLength())));
    let message = start.zip(head).and_then(|(start, head)| part(start, head)).ok_or_else(truncated)?;
    let body = start.zip(head).and_then(|(start, head)| start.checked_add(head));
    let body = body.zip(index(block.bodyLength())).and_then(|(start, length)| part(start, length));
    let body = body.ok_or_else(truncated)?;
    let message = message.strip_prefix(&CONTINUATION).unwrap_or(message);
    let message = aligned(message.get(4..).ok_or_else(truncated)?);
    let message = root_as_message(message.bytes()).map_err(|e| at.error("a message of Arrow", e.to_string()))?;
    let batch = message.header_as_record_batch().ok_or_else(|| at.error("rows", "another message"))?;
    read_rows(at, body, &batch, fields, columns)
}

fn read_rows(
    at: &At<'_>,
    body: &[u8],
    batch: &RecordBatch<'_>,
    fields: &[Field],
    columns: &mut [Named],
) -> Result<usize> {
    let codec = batch.compression().map(|compression| compression.codec());
    let len = index(batch.length()).ok_or_else(|| at.error("a number of rows", batch.length().to_string()))?;
    let buffers: Vec<&arrow_ipc::Buffer> = batch.buffers().into_iter().flatten().collect();
    let nodes: Vec<&arrow_ipc::FieldNode> = batch.nodes().into_iter().flatten().collect();
    let mut next = 0;
    for (f, (field, named)) in fields.iter().zip(columns).enumerate() {
        let at = At { file: at.file, field: &format!("{}: {}", at.field, field.name) };
        let (Some(node), Some(own)) = (nodes.get(f), buffers.get(next..next + field.num_buffers)) else {
            return Err(at.error(format!("{} buffers", field.num_buffers), "fewer"));
        };
        next += field.num_buffers;
        if index(node.length()) != Some(len) {
            return Err(at.error(format!("{len} values"), node.length().to_string()));
        }
        let reader = Buffers { at: &at, body, codec };
        let has_nulls = node.null_count() != 0;
        match (&field.kind, own) {
            (Kind::Number(_), _) if has_nulls => return Err(at.error("a value in every row", "rows without")),
            (Kind::Number(element), [_, values]) => reader.numbers(values, *element, len, &mut named.column)?,
            (Kind::Text { end_bytes }, [valid, ends, bytes]) => {
                let valid = if has_nulls { Some(reader.bytes(valid, len.div_ceil(8))?) } else { None };
                let ends = reader.ends(ends, *end_bytes, len)?;
                reader.texts(&ends, bytes, valid.as_deref(), &mut named.column)?;
            }
            _ => {}
        }
    }
    Ok(len)
}

/// A count or an offset of the format; `None` for negative ones.
fn index(value: i64) -> Option<usize> {
    usize::try_from(value).ok()
}

struct Buffers<'a> {
    at: &'a At<'a>,
    body: &'a [u8],
    codec: Option<CompressionType>,
}

impl<'a> Buffers<'a> {
    /// The first `len` bytes of a buffer, decompressed.
    fn bytes(&self, buffer: &arrow_ipc::Buffer, len: usize) -> Result<Cow<'a, [u8]>> {
        let truncated = || self.at.error(format!("{len} bytes"), "fewer (truncated?)");
        let stored = index(buffer.offset()).zip(index(buffer.length()));
        let stored = stored.and_then(|(start, length)| self.body.get(start..start.checked_add(length)?));
        let stored = stored.ok_or_else(truncated)?;
        let Some(codec) = self.codec.filter(|_| !stored.is_empty()) else {
            return stored.get(..len).map(Cow::Borrowed).ok_or_else(truncated);
        };
        let (size, packed) = stored.split_first_chunk().ok_or_else(truncated)?;
        let size = i64::from_le_bytes(*size);
        if size == -1 {
            return packed.get(..len).map(Cow::Borrowed).ok_or_else(truncated);
        }
        let limit = len as u64;
        if limit > unpacked_limit(packed.len() as u64) {
            let expected =
                format!("at most {} bytes unpacked from {}", unpacked_limit(packed.len() as u64), packed.len());
            return Err(self.at.error(expected, limit.to_string()));
        }
        if index(size).is_none_or(|size| size < len) {
            return Err(truncated());
        }
        let mut bytes = Vec::new();
        let read = match codec {
            CompressionType::LZ4_FRAME => {
                lz4_flex::frame::FrameDecoder::new(packed).take(limit).read_to_end(&mut bytes).map(drop)
            }
            CompressionType::ZSTD => {
                zstd::Decoder::new(packed).and_then(|decoder| decoder.take(limit).read_to_end(&mut bytes)).map(drop)
            }
            other => return Err(self.at.error("LZ4 or Zstandard", format!("codec {}", other.0))),
        };
        read.map_err(|e| self.at.error("compressed bytes", e.to_string()))?;
        if bytes.len() == len { Ok(Cow::Owned(bytes)) } else { Err(truncated()) }
    }

    fn numbers(&self, buffer: &arrow_ipc::Buffer, element: Element, len: usize, column: &mut Column) -> Result<()> {
        let size = len.checked_mul(element.size());
        let size = size.ok_or_else(|| self.at.error("a number of rows", len.to_string()))?;
        let bytes = self.bytes(buffer, size)?;
        match column {
            Column::Ints(values) => values.extend(element.ints(&bytes)),
            Column::Floats(values) => values.extend(element.floats(&bytes)),
            Column::Texts(_) | Column::Other(_) => {}
        }
        Ok(())
    }

    /// `[len + 1]` where each text starts and the last one ends.
    fn ends(&self, buffer: &arrow_ipc::Buffer, end_bytes: usize, len: usize) -> Result<Vec<usize>> {
        if len == 0 {
            return Ok(vec![0]);
        }
        let size = len.checked_add(1).and_then(|count| count.checked_mul(end_bytes));
        let size = size.ok_or_else(|| self.at.error("a number of rows", len.to_string()))?;
        let ends = Element::Int(end_bytes).ints(&self.bytes(buffer, size)?);
        let ends: Option<Vec<usize>> = ends.into_iter().map(index).collect();
        ends.filter(|ends| ends.is_sorted()).ok_or_else(|| self.at.error("ends of texts that ascend", "others"))
    }

    fn texts(
        &self,
        ends: &[usize],
        buffer: &arrow_ipc::Buffer,
        valid: Option<&[u8]>,
        column: &mut Column,
    ) -> Result<()> {
        let bytes = self.bytes(buffer, ends.last().copied().unwrap_or(0))?;
        let Column::Texts(texts) = column else { return Ok(()) };
        for (row, pair) in ends.windows(2).enumerate() {
            let is_valid = valid.is_none_or(|bits| bits[row / 8] >> (row % 8) & 1 == 1);
            let text = std::str::from_utf8(&bytes[pair[0]..pair[1]])
                .map_err(|e| self.at.error(format!("UTF-8 text in row {row}"), e.to_string()))?;
            texts.push(is_valid.then(|| text.to_owned()));
        }
        Ok(())
    }
}
