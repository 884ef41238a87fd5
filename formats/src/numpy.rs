//! Arrays of numpy: element types, the `.npy` header.

use std::path::Path;

use crate::error::{FormatError, Result};

/// What every `.npy` file starts with.
const MAGIC: &[u8; 6] = b"\x93NUMPY";

/// Type of an array's elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Element {
    F16,
    F32,
    F64,
    /// Signed integer of 1, 2, 4 or 8 bytes.
    Int(usize),
    /// Unsigned integer of 1, 2, 4 or 8 bytes; a truth value is one of 1 byte.
    Uint(usize),
}

impl Element {
    /// The element type of a numpy type string such as `<f8`; `None` for big-endian and other types.
    pub(crate) fn parse(text: &str) -> Option<Self> {
        let text = text.strip_prefix(['<', '|', '=']).unwrap_or(text);
        let size = text.get(1..)?.parse().ok().filter(|size| [1, 2, 4, 8].contains(size))?;
        match (text.get(..1)?, size) {
            ("f", 2) => Some(Self::F16),
            ("f", 4) => Some(Self::F32),
            ("f", 8) => Some(Self::F64),
            ("i", size) => Some(Self::Int(size)),
            ("u", size) | ("b", size @ 1) => Some(Self::Uint(size)),
            _ => None,
        }
    }

    /// Bytes of one element.
    pub(crate) const fn size(self) -> usize {
        match self {
            Self::F16 => 2,
            Self::F32 => 4,
            Self::F64 => 8,
            Self::Int(size) | Self::Uint(size) => size,
        }
    }

    /// Whether the elements are whole numbers.
    pub(crate) const fn is_integer(self) -> bool {
        matches!(self, Self::Int(_) | Self::Uint(_))
    }

    /// The little-endian elements of `bytes` as f64.
    #[expect(clippy::cast_precision_loss, reason = "integers of the layouts are codes below 2^53")]
    pub(crate) fn floats(self, bytes: &[u8]) -> Vec<f64> {
        match self {
            Self::F16 => bytes.as_chunks().0.iter().map(|&b| half(u16::from_le_bytes(b))).collect(),
            Self::F32 => bytes.as_chunks().0.iter().map(|&b| f64::from(f32::from_le_bytes(b))).collect(),
            Self::F64 => bytes.as_chunks().0.iter().map(|&b| f64::from_le_bytes(b)).collect(),
            Self::Int(_) | Self::Uint(_) => self.ints(bytes).into_iter().map(|value| value as f64).collect(),
        }
    }

    /// The little-endian elements of `bytes` as integers; none for floating-point elements.
    pub(crate) fn ints(self, bytes: &[u8]) -> Vec<i64> {
        let (Self::Int(size) | Self::Uint(size)) = self else { return Vec::new() };
        let wide = |chunk: &[u8]| {
            let negative = matches!(self, Self::Int(_)) && chunk.last().is_some_and(|&high| high >= 0x80);
            let mut value = [if negative { 0xff } else { 0 }; 8];
            value[..size].copy_from_slice(chunk);
            i64::from_le_bytes(value)
        };
        bytes.chunks_exact(size).map(wide).collect()
    }
}

/// The value of an IEEE half-precision number.
///
/// # Formula
/// `(-1)^s 2^(e - 15) (1 + m / 1024)`, `(-1)^s 2^-14 m / 1024` for `e = 0`.
fn half(bits: u16) -> f64 {
    let exponent = i32::from(bits >> 10 & 0x1f);
    let fraction = f64::from(bits & 0x3ff) / 1024.0;
    let size = match exponent {
        0 => fraction * 2.0_f64.powi(-14),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        _ => (1.0 + fraction) * 2.0_f64.powi(exponent - 15),
    };
    if bits >> 15 == 1 { -size } else { size }
}

/// A dense array of numbers, row by row.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Array {
    /// Lengths of the axes.
    pub(crate) shape: Vec<usize>,
    /// `[product of shape]` values.
    pub(crate) values: Vec<f64>,
}

/// The bytes of an `.npy` file, taken apart.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Npy<'a> {
    /// Type of the elements.
    pub(crate) element: Element,
    /// Lengths of the axes.
    pub(crate) shape: Vec<usize>,
    /// The elements, row by row.
    pub(crate) data: &'a [u8],
}

impl<'a> Npy<'a> {
    /// The parts of the bytes of an `.npy` file; `file` and `name` are what errors name.
    ///
    /// # Errors
    /// Bytes that are no `.npy` file, element types that are no little-endian numbers, column order, missing bytes.
    pub(crate) fn parse(file: &Path, name: &str, bytes: &'a [u8]) -> Result<Self> {
        let npy = Self::parse_start(file, name, bytes)?;
        let size = npy.data_size();
        if size != Some(npy.data.len()) {
            let size = size.map_or("too many".to_owned(), |size| size.to_string());
            let expected = format!("{size} bytes of values for shape {:?}", npy.shape);
            let found = format!("{} (truncated?)", npy.data.len());
            return Err(FormatError::invalid(file, name, expected, found));
        }
        Ok(npy)
    }

