//! Pages: a header and a body of levels and values.
//!
//! # Source
//! apache/parquet-format, `README.md`, `Encodings.md`, `Compression.md`, `src/main/thrift/parquet.thrift`.

use ruzstd::decoding::StreamingDecoder;
use std::ops::Range;

use flate2::{Crc, bufread::MultiGzDecoder};

use super::{
    cells::{Cells, Value},
    footer::{Leaf, Physical},
    hybrid::Hybrid,
    thrift::{Field, Thrift},
};
use crate::{
    error::Result,
    importers::values::At,
    read::{read_unpacked, unpacked_limit},
};

/// Encodings by number.
const PLAIN: i64 = 0;
const RLE: i64 = 3;
const DICTIONARY: [i64; 2] = [2, 8];

/// Most values in so many bytes: runs of one value take few.
pub(super) const fn most_values(bytes: u64) -> u64 {
    bytes.saturating_mul(1 << 10).saturating_add(1 << 22)
}

/// What a page is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Rows, the levels packed together with the values.
    Data,
    /// Rows, the levels as they are before the values.
    DataV2,
    Dictionary,
    /// Another kind, which is not read.
    Other,
}

/// The header of a page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Header {
    pub(super) kind: Kind,
    pub(super) num_values: u64,
    encoding: i64,
    /// Bytes of the body unpacked, and in the file.
    unpacked: u64,
    pub(super) packed: u64,
    crc: Option<u32>,
    /// Of a second version's page: bytes of the levels of repetition and of definition, and whether the values are packed.
    levels: [u64; 2],
    values_packed: bool,
}

/// The header at the start of `bytes`, and its length.
///
/// # Errors
/// Bytes that are no header, or one of more values than its page can hold.
pub(super) fn header(at: At<'_>, bytes: &[u8]) -> Result<(Header, u64)> {
    let mut header = Header {
        kind: Kind::Other,
        num_values: 0,
        encoding: PLAIN,
        unpacked: 0,
        packed: 0,
        crc: None,
        levels: [0; 2],
        values_packed: true,
    };
    let mut thrift = Thrift::new(at, bytes);
    thrift.fields(|thrift, field| {
        match field.number {
            1 => {
                header.kind = match thrift.integer(field)? {
                    0 => Kind::Data,
                    2 => Kind::Dictionary,
                    3 => Kind::DataV2,
                    _ => Kind::Other,
                }
            }
            2 => header.unpacked = count(&at, thrift, field)?,
            3 => header.packed = count(&at, thrift, field)?,
            // The checksum is a number of 32 bits that may have a sign.
            4 => header.crc = u32::try_from(thrift.integer(field)? & i64::from(u32::MAX)).ok(),
            5 | 7 | 8 => rows(&at, thrift, field, &mut header)?,
            _ => thrift.skip(field)?,
        }
        Ok(())
    })?;
    let most = most_values(header.packed);
    if header.num_values > most {
        return Err(
            at.error(format!("at most {most} values in {} bytes", header.packed), header.num_values.to_string())
        );
    }
    Ok((header, thrift.position() as u64))
}

fn count(at: &At<'_>, thrift: &mut Thrift<'_>, field: Field) -> Result<u64> {
    let number = thrift.integer(field)?;
    u64::try_from(number).map_err(|_e| at.error("a count", number.to_string()))
}

/// Reads into `header` what the header of a kind of page (`field`) says of its rows.
fn rows(at: &At<'_>, thrift: &mut Thrift<'_>, field: Field, header: &mut Header) -> Result<()> {
    thrift.structure(field)?;
    let version = match field.number {
        5 => 1,
        7 => 0, // a dictionary
        _ => 2,
    };
    thrift.fields(|thrift, field| {
        match (field.number, version) {
            (1, _) => header.num_values = count(at, thrift, field)?,
            (2, 0 | 1) | (4, 2) => header.encoding = thrift.integer(field)?,
            (3 | 4, 1) => {
                let levels = thrift.integer(field)?;
                if levels != RLE {
                    return Err(at.error(format!("levels of encoding {RLE}"), levels.to_string()));
                }
            }
            (5, 2) => header.levels[1] = count(at, thrift, field)?,
            (6, 2) => header.levels[0] = count(at, thrift, field)?,
            (7, 2) => header.values_packed = thrift.truth(field)?,
            _ => thrift.skip(field)?,
        }
        Ok(())
    })
}

