//! Tables of `FlatBuffers`. Every offset is checked where it is followed, so that no bytes make a reader go astray.
//!
//! # Source
//! <https://flatbuffers.dev/internals/>

use crate::{
    error::{FormatError, Result},
    importers::values::At,
};

/// Longest text, bytes: many fields of a small file may share one.
const MAX_TEXT_BYTES: usize = 4096;

/// A table: fields by their number, each of which may be absent.
#[derive(Clone, Copy, Debug)]
pub(super) struct Table<'a> {
    at: At<'a>,
    bytes: &'a [u8],
    /// Where the table begins. Its fields lie relative to this.
    start: usize,
    /// Two bytes for each field: where it lies, or 0.
    fields: &'a [u8],
}

impl<'a> Table<'a> {
    /// The table that `bytes` are about.
    ///
    /// # Errors
    /// Offsets that lead out of `bytes`.
    pub(super) fn root(at: At<'a>, bytes: &'a [u8]) -> Result<Self> {
        Self::behind(at, bytes, 0)
    }

    /// The table to which the offset at `place` leads.
    fn behind(at: At<'a>, bytes: &'a [u8], place: usize) -> Result<Self> {
        let find = || {
            let start = target(bytes, place)?;
            let back = i64::from(i32::from_le_bytes(part(bytes, start)?));
            let head = usize::try_from(i64::try_from(start).ok()? - back).ok()?;
            let size = usize::from(u16::from_le_bytes(part(bytes, head)?));
            let fields = bytes.get(head.checked_add(4)?..head.checked_add(size)?)?;
            Some(Self { at, bytes, start, fields })
        };
        find().ok_or_else(|| astray(at, place))
    }

    /// Where the field lies; `None` where it is absent.
    fn place(&self, field: usize) -> Option<usize> {
        let offset = usize::from(u16::from_le_bytes(*self.fields.as_chunks().0.get(field)?));
        (offset != 0).then(|| self.start.saturating_add(offset))
    }

    /// The bytes of a number; zeros where it is absent, which is the default of every number of Arrow.
    ///
    /// # Errors
    /// A field outside the bytes.
    pub(super) fn number<const N: usize>(&self, field: usize) -> Result<[u8; N]> {
        let Some(place) = self.place(field) else { return Ok([0; N]) };
        part(self.bytes, place).ok_or_else(|| astray(self.at, place))
    }

    /// The table in a field; `None` where it is absent.
    ///
    /// # Errors
    /// Offsets that lead out of the bytes.
    pub(super) fn table(&self, field: usize) -> Result<Option<Self>> {
        self.place(field).map(|place| Self::behind(self.at, self.bytes, place)).transpose()
    }

    /// The text in a field; empty where it is absent.
    ///
    /// # Errors
    /// Offsets that lead out of the bytes, a text of more than [`MAX_TEXT_BYTES`] or in another encoding than UTF-8.
    pub(super) fn text(&self, field: usize) -> Result<&'a str> {
        let bytes = self.vector::<1>(field)?.as_flattened();
        if bytes.len() > MAX_TEXT_BYTES {
            return Err(self.at.error(format!("names of at most {MAX_TEXT_BYTES} bytes"), bytes.len().to_string()));
        }
        std::str::from_utf8(bytes).map_err(|e| self.at.error("names in UTF-8", e.to_string()))
    }

    /// `[N]` bytes of each element of a vector of numbers or structs; none where it is absent.
    ///
    /// # Errors
    /// Offsets that lead out of the bytes.
    pub(super) fn vector<const N: usize>(&self, field: usize) -> Result<&'a [[u8; N]]> {
        let Some(place) = self.place(field) else { return Ok(&[]) };
        let find = || {
            let start = target(self.bytes, place)?;
            let size = to_usize(part(self.bytes, start)?)?.checked_mul(N)?;
            let start = start.checked_add(4)?;
            Some(self.bytes.get(start..start.checked_add(size)?)?.as_chunks().0)
        };
        find().ok_or_else(|| astray(self.at, place))
    }

    /// The tables of a vector; none where it is absent.
    ///
    /// # Errors
    /// Offsets that lead out of the bytes.
    pub(super) fn tables(&self, field: usize) -> Result<Vec<Self>> {
        let offsets = self.vector::<4>(field)?;
        let Some(place) = self.place(field).filter(|_| !offsets.is_empty()) else { return Ok(Vec::new()) };
        // The vector was just read: its place is within the bytes.
        let first =
            target(self.bytes, place).and_then(|start| start.checked_add(4)).ok_or_else(|| astray(self.at, place))?;
        (0..offsets.len()).map(|k| Self::behind(self.at, self.bytes, first + 4 * k)).collect()
    }
}

