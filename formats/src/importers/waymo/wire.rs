//! Messages of Protocol Buffers, field by field: small values are read, long ones are passed over by their place in the file.
//!
//! # Source
//! <https://protobuf.dev/programming-guides/encoding>

use std::{
    io::{ErrorKind, Read, Seek},
    ops::Range,
    path::Path,
};

use crate::error::{FormatError, Result};

/// Most bytes of a text or of a list of numbers inside a message.
const MAX_SMALL: u64 = 1 << 20;

/// Bytes that messages lie in, and where they are read from.
pub(super) struct Input<'a, R> {
    path: &'a Path,
    /// What errors name beside the file.
    place: String,
    reader: R,
    position: u64,
}

/// The value of a field.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Value {
    Varint(u64),
    Fixed64([u8; 8]),
    Fixed32([u8; 4]),
    /// A text, a message, packed numbers: where its bytes are.
    Bytes(Range<u64>),
}

/// A field of a message.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Field {
    pub(super) number: u32,
    pub(super) value: Value,
}

/// What is left of a message.
#[derive(Clone, Debug)]
pub(super) struct Fields(Range<u64>);

impl Fields {
    /// The fields of the message whose bytes are there.
    pub(super) const fn new(message: Range<u64>) -> Self {
        Self(message)
    }

    /// The next field.
    ///
    /// # Errors
    /// Bytes that are no field; one that would end outside its message.
    pub(super) fn next<R: Read + Seek>(&mut self, input: &mut Input<'_, R>) -> Result<Option<Field>> {
        let Self(rest) = self;
        if rest.start >= rest.end {
            return Ok(None);
        }
        input.seek(rest.start)?;
        let key = input.varint(rest.end)?;
        let number = u32::try_from(key >> 3).ok().filter(|number| (1..1 << 29).contains(number));
        let Some(number) = number else {
            return Err(input.error("the key of a field", format!("{key}")));
        };
        let value = match key & 7 {
            0 => Value::Varint(input.varint(rest.end)?),
            1 => Value::Fixed64(input.array(rest.end)?),
            2 => {
                let length = input.varint(rest.end)?;
                let start = input.position;
                let left = rest.end - start;
                if length > left {
                    let expected = format!("a field {number} of at most {left} bytes, what is left of its message");
                    return Err(input.error(expected, format!("{length} bytes")));
                }
                rest.start = start + length;
                return Ok(Some(Field { number, value: Value::Bytes(start..start + length) }));
            }
            5 => Value::Fixed32(input.array(rest.end)?),
            other => {
                return Err(input.error(format!("a wire type of field {number} of 0, 1, 2 or 5"), other.to_string()));
            }
        };
        rest.start = input.position;
        Ok(Some(Field { number, value }))
    }
}

impl<'a, R: Read + Seek> Input<'a, R> {
    /// The bytes of `reader`, which stands at its start; errors name `path` and `place`.
    pub(super) const fn new(path: &'a Path, place: String, reader: R) -> Self {
        Self { path, place, reader, position: 0 }
    }

    /// An error about what is read now.
    pub(super) fn error(&self, expected: impl Into<String>, found: impl Into<String>) -> FormatError {
        FormatError::invalid(self.path, format!("{}, byte {}", self.place, self.position), expected, found)
    }

    fn seek(&mut self, to: u64) -> Result<()> {
        let step = i64::try_from(i128::from(to) - i128::from(self.position))
            .map_err(|e| self.error("a place in the file", e.to_string()))?;
        self.reader.seek_relative(step).map_err(|e| FormatError::io(self.path, "read", e))?;
        self.position = to;
        Ok(())
    }

    fn array<const N: usize>(&mut self, end: u64) -> Result<[u8; N]> {
        if end.saturating_sub(self.position) < N as u64 {
            return Err(self.error(format!("a value of {N} bytes"), "the end of its message"));
        }
        let mut bytes = [0; N];
        self.reader.read_exact(&mut bytes).map_err(|e| self.failed(e))?;
        self.position += N as u64;
        Ok(bytes)
    }

    fn failed(&self, error: std::io::Error) -> FormatError {
        match error.kind() {
            ErrorKind::UnexpectedEof => self.error("more bytes", "the end of the file (truncated?)"),
            _ => FormatError::io(self.path, "read", error),
        }
    }

    fn varint(&mut self, end: u64) -> Result<u64> {
        let mut value = 0;
        for shift in (0..64).step_by(7) {
            let [byte] = self.array(end)?;
            let bits = u64::from(byte & 0x7f);
            if shift == 63 && bits > 1 {
                break;
            }
            value |= bits << shift;
            if byte & 0x80 == 0 {
                return Ok(value);
            }
        }
        Err(self.error("a number of at most 64 bits", "a longer one"))
    }

    /// The bytes of a field.
    ///
    /// # Errors
    /// More than `limit`; a file that cannot be read.
    pub(super) fn bytes(&mut self, place: &Range<u64>, limit: u64) -> Result<Vec<u8>> {
        let length = place.end.saturating_sub(place.start);
        self.seek(place.start)?;
        if length > limit {
            return Err(self.error(format!("at most {limit} bytes"), format!("{length}")));
        }
        let mut bytes = vec![0; usize::try_from(length).unwrap_or(0)];
        self.reader.read_exact(&mut bytes).map_err(|e| self.failed(e))?;
        self.position = place.end;
        Ok(bytes)
    }

