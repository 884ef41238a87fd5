//! Buffers of a batch: bytes as they are, or compressed, to the values of a column.

use std::{borrow::Cow, io::Read};

use ruzstd::decoding::StreamingDecoder;

use super::flatbuffer::{index, words};
use crate::{
    error::Result,
    importers::{table::Column, values::At},
    numpy::Element,
    read::unpacked_limit,
};

/// How the buffers of a batch are compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Codec {
    Lz4,
    Zstd,
}

impl Codec {
    /// The codec of this code.
    ///
    /// # Errors
    /// A code that Arrow does not have.
    pub(super) fn parse(at: &At<'_>, code: u8) -> Result<Self> {
        match code {
            0 => Ok(Self::Lz4),
            1 => Ok(Self::Zstd),
            other => Err(at.error("LZ4 or Zstandard", format!("codec {other}"))),
        }
    }

    /// The first `limit` bytes that `packed` unfolds to; a frame that refers farther back than `window` bytes is an error.
    fn unpacked(self, packed: &[u8], limit: u64, window: u64) -> std::result::Result<Vec<u8>, String> {
        let mut bytes = Vec::new();
        let read = match self {
            Self::Lz4 => lz4_flex::frame::FrameDecoder::new(packed).take(limit).read_to_end(&mut bytes),
            Self::Zstd => {
                let decoder = StreamingDecoder::new_with_max_window_size(packed, window).map_err(|e| e.to_string())?;
                decoder.take(limit).read_to_end(&mut bytes)
            }
        };
        read.map(|_| bytes).map_err(|e| e.to_string())
    }
}

/// Where a buffer lies in the body; `None` stands for negative numbers.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slot {
    start: Option<usize>,
    pub(super) len: Option<usize>,
}

impl Slot {
    pub(super) fn parse(bytes: &[u8; 16]) -> Self {
        let [start, len] = words(bytes);
        Self { start: index(start), len: index(len) }
    }
}

/// The buffers of one column.
pub(super) struct Buffers<'a> {
    pub(super) at: &'a At<'a>,
    pub(super) body: &'a [u8],
    pub(super) codec: Option<Codec>,
}

impl<'a> Buffers<'a> {
    /// The first `len` bytes of a buffer, decompressed.
    pub(super) fn bytes(&self, buffer: &Slot, len: usize) -> Result<Cow<'a, [u8]>> {
        let truncated = || self.at.error(format!("{len} bytes"), "fewer (truncated?)");
        let stored = buffer.start.zip(buffer.len);
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
        let (limit, most) = (len as u64, unpacked_limit(packed.len() as u64));
        if limit > most {
            let expected = format!("at most {most} bytes unpacked from {}", packed.len());
            return Err(self.at.error(expected, limit.to_string()));
        }
        if index(size).is_none_or(|size| size < len) {
            return Err(truncated());
        }
        let bytes = codec.unpacked(packed, limit, most).map_err(|e| self.at.error("compressed bytes", e))?;
        if bytes.len() == len { Ok(Cow::Owned(bytes)) } else { Err(truncated()) }
    }

    /// Adds the `len` values of a buffer to a column.
    pub(super) fn numbers(&self, buffer: &Slot, element: Element, len: usize, column: &mut Column) -> Result<()> {
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
    pub(super) fn ends(&self, buffer: &Slot, end_bytes: usize, len: usize) -> Result<Vec<usize>> {
        if len == 0 {
            return Ok(vec![0]);
        }
        let size = len.checked_add(1).and_then(|count| count.checked_mul(end_bytes));
        let size = size.ok_or_else(|| self.at.error("a number of rows", len.to_string()))?;
        let ends = Element::Int(end_bytes).ints(&self.bytes(buffer, size)?);
        let ends: Option<Vec<usize>> = ends.into_iter().map(index).collect();
        ends.filter(|ends| ends.is_sorted()).ok_or_else(|| self.at.error("ends of texts that ascend", "others"))
    }

    /// Adds the texts between `ends` to a column; `valid` has a bit for each row that has one.
    pub(super) fn texts(&self, ends: &[usize], buffer: &Slot, valid: Option<&[u8]>, column: &mut Column) -> Result<()> {
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