/// Where the offset at `place` leads; it counts from `place`.
fn target(bytes: &[u8], place: usize) -> Option<usize> {
    place.checked_add(to_usize(part(bytes, place)?)?)
}

fn part<const N: usize>(bytes: &[u8], start: usize) -> Option<[u8; N]> {
    bytes.get(start..)?.first_chunk().copied()
}

fn to_usize(bytes: [u8; 4]) -> Option<usize> {
    usize::try_from(u32::from_le_bytes(bytes)).ok()
}

/// The 64-bit numbers of a struct.
pub(super) fn words<const N: usize, const W: usize>(bytes: &[u8; N]) -> [i64; W] {
    let words = bytes.as_chunks().0;
    std::array::from_fn(|k| words.get(k).map_or(0, |&word| i64::from_le_bytes(word)))
}

/// A count or an offset of the format; `None` for negative ones.
pub(super) fn index(value: i64) -> Option<usize> {
    usize::try_from(value).ok()
}

fn astray(at: At<'_>, place: usize) -> FormatError {
    at.error("tables of Arrow", format!("an offset at byte {place} that leads out of them"))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn at() -> At<'static> {
        At { file: Path::new("t.feather"), field: "footer" }
    }

    /// A table of a 16-bit number (7), an absent field, the text `ab`, and two tables of one byte each (1, 2).
    fn sample() -> Vec<u8> {
        let mut bytes = vec![];
        bytes.extend(16_u32.to_le_bytes()); // 0: the root is at 16
        bytes.extend([12_u16, 14, 4, 0, 6, 10].map(u16::to_le_bytes).concat()); // 4: head of the root
        bytes.extend(12_i32.to_le_bytes()); // 16: back to the head
        bytes.extend(7_u16.to_le_bytes()); // 20: field 0
        bytes.extend(8_u32.to_le_bytes()); // 22: field 2, the text at 30
        bytes.extend(10_u32.to_le_bytes()); // 26: field 3, the vector at 36
        bytes.extend(2_u32.to_le_bytes()); // 30
        bytes.extend(b"ab"); // 34
        bytes.extend(2_u32.to_le_bytes()); // 36
        bytes.extend(14_u32.to_le_bytes()); // 40: a table at 54
        bytes.extend(15_u32.to_le_bytes()); // 44: a table at 59
        bytes.extend([6_u16, 5, 4].map(u16::to_le_bytes).concat()); // 48: head of both
        bytes.extend(6_i32.to_le_bytes()); // 54
        bytes.push(1);
        bytes.extend(11_i32.to_le_bytes()); // 59
        bytes.push(2);
        bytes
    }

    fn read(bytes: &[u8]) -> Result<(u16, u16, String, Vec<u8>)> {
        let root = Table::root(at(), bytes)?;
        let ones = root.tables(3)?.iter().map(|table| table.number::<1>(0).map(|[one]| one)).collect::<Result<_>>()?;
        let numbers = [root.number(0)?, root.number(1)?].map(u16::from_le_bytes);
        Ok((numbers[0], numbers[1], root.text(2)?.to_owned(), ones))
    }

    #[test]
    fn fields_are_read_and_absent_ones_are_zero() {
        assert_eq!(read(&sample()).unwrap(), (7, 0, "ab".to_owned(), vec![1, 2]));
        let bytes = sample();
        let root = Table::root(at(), &bytes).unwrap();
        assert!(root.table(1).unwrap().is_none() && root.tables(9).unwrap().is_empty());
        assert_eq!((root.text(1).unwrap(), root.number::<8>(4).unwrap()), ("", [0; 8]));
    }

    #[test]
    fn an_offset_out_of_the_bytes_is_an_error_wherever_it_stands() {
        let good = sample();
        for end in 0..good.len() {
            let message = read(&good[..end]).unwrap_err().to_string();
            assert!(message.starts_with("t.feather: footer: expected"), "{end}: {message}");
        }
        for place in [0, 16, 22, 26, 30, 36, 40, 54] {
            let mut bad = good.clone();
            bad[place + 2] = 0x7f;
            let message = read(&bad).unwrap_err().to_string();
            assert!(message.contains("expected tables of Arrow, found an offset at byte"), "{place}: {message}");
        }
    }
}