/// A page that has been unpacked.
#[derive(Clone, Debug)]
pub(super) struct Page {
    num_values: u64,
    encoding: i64,
    bytes: Vec<u8>,
    /// Where in the bytes levels of repetition, of definition, and values are.
    reps: Range<usize>,
    defs: Range<usize>,
    values: Range<usize>,
}

impl Page {
    /// The page of a header and the body behind it, which `codec` has packed.
    ///
    /// # Errors
    /// A body that is damaged, or packed in an unknown way.
    pub(super) fn new(at: At<'_>, leaf: &Leaf, header: &Header, codec: i64, body: Vec<u8>) -> Result<Self> {
        if let Some(expected) = header.crc {
            let mut crc = Crc::new();
            crc.update(&body);
            if crc.sum() != expected {
                let found = format!("{:08x} (damaged?)", crc.sum());
                return Err(at.error(format!("a page with the CRC-32 {expected:08x}"), found));
            }
        }
        let codec = if header.values_packed { codec } else { 0 };
        let mut page = Self {
            num_values: header.num_values,
            encoding: header.encoding,
            bytes: Vec::new(),
            reps: 0..0,
            defs: 0..0,
            values: 0..0,
        };
        if header.kind == Kind::DataV2 {
            let [reps, defs] = header.levels.map(|bytes| usize::try_from(bytes).unwrap_or(usize::MAX));
            let levels = reps.saturating_add(defs);
            let Some((head, packed)) = body.split_at_checked(levels) else {
                return Err(at.error(format!("levels within a page of {} bytes", body.len()), levels.to_string()));
            };
            let values = unpack(&at, codec, packed, header.unpacked.saturating_sub(levels as u64))?;
            page.bytes = [head, &values].concat();
            (page.reps, page.defs, page.values) = (0..reps, reps..levels, levels..page.bytes.len());
            return Ok(page);
        }
        page.bytes = if codec == 0 { body } else { unpack(&at, codec, &body, header.unpacked)? };
        page.values = 0..page.bytes.len();
        if header.kind == Kind::Data {
            page.reps = page.take_levels(&at, leaf.max_rep)?;
            page.defs = page.take_levels(&at, leaf.max_def)?;
        }
        Ok(page)
    }

    /// Where the levels up to `max` are that stand before the values with their length.
    fn take_levels(&mut self, at: &At<'_>, max: u32) -> Result<Range<usize>> {
        if max == 0 {
            return Ok(0..0);
        }
        let rest = &self.bytes[self.values.clone()];
        let levels = rest.split_first_chunk().and_then(|(length, rest)| {
            let length = usize::try_from(u32::from_le_bytes(*length)).ok()?;
            (length <= rest.len()).then_some(length)
        });
        let length = levels.ok_or_else(|| at.error("levels within their page", "more (damaged?)"))?;
        let start = self.values.start + 4;
        self.values.start = start + length;
        Ok(start..start + length)
    }

    /// The number of rows that begin in a page of lists.
    pub(super) fn num_starts(&self, leaf: &Leaf) -> u64 {
        let mut reps = Hybrid::up_to(&self.bytes[self.reps.clone()], leaf.max_rep);
        (0..self.num_values).map_while(|_| reps.next()).filter(|&rep| rep == 0).count() as u64
    }

