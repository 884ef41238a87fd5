//! Structures of Thrift's compact protocol, field by field.
//!
//! # Source
//! apache/thrift, `doc/specs/thrift-compact-protocol.md`.

use crate::{error::Result, importers::values::At};

/// Deepest nesting of structures and lists that are passed over.
const MAX_DEPTH: usize = 16;

/// What a field holds, as the protocol numbers it.
const BINARY: u8 = 8;
const LIST: [u8; 2] = [9, 10];
const MAP: u8 = 11;
const STRUCT: u8 = 12;

/// Structures that lie behind each other.
#[derive(Clone, Copy, Debug)]
pub(super) struct Thrift<'a> {
    at: At<'a>,
    bytes: &'a [u8],
    next: usize,
}

/// A field of a structure: its number and the type of its value, which is read or skipped next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Field {
    pub(super) number: i64,
    kind: u8,
}

impl<'a> Thrift<'a> {
    /// What `bytes` hold; `at` is what errors name.
    pub(super) const fn new(at: At<'a>, bytes: &'a [u8]) -> Self {
        Self { at, bytes, next: 0 }
    }

    /// Bytes that have been read.
    pub(super) const fn position(&self) -> usize {
        self.next
    }

    /// Calls `act` with each field of a structure; it reads or skips the value.
    ///
    /// # Errors
    /// Those of `act`; bytes that are no structure.
    pub(super) fn fields(&mut self, mut act: impl FnMut(&mut Self, Field) -> Result<()>) -> Result<()> {
        let mut last = 0;
        while let Some(field) = self.field(last)? {
            last = field.number;
            act(self, field)?;
        }
        Ok(())
    }

    fn field(&mut self, last: i64) -> Result<Option<Field>> {
        let head = self.byte()?;
        let (step, kind) = (head >> 4, head & 0xf);
        if kind == 0 {
            return Ok(None);
        }
        let number = if step == 0 { self.signed()? } else { last.saturating_add(i64::from(step)) };
        Ok(Some(Field { number, kind }))
    }

    fn byte(&mut self) -> Result<u8> {
        let byte =
            self.bytes.get(self.next).copied().ok_or_else(|| self.at.error("more bytes", "their end (truncated?)"))?;
        self.next += 1;
        Ok(byte)
    }

    fn varint(&mut self) -> Result<u64> {
        let mut value = 0;
        for shift in (0..64).step_by(7) {
            let byte = self.byte()?;
            value |= u64::from(byte & 0x7f) << shift;
            if byte & 0x80 == 0 {
                return Ok(value);
            }
        }
        Err(self.at.error("a number of at most 64 bits", "a longer one"))
    }

    fn signed(&mut self) -> Result<i64> {
        let bits = self.varint()?;
        Ok((bits >> 1).cast_signed() ^ -((bits & 1).cast_signed()))
    }

    /// The integer of a field.
    ///
    /// # Errors
    /// A value of another type.
    pub(super) fn integer(&mut self, field: Field) -> Result<i64> {
        match field.kind {
            3 => Ok(i64::from(self.byte()?.cast_signed())),
            4..=6 => self.signed(),
            other => Err(self.wrong("an integer", field, other)),
        }
    }

    /// The truth value of a field.
    ///
    /// # Errors
    /// A value of another type.
    pub(super) fn truth(&self, field: Field) -> Result<bool> {
        match field.kind {
            1 | 2 => Ok(field.kind == 1),
            other => Err(self.wrong("a truth value", field, other)),
        }
    }

    /// The text of a field, of at most `limit` bytes.
    ///
    /// # Errors
    /// A value of another type; bytes that are no UTF-8, or more.
    pub(super) fn text(&mut self, field: Field, limit: usize) -> Result<String> {
        if field.kind != BINARY {
            return Err(self.wrong("a text", field, field.kind));
        }
        let length = self.varint()?;
        let short = usize::try_from(length).ok().filter(|&length| length <= limit);
        let bytes = short.and_then(|length| self.bytes.get(self.next..self.next.checked_add(length)?));
        let bytes = bytes
            .ok_or_else(|| self.at.error(format!("a text of at most {limit} bytes"), format!("{length} bytes")))?;
        self.next += bytes.len();
        std::str::from_utf8(bytes).map(str::to_owned).map_err(|e| self.at.error("UTF-8 text", e.to_string()))
    }

    /// Calls `act` with each entry of the list of a field, as if it were a field of the list's number; it reads the value.
    ///
    /// # Errors
    /// A value of another type; those of `act`.
    pub(super) fn list(&mut self, field: Field, mut act: impl FnMut(&mut Self, Field) -> Result<()>) -> Result<()> {
        if !LIST.contains(&field.kind) {
            return Err(self.wrong("a list", field, field.kind));
        }
        let (count, kind) = self.list_head()?;
        for _ in 0..count {
            act(self, Field { number: field.number, kind })?;
        }
        Ok(())
    }

    /// The number of entries of a list, each of a byte at least, and their type.
    fn list_head(&mut self) -> Result<(u64, u8)> {
        let head = self.byte()?;
        let count = if head >> 4 == 0xf { self.varint()? } else { u64::from(head >> 4) };
        let left = (self.bytes.len() - self.next) as u64;
        if count > left {
            return Err(self.at.error(format!("a list of at most {left} entries"), count.to_string()));
        }
        Ok((count, head & 0xf))
    }

