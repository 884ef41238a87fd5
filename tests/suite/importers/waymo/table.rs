//! A Parquet file as plain as one can be: columns of integers, none missing, a page each, nothing packed.
//!
//! # Source
//! apache/parquet-format, `src/main/thrift/parquet.thrift`; apache/thrift, `doc/specs/thrift-compact-protocol.md`.

const MAGIC: &[u8; 4] = b"PAR1";
/// Numbers of the format: the type of 64 bits, levels of runs.
const INT64: i64 = 2;
const RUNS: i64 = 3;

/// A value of Thrift.
#[derive(Clone, Debug)]
enum Thrift {
    Int32(i64),
    Int64(i64),
    Text(String),
    List(Vec<Self>),
    /// Values and the numbers of their fields.
    Struct(Vec<(u8, Self)>),
}

use Thrift::{Int32, Int64, List, Struct, Text};

impl Thrift {
    const fn kind(&self) -> u8 {
        match self {
            Int32(_) => 5,
            Int64(_) => 6,
            Text(_) => 8,
            List(_) => 9,
            Struct(_) => 12,
        }
    }

    fn write(&self, out: &mut Vec<u8>) {
        match self {
            Int32(value) | Int64(value) => varint((value << 1 ^ value >> 63).cast_unsigned(), out),
            Text(text) => {
                varint(text.len() as u64, out);
                out.extend(text.bytes());
            }
            List(values) => {
                out.push(0xf0 | values.first().map_or(0, Self::kind));
                varint(values.len() as u64, out);
                values.iter().for_each(|value| value.write(out));
            }
            Struct(fields) => {
                let mut last = 0;
                for (number, value) in fields {
                    out.push((number - last) << 4 | value.kind());
                    value.write(out);
                    last = *number;
                }
                out.push(0);
            }
        }
    }
}

fn varint(mut value: u64, out: &mut Vec<u8>) {
    while value > 0x7f {
        out.push(0x80 | value.to_le_bytes()[0] & 0x7f);
        value >>= 7;
    }
    out.push(value.to_le_bytes()[0]);
}

/// The file of columns of the same length.
///
/// # Errors
/// More than a file holds.
pub(super) fn table_of(columns: &[(&str, &[i64])]) -> Result<Vec<u8>, std::num::TryFromIntError> {
    let mut file = MAGIC.to_vec();
    let num_rows = i64::try_from(columns.first().map_or(0, |(_, values)| values.len()))?;
    let root = Struct(vec![(4, Text("schema".to_owned())), (5, Int32(i64::try_from(columns.len())?))]);
    let (mut schema, mut chunks) = (vec![root], Vec::new());
    for (name, values) in columns {
        let name = Text((*name).to_owned());
        schema.push(Struct(vec![(1, Int32(INT64)), (3, Int32(0)), (4, name.clone())]));
        let start = i64::try_from(file.len())?;
        let body: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        let size = i64::try_from(body.len())?;
        let page = Struct(vec![(1, Int32(num_rows)), (2, Int32(0)), (3, Int32(RUNS)), (4, Int32(RUNS))]);
        Struct(vec![(1, Int32(0)), (2, Int32(size)), (3, Int32(size)), (5, page)]).write(&mut file);
        file.extend(body);
        let size = i64::try_from(file.len())? - start;
        let chunk = vec![
            (1, Int32(INT64)),
            (2, List(vec![Int32(0)])),
            (3, List(vec![name])),
            (4, Int32(0)),
            (5, Int64(num_rows)),
            (6, Int64(size)),
            (7, Int64(size)),
            (9, Int64(start)),
        ];
        chunks.push(Struct(vec![(2, Int64(start)), (3, Struct(chunk))]));
    }
    let size = i64::try_from(file.len() - MAGIC.len())?;
    let group = Struct(vec![(1, List(chunks)), (2, Int64(size)), (3, Int64(num_rows))]);
    let mut footer = Vec::new();
    Struct(vec![(1, Int32(1)), (2, List(schema)), (3, Int64(num_rows)), (4, List(vec![group]))]).write(&mut footer);
    file.extend(&footer);
    file.extend(u32::try_from(footer.len())?.to_le_bytes());
    file.extend(MAGIC);
    Ok(file)
}
