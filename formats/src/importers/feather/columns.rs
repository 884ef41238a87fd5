//! Which columns a feather file has.

use arrow_ipc::{Precision, Schema, Type};

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

/// The columns of a schema.
///
/// # Errors
/// No schema, columns of columns, values of other byte order.
pub(super) fn kinds(at: &At<'_>, schema: Option<Schema<'_>>) -> Result<Vec<Field>> {
    let schema = schema.ok_or_else(|| at.error("a schema", "none"))?;
    if !schema.endianness().equals_to_target_endianness() {
        return Err(at.error("little-endian values", "another byte order"));
    }
    let mut fields = Vec::new();
    for field in schema.fields().into_iter().flatten() {
        let name = field.name().unwrap_or_default().to_owned();
        if field.children().is_some_and(|children| !children.is_empty()) {
            return Err(at.error("flat columns", format!("`{name}` of columns")));
        }
        let what = field.type_type().variant_name().unwrap_or("unknown").to_owned();
        let (kind, num_buffers) = match field.type_type() {
            _ if field.dictionary().is_some() => (Kind::Other("dictionary codes".to_owned()), 2),
            Type::Int => (integer(&field).map_or(Kind::Other(what), Kind::Number), 2),
            Type::FloatingPoint => (float(&field).map_or(Kind::Other(what), Kind::Number), 2),
            Type::Utf8 => (Kind::Text { end_bytes: 4 }, 3),
            Type::LargeUtf8 => (Kind::Text { end_bytes: 8 }, 3),
            Type::Binary | Type::LargeBinary => (Kind::Other(what), 3),
            Type::Null => (Kind::Other(what), 0),
            Type::Bool
            | Type::Decimal
            | Type::Date
            | Type::Time
            | Type::Timestamp
            | Type::Interval
            | Type::Duration
            | Type::FixedSizeBinary => (Kind::Other(what), 2),
            _ => return Err(at.error("columns of numbers and texts", format!("`{name}` of {what}"))),
        };
        fields.push(Field { name, kind, num_buffers });
    }
    Ok(fields)
}

fn integer(field: &arrow_ipc::Field<'_>) -> Option<Element> {
    let int = field.type_as_int()?;
    let size = match int.bitWidth() {
        8 => 1,
        16 => 2,
        32 => 4,
        64 => 8,
        _ => return None,
    };
    Some(if int.is_signed() { Element::Int(size) } else { Element::Uint(size) })
}

fn float(field: &arrow_ipc::Field<'_>) -> Option<Element> {
    match field.type_as_floating_point()?.precision() {
        Precision::HALF => Some(Element::F16),
        Precision::SINGLE => Some(Element::F32),
        Precision::DOUBLE => Some(Element::F64),
        _ => None,
    }
}