    /// Checks that the value is a structure.
    ///
    /// # Errors
    /// A value of another type.
    pub(super) fn structure(&self, field: Field) -> Result<()> {
        if field.kind == STRUCT { Ok(()) } else { Err(self.wrong("a structure", field, field.kind)) }
    }

    /// Passes over the value of a field.
    ///
    /// # Errors
    /// Bytes that are no value, or too deep.
    pub(super) fn skip(&mut self, field: Field) -> Result<()> {
        self.pass(field.kind, MAX_DEPTH, false)
    }

    fn pass(&mut self, kind: u8, depth: usize, in_list: bool) -> Result<()> {
        let Some(deeper) = depth.checked_sub(1) else {
            return Err(self.at.error(format!("at most {MAX_DEPTH} levels"), "more"));
        };
        match kind {
            // A field's type is its truth value; in a list each has a byte.
            1 | 2 if !in_list => Ok(()),
            1..=3 => self.byte().map(drop),
            4..=6 => self.varint().map(drop),
            7 => self.jump(8),
            BINARY => {
                let length = self.varint()?;
                self.jump(length)
            }
            9 | 10 => {
                let (count, kind) = self.list_head()?;
                (0..count).try_for_each(|_| self.pass(kind, deeper, true))
            }
            MAP => {
                let count = self.varint()?;
                if count == 0 {
                    return Ok(());
                }
                let kinds = self.byte()?;
                (0..count).try_for_each(|_| {
                    self.pass(kinds >> 4, deeper, true)?;
                    self.pass(kinds & 0xf, deeper, true)
                })
            }
            STRUCT => {
                let mut last = 0;
                while let Some(field) = self.field(last)? {
                    last = field.number;
                    self.pass(field.kind, deeper, false)?;
                }
                Ok(())
            }
            other => Err(self.at.error("a type of Thrift", other.to_string())),
        }
    }

    fn jump(&mut self, length: u64) -> Result<()> {
        let end = usize::try_from(length).ok().and_then(|length| self.next.checked_add(length));
        match end.filter(|&end| end <= self.bytes.len()) {
            Some(end) => {
                self.next = end;
                Ok(())
            }
            None => Err(self.at.error("a value within its file", format!("{length} bytes"))),
        }
    }

    fn wrong(&self, expected: &str, field: Field, kind: u8) -> crate::error::FormatError {
        self.at.error(expected, format!("type {kind} in field {}", field.number))
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn on<T>(bytes: &[u8], act: impl FnOnce(&mut Thrift<'_>) -> Result<T>) -> std::result::Result<T, String> {
        let mut thrift = Thrift::new(At { file: Path::new("f"), field: "footer" }, bytes);
        act(&mut thrift).map_err(|e| e.to_string())
    }

    #[test]
    fn fields_are_read_and_passed_over() {
        // 1: i32 -3, 2: text "ab", 3: list of i32 [1, 2], 5: true, 6: structure { 1: i64 300 }, 7: list of lists.
        let bytes = [
            0x15, 5, 0x18, 2, b'a', b'b', 0x19, 0x25, 2, 4, 0x21, 0x1c, 0x16, 0xd8, 0x04, 0x00, 0x19, 0x19, 0x15, 2,
            0x00,
        ];
        let read = |thrift: &mut Thrift<'_>| {
            let mut found = Vec::new();
            thrift.fields(|thrift, field| {
                match field.number {
                    1 => found.push(thrift.integer(field)?.to_string()),
                    2 => found.push(thrift.text(field, 9)?),
                    3 => thrift.list(field, |thrift, entry| {
                        found.push(thrift.integer(entry)?.to_string());
                        Ok(())
                    })?,
                    5 => found.push(thrift.truth(field)?.to_string()),
                    _ => thrift.skip(field)?,
                }
                Ok(())
            })?;
            Ok((found.join(" "), thrift.position()))
        };
        assert_eq!(on(&bytes, read), Ok(("-3 ab 1 2 true".to_owned(), bytes.len())));
        for end in 0..bytes.len() {
            assert!(on(&bytes[..end], read).is_err(), "{end}");
        }
    }

    #[test]
    fn counts_and_depths_that_lie_are_refused() {
        let skip = |thrift: &mut Thrift<'_>| thrift.fields(Thrift::skip);
        assert!(on(&[0x19, 0xf5, 0xff, 0xff, 0x7f, 0], skip).unwrap_err().contains("a list of at most 1 entries"));
        assert!(on(&[0x18, 0x7f, 0], skip).unwrap_err().contains("a value within its file"));
        assert!(on(&[&[0x19][..], &[0x19; 40]].concat(), skip).unwrap_err().contains("at most 16 levels"));
        assert!(on(&[0x1e, 0], skip).unwrap_err().contains("a type of Thrift"));
        // A map of many entries that take no bytes would never end.
        assert!(on(&[0x1b, 0xff, 0xff, 0xff, 0xff, 0x0f, 0xcc, 0x00], skip).is_err());
    }
}
