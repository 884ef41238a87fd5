//! Which columns a feather file has.

use super::flatbuffer::Table;
use crate::{
    error::Result,
    importers::{table::Column, values::At},
    numpy::Element,
};

/// How a column's values are stored.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Kind {
    Number(Element),
    /// UTF-8 with ends of 4 or 8 bytes.
    Text {
        end_bytes: usize,
    },
    /// Values that no importer needs: what they are.
    Other(String),
}

impl Kind {
    /// A column of this kind without values.
    pub(super) fn empty(&self) -> Column {
        match self {
            Self::Number(element) if element.is_integer() => Column::Ints(Vec::new()),
            Self::Number(_) => Column::Floats(Vec::new()),
            Self::Text { .. } => Column::Texts(Vec::new()),
            Self::Other(what) => Column::Other(what.clone()),
        }
    }
}

/// A column of the schema.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Field {
    pub(super) name: String,
    pub(super) kind: Kind,
    /// Buffers that the column takes of each batch.
    pub(super) num_buffers: usize,
}

/// Fields of a schema.
const ENDIANNESS: usize = 0;
const FIELDS: usize = 1;
/// Fields of a column.
const NAME: usize = 0;
const TYPE_CODE: usize = 2;
const TYPE: usize = 3;
const DICTIONARY: usize = 4;
const CHILDREN: usize = 5;
/// Fields of the types of numbers.
const BIT_WIDTH: usize = 0;
const IS_SIGNED: usize = 1;
const PRECISION: usize = 0;

/// Arrow's types by their codes.
#[rustfmt::skip]
const TYPES: [&str; 27] = [
    "NONE", "Null", "Int", "FloatingPoint", "Binary", "Utf8", "Bool", "Decimal", "Date", "Time", "Timestamp", "Interval", "List", "Struct_",
    "Union", "FixedSizeBinary", "FixedSizeList", "Map", "Duration", "LargeBinary", "LargeUtf8", "LargeList", "RunEndEncoded", "BinaryView",
    "Utf8View", "ListView", "LargeListView",
];

/// The columns of a schema.
///
/// # Errors
/// Columns of columns, values of other byte order, tables that are damaged.
pub(super) fn kinds(at: &At<'_>, schema: &Table<'_>) -> Result<Vec<Field>> {
    if schema.number(ENDIANNESS)? != [0, 0] {
        return Err(at.error("little-endian values", "another byte order"));
    }
    schema.tables(FIELDS)?.iter().map(|field| kind(at, field)).collect()
}

fn kind(at: &At<'_>, field: &Table<'_>) -> Result<Field> {
    let name = field.text(NAME)?.to_owned();
    if !field.vector::<4>(CHILDREN)?.is_empty() {
        return Err(at.error("flat columns", format!("`{name}` of columns")));
    }
    let [code] = field.number(TYPE_CODE)?;
    let what = TYPES.get(usize::from(code)).copied().unwrap_or("unknown");
    let other = || Kind::Other(what.to_owned());
    let (kind, num_buffers) = match what {
        _ if field.table(DICTIONARY)?.is_some() => (Kind::Other("dictionary codes".to_owned()), 2),
        "Int" => (integer(field)?.map_or_else(other, Kind::Number), 2),
        "FloatingPoint" => (float(field)?.map_or_else(other, Kind::Number), 2),
        "Utf8" => (Kind::Text { end_bytes: 4 }, 3),
        "LargeUtf8" => (Kind::Text { end_bytes: 8 }, 3),
        "Binary" | "LargeBinary" => (other(), 3),
        "Null" => (other(), 0),
        "Bool" | "Decimal" | "Date" | "Time" | "Timestamp" | "Interval" | "Duration" | "FixedSizeBinary" => {
            (other(), 2)
        }
        _ => return Err(at.error("columns of numbers and texts", format!("`{name}` of {what}"))),
    };
    Ok(Field { name, kind, num_buffers })
}

fn integer(field: &Table<'_>) -> Result<Option<Element>> {
    let Some(int) = field.table(TYPE)? else { return Ok(None) };
    let size = match i32::from_le_bytes(int.number(BIT_WIDTH)?) {
        8 => 1,
        16 => 2,
        32 => 4,
        64 => 8,
        _ => return Ok(None),
    };
    Ok(Some(if int.number(IS_SIGNED)? == [0] { Element::Uint(size) } else { Element::Int(size) }))
}

fn float(field: &Table<'_>) -> Result<Option<Element>> {
    let Some(float) = field.table(TYPE)? else { return Ok(None) };
    Ok(match i16::from_le_bytes(float.number(PRECISION)?) {
        0 => Some(Element::F16),
        1 => Some(Element::F32),
        2 => Some(Element::F64),
        _ => None,
    })
}
