//! What lies inside a record as bytes: image files and packed matrices.

use std::{
    fs::File,
    io::{BufReader, Cursor, Read, Seek},
    ops::Range,
    path::Path,
};

use flate2::bufread::ZlibDecoder;

use super::{
    snapshot::RangeImage,
    wire::{Field, Fields, Input, Value},
};
use crate::{
    error::{FormatError, Result},
    read::read_unpacked,
};

/// Longest packed range image, bytes.
const MAX_PACKED: u64 = 1 << 28;
/// Most dimensions of a matrix that are looked at.
const MAX_DIMS: usize = 3;

type Place = Range<u64>;

/// The bytes of a file inside a record; `name` is what errors call it.
///
/// # Errors
/// More than `limit`, or a file that cannot be read.
pub(super) fn content(path: &Path, name: &str, place: &Place, limit: u64) -> Result<Vec<u8>> {
    let file = File::open(path).map_err(|e| FormatError::io(path, "read", e))?;
    Input::new(path, name.to_owned(), BufReader::new(file)).bytes(place, limit)
}

/// The range image whose packed message is there.
///
/// # Errors
/// Bytes that are damaged, or no matrix of three dimensions.
pub(super) fn range_image(path: &Path, name: &str, place: &Place) -> Result<RangeImage> {
    let packed = content(path, name, place, MAX_PACKED)?;
    let message =
        read_unpacked(path, &format!("{name}: zlib"), packed.len() as u64, ZlibDecoder::new(packed.as_slice()))?;
    of_message(path, name, &message)
}

/// The range image that a message `MatrixFloat` says.
fn of_message(path: &Path, name: &str, message: &[u8]) -> Result<RangeImage> {
    let (mut dims, mut values) = (Vec::new(), Vec::new());
    let mut input = Input::new(path, format!("{name}: unpacked"), Cursor::new(message));
    let mut fields = Fields::new(0..message.len() as u64);
    while let Some(Field { number, value }) = fields.next(&mut input)? {
        match (number, value) {
            (1, Value::Bytes(place)) => {
                let bytes = input.bytes(&place, message.len() as u64)?;
                values.extend(bytes.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)));
            }
            (1, Value::Fixed32(bytes)) => values.push(f32::from_le_bytes(bytes)),
            (2, Value::Bytes(place)) => dims = shape(&mut input, place)?,
            _ => {}
        }
    }
    RangeImage::new(&dims, values)
        .map_err(|found| FormatError::invalid(path, name, "a matrix of three dimensions", found))
}

/// The dimensions that a message `MatrixShape` says.
fn shape<R: Read + Seek>(input: &mut Input<'_, R>, message: Place) -> Result<Vec<i64>> {
    let (mut fields, mut dims) = (Fields::new(message), Vec::new());
    while let Some(Field { number, value }) = fields.next(input)? {
        match (number, &value) {
            (1, Value::Bytes(packed)) => {
                let mut rest = packed.clone();
                while !rest.is_empty() && dims.len() <= MAX_DIMS {
                    dims.push(input.next_integer(&mut rest)?);
                }
            }
            (1, _) => dims.push(input.integer(&value)?),
            _ => {}
        }
        if dims.len() > MAX_DIMS {
            return Err(input.error("three dimensions", "more"));
        }
    }
    Ok(dims)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Six values as a packed list or one by one, and their shape.
    fn message(packed: bool) -> Vec<u8> {
        let values = (1_u8..=6).map(|value| f32::from(value).to_le_bytes());
        let data: Vec<u8> = match packed {
            true => [vec![1 << 3 | 2, 24], values.flatten().collect()].concat(),
            false => values.flat_map(|value| [&[1 << 3 | 5][..], &value].concat()).collect(),
        };
        let shape: &[u8] = if packed { &[10, 3, 1, 2, 3] } else { &[8, 1, 8, 2, 8, 3] };
        let length = u8::try_from(shape.len()).unwrap();
        [data.as_slice(), &[2 << 3 | 2, length], shape].concat()
    }

    fn read(message: &[u8]) -> std::result::Result<RangeImage, String> {
        of_message(Path::new("f"), "TOP", message).map_err(|e| e.to_string())
    }

    #[test]
    fn lists_may_be_packed_or_not() {
        let want = RangeImage { shape: [1, 2, 3], values: vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0] };
        assert_eq!([true, false].map(|packed| read(&message(packed)).unwrap()), [want.clone(), want]);
    }

    #[test]
    fn damaged_messages_never_panic() {
        for good in [message(true), message(false)] {
            for place in 0..good.len() {
                for flip in [0x01, 0x08, 0x80, 0xff] {
                    let mut bad = good.clone();
                    bad[place] ^= flip;
                    if let Err(message) = read(&bad) {
                        assert!(message.starts_with("f: TOP") && !message.contains('\n'), "{message}");
                    }
                }
                assert!(read(&good[..place]).is_err(), "{place}");
            }
        }
        let many = [2 << 3 | 2, 8, 8, 1, 8, 1, 8, 1, 8, 1];
        assert!(read(&many).unwrap_err().contains("three dimensions"));
    }
}