    /// The text of a field.
    ///
    /// # Errors
    /// Bytes that are no UTF-8, or too many; a number.
    pub(super) fn text(&mut self, value: &Value) -> Result<String> {
        let Value::Bytes(place) = value else { return Err(self.error("a text", "a number")) };
        let bytes = self.bytes(place, MAX_SMALL)?;
        String::from_utf8(bytes).map_err(|e| self.error("UTF-8 text", e.to_string()))
    }

    /// Adds the f64 of a field to `values`, one or a packed list.
    ///
    /// # Errors
    /// A value of another type; a list that is too long or ends within a number.
    pub(super) fn doubles(&mut self, value: &Value, values: &mut Vec<f64>) -> Result<()> {
        match value {
            Value::Fixed64(bytes) => values.push(f64::from_le_bytes(*bytes)),
            Value::Bytes(place) => {
                let bytes = self.bytes(place, MAX_SMALL)?;
                let (whole, rest) = bytes.as_chunks();
                if !rest.is_empty() {
                    return Err(self.error("numbers of 8 bytes", format!("{} bytes", bytes.len())));
                }
                values.extend(whole.iter().map(|bytes| f64::from_le_bytes(*bytes)));
            }
            _ => return Err(self.error("a number of 8 bytes", "another type")),
        }
        if values.len() as u64 > MAX_SMALL / 8 {
            return Err(self.error(format!("at most {} numbers", MAX_SMALL / 8), "more"));
        }
        Ok(())
    }

    /// The only f64 of a field.
    ///
    /// # Errors
    /// A value of another type.
    pub(super) fn double(&self, value: &Value) -> Result<f64> {
        match value {
            Value::Fixed64(bytes) => Ok(f64::from_le_bytes(*bytes)),
            _ => Err(self.error("a number of 8 bytes", "another type")),
        }
    }

    /// The integer of a field.
    ///
    /// # Errors
    /// A value of another type.
    pub(super) fn integer(&self, value: &Value) -> Result<i64> {
        match value {
            Value::Varint(bits) => Ok(bits.cast_signed()),
            _ => Err(self.error("an integer", "another type")),
        }
    }

    /// The next integer of a packed list, of which `rest` is left.
    ///
    /// # Errors
    /// A list that ends within a number.
    pub(super) fn next_integer(&mut self, rest: &mut Range<u64>) -> Result<i64> {
        self.seek(rest.start)?;
        let value = self.varint(rest.end)?;
        rest.start = self.position;
        Ok(value.cast_signed())
    }

    /// Where the message of a field is.
    ///
    /// # Errors
    /// A value of another type.
    pub(super) fn message(&self, value: &Value) -> Result<Range<u64>> {
        match value {
            Value::Bytes(place) => Ok(place.clone()),
            _ => Err(self.error("a message", "a number")),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    fn all(bytes: &[u8]) -> std::result::Result<Vec<Field>, String> {
        let mut input = Input::new(Path::new("f"), "frame 0".to_owned(), Cursor::new(bytes));
        let (mut fields, mut found) = (Fields::new(0..bytes.len() as u64), Vec::new());
        while let Some(field) = fields.next(&mut input).map_err(|e| e.to_string())? {
            found.push(field);
        }
        Ok(found)
    }

    #[test]
    fn fields_of_every_type() {
        let bytes = [0x08, 0x96, 0x01, 0x12, 0x02, b'a', b'b', 0x1d, 1, 2, 3, 4, 0x21, 1, 2, 3, 4, 5, 6, 7, 8];
        let want = [
            Value::Varint(150),
            Value::Bytes(5..7),
            Value::Fixed32([1, 2, 3, 4]),
            Value::Fixed64([1, 2, 3, 4, 5, 6, 7, 8]),
        ];
        let want: Vec<Field> = (1..).zip(want).map(|(number, value)| Field { number, value }).collect();
        assert_eq!(all(&bytes).unwrap(), want);
        assert_eq!(
            all(&[0x08, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x01]).unwrap()[0].value,
            Value::Varint(u64::MAX)
        );
    }

    #[test]
    fn lengths_that_lie_are_refused_with_the_place() {
        for (bytes, what) in [
            (&[0x12, 0x05, 1, 2][..], "a field 2 of at most 2 bytes, what is left of its message, found 5 bytes"),
            (&[0x12, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x01], "a field 2 of at most 0 bytes"),
            (&[0x08, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x02], "at most 64 bits"),
            (&[0x08, 0x80], "the end of its message"),
            (&[0x1d, 1, 2], "a value of 4 bytes, found the end of its message"),
            (&[0x0b], "wire type of field 1"),
            (&[0x00], "the key of a field, found 0"),
        ] {
            let message = all(bytes).unwrap_err();
            assert!(message.starts_with("f: frame 0, byte ") && message.contains(what), "{message}");
        }
    }
}