    /// The levels and values of the page, one after the other; `dictionary` is that of its chunk.
    ///
    /// # Errors
    /// An unknown encoding; values of a dictionary that is not there.
    pub(super) fn cells<'a>(&'a self, at: At<'a>, leaf: &Leaf, dictionary: Option<&'a Page>) -> Result<Cells<'a>> {
        let values = &self.bytes[self.values.clone()];
        let plain = |bytes, indices| Cells {
            at,
            left: self.num_values,
            max_def: leaf.max_def,
            reps: Hybrid::up_to(&self.bytes[self.reps.clone()], leaf.max_rep),
            defs: Hybrid::up_to(&self.bytes[self.defs.clone()], leaf.max_def),
            physical: leaf.physical,
            plain: bytes,
            indices,
        };
        if self.encoding == PLAIN {
            return Ok(plain(values, None));
        }
        if !DICTIONARY.contains(&self.encoding) {
            let expected = "values of encoding 0 (plain), 2 or 8 (of a dictionary)";
            return Err(at.error(expected, self.encoding.to_string()));
        }
        let dictionary = dictionary.ok_or_else(|| at.error("a dictionary before its pages", "none"))?;
        let entries = dictionary.entries(&at, leaf.physical)?;
        let indices = match values.split_first() {
            Some((&width, rest)) if width <= 32 => Hybrid::new(rest, u32::from(width)),
            // A page without a value.
            None => Hybrid::new(&[], 1),
            Some((width, _)) => return Err(at.error("indices of at most 32 bits", width.to_string())),
        };
        Ok(plain(&dictionary.bytes, Some((indices, entries))))
    }

    /// Where the entries of a dictionary begin.
    fn entries(&self, at: &At<'_>, physical: Physical) -> Result<Vec<usize>> {
        let (mut entries, mut rest) = (Vec::new(), self.bytes.as_slice());
        for _ in 0..self.num_values {
            entries.push(self.bytes.len() - rest.len());
            let taken = Value::take(physical, &mut rest);
            taken.ok_or_else(|| at.error(format!("a dictionary of {} values", self.num_values), "fewer"))?;
        }
        Ok(entries)
    }
}

/// The bytes that `codec` has packed, of which there are to be `size`.
fn unpack(at: &At<'_>, codec: i64, packed: &[u8], size: u64) -> Result<Vec<u8>> {
    let length = packed.len() as u64;
    if size > unpacked_limit(length) {
        let expected = format!("at most {} bytes unpacked from {length}", unpacked_limit(length));
        return Err(at.error(expected, size.to_string()));
    }
    let kind = |name: &str| format!("{}: {name}", at.field);
    let bytes = match codec {
        0 => packed.to_vec(),
        1 => {
            // It makes as much room as the packed bytes ask for.
            let says = snap::raw::decompress_len(packed).map_err(|e| at.error("bytes of Snappy", e.to_string()))?;
            if says as u64 != size {
                return Err(at.error(format!("{size} bytes of Snappy"), says.to_string()));
            }
            let bytes = snap::raw::Decoder::new().decompress_vec(packed);
            bytes.map_err(|e| at.error("bytes of Snappy", format!("{e} (damaged?)")))?
        }
        2 => read_unpacked(at.file, &kind("gzip"), length, MultiGzDecoder::new(packed))?,
        6 => {
            // A window larger than what comes out of it would be room for nothing; the format asks for 1 KiB at least.
            let reader = StreamingDecoder::new_with_max_window_size(packed, size.max(1024));
            let reader = reader.map_err(|e| at.error("bytes of Zstandard", e.to_string()))?;
            read_unpacked(at.file, &kind("Zstandard"), length, reader)?
        }
        other => {
            let expected = "compression 0 (none), 1 (Snappy), 2 (gzip) or 6 (Zstandard)";
            return Err(at.error(expected, other.to_string()));
        }
    };
    if bytes.len() as u64 == size {
        return Ok(bytes);
    }
    Err(at.error(format!("{size} bytes"), format!("{} (truncated?)", bytes.len())))
}
