//! The text header of a PLY file.

use std::path::Path;

use crate::error::{FormatError, Result};

/// Longest header, bytes.
pub(super) const MAX_HEADER_BYTES: usize = 1 << 16;

/// Type of a property.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn parse(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    /// Bytes of a value.
    pub(super) const fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

/// A column of the records.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) scalar: Scalar,
    /// Place of the value in a record, bytes.
    pub(super) offset: usize,
}

/// What a header says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Header {
    /// Number of records, which is not checked against the file's length yet.
    pub(super) count: u64,
    pub(super) properties: Vec<Property>,
    /// Bytes of a record.
    pub(super) stride: usize,
    /// Bytes of the header.
    pub(super) length: usize,
}

/// Which element the property lines belong to.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Element {
    None,
    Vertex,
    Skipped,
}

struct Parser<'a> {
    file: &'a Path,
    line: usize,
    element: Element,
    count: Option<u64>,
    properties: Vec<Property>,
    stride: usize,
}

/// The header at the start of `bytes`.
///
/// # Errors
/// Anything that the layout in [`crate::ply`] does not allow, by its line (1 is the first).
pub(super) fn parse(file: &Path, bytes: &[u8]) -> Result<Header> {
    if !bytes.starts_with(b"ply") {
        return Err(FormatError::invalid(file, "header line 1", "`ply`", kind(bytes)));
    }
    let text = &bytes[..bytes.len().min(MAX_HEADER_BYTES)];
    let mut parser = Parser { file, line: 0, element: Element::None, count: None, properties: Vec::new(), stride: 0 };
    let mut length = 0;
    while let Some(end) = text[length..].iter().position(|&b| b == b'\n') {
        let line = &text[length..length + end];
        let line = line.strip_suffix(b"\r").unwrap_or(line);
        length += end + 1;
        parser.line += 1;
        if line == b"end_header" {
            return parser.finish(length);
        }
        parser.line(line)?;
    }
    let found = format!("none in the first {} bytes", text.len());
    Err(FormatError::invalid(file, "header", "a line `end_header`", found))
}

/// What the first bytes of a file that is no PLY file are, in words.
fn kind(bytes: &[u8]) -> String {
    let line = bytes.split(|&b| b == b'\n' || b == b'\r').next().unwrap_or_default();
    let start = &line[..line.len().min(80)];
    match bytes {
        [] => "an empty file".to_owned(),
        [0x1f, 0x8b, ..] => "compressed data, as SPZ files are".to_owned(),
        [0x89, b'P', b'N', b'G', ..] => "a PNG image".to_owned(),
        [b'P', b'K', ..] => "a zip archive".to_owned(),
        _ => match std::str::from_utf8(start) {
            Ok(text) if !text.contains(char::is_control) => format!("`{text}`"),
            _ => "other bytes".to_owned(),
        },
    }
}

impl Parser<'_> {
    fn error<T>(&self, expected: &str, found: &str) -> Result<T> {
        let found: String = found.chars().take(80).collect();
        Err(FormatError::invalid(self.file, format!("header line {}", self.line), expected, format!("`{found}`")))
    }

    fn line(&mut self, line: &[u8]) -> Result<()> {
        let Ok(text) = std::str::from_utf8(line) else {
            return self.error("text", &String::from_utf8_lossy(line));
        };
        let words: Vec<&str> = text.split_ascii_whitespace().collect();
        match (self.line, words.as_slice()) {
            (1, ["ply"]) => Ok(()),
            (1, _) => self.error("`ply`", text),
            (2, ["format", "binary_little_endian", "1.0"]) => Ok(()),
            (2, _) => self.error("`format binary_little_endian 1.0` (the only kind that is read)", text),
            (_, ["comment" | "obj_info", ..]) => Ok(()),
            (_, ["element", name, count]) => self.element(name, count, text),
            (_, ["property", ..]) if self.element == Element::Skipped => Ok(()),
            (_, ["property", scalar, name]) if self.element == Element::Vertex => self.property(scalar, name, text),
            (_, ["property", "list", ..]) => self.error("a scalar property", text),
            _ => self.error("an element, a property of the element `vertex`, a comment or `end_header`", text),
        }
    }

    fn element(&mut self, name: &str, count: &str, text: &str) -> Result<()> {
        let Ok(count) = count.parse::<u64>() else {
            return self.error("a number of entries", text);
        };
        if name == "vertex" && self.count.is_none() {
            self.count = Some(count);
            self.element = Element::Vertex;
        } else if name != "vertex" && count == 0 {
            self.element = Element::Skipped;
        } else {
            return self.error("one element `vertex` and no other with entries", text);
        }
        Ok(())
    }

    fn property(&mut self, scalar: &str, name: &str, text: &str) -> Result<()> {
        let Some(scalar) = Scalar::parse(scalar) else {
            return self.error("a scalar type", text);
        };
        if self.properties.iter().any(|p| p.name == name) {
            return self.error("a property that occurs once", text);
        }
        self.properties.push(Property { name: name.to_owned(), scalar, offset: self.stride });
        self.stride += scalar.size();
        Ok(())
    }

    fn finish(self, length: usize) -> Result<Header> {
        match self.count {
            Some(count) => Ok(Header { count, properties: self.properties, stride: self.stride, length }),
            _ => self.error("an element `vertex` before", "end_header"),
        }
    }
}