    /// As [`Npy::parse`], of the start of a file: its data are those that are there.
    ///
    /// # Errors
    /// Those of [`Npy::parse`] but for missing bytes.
    pub(crate) fn parse_start(file: &Path, name: &str, bytes: &'a [u8]) -> Result<Self> {
        let error = |expected: &str, found: String| FormatError::invalid(file, name, expected, found);
        let header = header(bytes).ok_or_else(|| error("a numpy header", "other bytes (truncated?)".to_owned()))?;
        let element = field(header.text, "'descr':").and_then(quoted).and_then(Element::parse);
        let element =
            element.ok_or_else(|| error("an array of little-endian numbers", format!("`{}`", header.text)))?;
        let shape = field(header.text, "'shape':").and_then(shape);
        let row_order =
            field(header.text, "'fortran_order':").is_some_and(|text| text.trim_start().starts_with("False"));
        match shape {
            Some(shape) if row_order => Ok(Self { element, shape, data: header.data }),
            _ => Err(error("a shape and row order", format!("`{}`", header.text))),
        }
    }

    /// Bytes of all elements; `None` where no memory could hold them.
    pub(crate) fn data_size(&self) -> Option<usize> {
        self.shape.iter().try_fold(self.element.size(), |size, &side| size.checked_mul(side))
    }

    /// The values as f64.
    pub(crate) fn array(self) -> Array {
        Array { values: self.element.floats(self.data), shape: self.shape }
    }
}

/// Whether bytes begin as those of an `.npy` file do.
pub(crate) fn is_npy(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

/// The start of an `.npy` file of f32 in row order, whose values follow.
///
/// # Source
/// `numpy.lib.format`, version 1.0: magic, version, length of the header, header; together a multiple of 64 bytes.
pub(crate) fn header_of(shape: &[usize]) -> Vec<u8> {
    let sides: Vec<String> = shape.iter().map(usize::to_string).collect();
    let text = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({},), }}", sides.join(", "));
    let padding = 63 - (MAGIC.len() + 4 + text.len()) % 64;
    let length = u16::try_from(text.len() + padding + 1).unwrap_or(u16::MAX);
    let spaces = std::iter::repeat_n(b' ', padding);
    [MAGIC.as_slice(), &[1, 0], &length.to_le_bytes(), text.as_bytes()]
        .concat()
        .into_iter()
        .chain(spaces)
        .chain([b'\n'])
        .collect()
}

struct Header<'a> {
    text: &'a str,
    data: &'a [u8],
}

fn header(bytes: &[u8]) -> Option<Header<'_>> {
    let rest = bytes.strip_prefix(MAGIC)?;
    let (version, rest) = rest.split_first_chunk::<2>()?;
    let (length, rest) = match version[0] {
        1 => rest.split_first_chunk().map(|(l, rest)| (usize::from(u16::from_le_bytes(*l)), rest))?,
        2 | 3 => rest.split_first_chunk().map(|(l, rest)| (u32::from_le_bytes(*l) as usize, rest))?,
        _ => return None,
    };
    let (text, data) = rest.split_at_checked(length)?;
    Some(Header { text: std::str::from_utf8(text).ok()?.trim_end(), data })
}

/// What follows a key of the header's dictionary.
fn field<'a>(header: &'a str, key: &str) -> Option<&'a str> {
    header.split_once(key).map(|(_, rest)| rest)
}

fn quoted(text: &str) -> Option<&str> {
    text.trim_start().strip_prefix('\'')?.split('\'').next()
}

fn shape(text: &str) -> Option<Vec<usize>> {
    let inside = text.trim_start().strip_prefix('(')?.split(')').next()?;
    inside.split(',').map(str::trim).filter(|side| !side.is_empty()).map(|side| side.parse().ok()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn elements_of_every_width_are_read() {
        assert_eq!(Element::parse("<i2").unwrap().ints(&[0xff, 0xff, 1, 2]), [-1, 513]);
        assert_eq!(Element::parse("|u1").unwrap().floats(&[0, 255]), [0.0, 255.0]);
        assert_eq!(
            Element::parse("<f2").unwrap().floats(&[0x00, 0x3c, 0x01, 0x80, 0x00, 0xc5]),
            [1.0, -(2.0_f64.powi(-24)), -5.0]
        );
        assert!(Element::F16.floats(&[0x00, 0x7e])[0].is_nan() && Element::F16.floats(&[0x00, 0xfc])[0] < -1e308);
        for other in ["", "O", ">f8", "<f3", "<c8", "<M8[ns]", "|S5"] {
            assert!(Element::parse(other).is_none(), "{other}");
        }
    }

    #[test]
    fn an_array_ends_where_its_shape_says() {
        let file = |header: &str, data: &[u8]| {
            let mut bytes = MAGIC.to_vec();
            bytes.extend([1, 0]);
            bytes.extend(u16::try_from(header.len()).unwrap().to_le_bytes());
            bytes.extend(header.as_bytes());
            bytes.extend(data);
            bytes
        };
        let good = file("{'descr': '<i2', 'fortran_order': False, 'shape': (1, 2), }", &[1, 0, 2, 0]);
        let array = Npy::parse(Path::new("a.npz"), "data", &good).unwrap().array();
        assert_eq!((array.shape, array.values), (vec![1, 2], vec![1.0, 2.0]));
        for end in 0..good.len() {
            let message = Npy::parse(Path::new("a.npz"), "data", &good[..end]).unwrap_err().to_string();
            assert!(message.starts_with("a.npz: data: expected "), "{message}");
        }
        for header in ["", "{'descr': '<f8', 'fortran_order': True, 'shape': (1,)}", "{'descr': 'O', 'shape': (1,)}"] {
            assert!(Npy::parse(Path::new("a"), "data", &file(header, &[0; 8])).is_err(), "{header}");
        }
        let huge = file("{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999, 99999999999)}", &[]);
        assert!(Npy::parse(Path::new("a"), "data", &huge).is_err());
    }
}
