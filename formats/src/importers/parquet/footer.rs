//! The end of a Parquet file: which columns there are, and where their values lie.
//!
//! # Source
//! apache/parquet-format, `src/main/thrift/parquet.thrift`: the numbers of the fields.

use std::{
    fs::File,
    io::{Read, Seek, SeekFrom},
    path::Path,
};

use super::thrift::{Field, Thrift};
use crate::{
    error::{FormatError, Result},
    importers::values::At,
    read::file_size,
};

const MAGIC: &[u8; 4] = b"PAR1";
/// Longest footer, bytes.
const MAX_FOOTER: u64 = 64 << 20;
/// Longest name of a part of a schema, bytes.
const MAX_NAME: usize = 1000;
/// Most rows: a drive has a few thousand of anything.
const MAX_ROWS: u64 = 1 << 20;
/// Most parts that a schema, or a group of rows, has.
const MAX_PARTS: usize = 10_000;

/// How values are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Physical {
    Int32,
    Int64,
    Float,
    Double,
    Bytes,
    /// A type that no importer needs, by its number.
    Other(i64),
}

/// A column of values; a list is one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Leaf {
    /// The name of the column: that of the outermost part of its path.
    pub(super) name: String,
    pub(super) physical: Physical,
    /// Levels of definition and of repetition.
    pub(super) max_def: u32,
    pub(super) max_rep: u32,
}

/// The values of a leaf in one group of rows.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Chunk {
    pub(super) codec: i64,
    pub(super) num_values: u64,
    /// Where its pages begin and end.
    pub(super) start: u64,
    pub(super) end: u64,
}

/// Rows that are stored together.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Group {
    pub(super) num_rows: u64,
    /// One for each leaf.
    pub(super) chunks: Vec<Chunk>,
}

/// What a footer says.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Footer {
    pub(super) leaves: Vec<Leaf>,
    pub(super) groups: Vec<Group>,
}

impl Footer {
    /// The number of rows.
    pub(super) fn num_rows(&self) -> u64 {
        self.groups.iter().fold(0, |rows, group| rows.saturating_add(group.num_rows))
    }
}

/// The footer of a file.
///
/// # Errors
/// A file that is no Parquet file, is cut off, or contradicts itself.
pub(super) fn read(path: &Path) -> Result<Footer> {
    let at = At { file: path, field: "footer" };
    let size = file_size(path, u64::MAX)?;
    let io = |e| FormatError::io(path, "read", e);
    let mut file = File::open(path).map_err(io)?;
    let mut end = [0; 8];
    let room = size.checked_sub(12).ok_or_else(|| at.error("a Parquet file", format!("{size} bytes")))?;
    file.seek(SeekFrom::Start(size - 8)).and_then(|_| file.read_exact(&mut end)).map_err(io)?;
    let [a, b, c, d, magic @ ..] = end;
    if &magic != MAGIC {
        return Err(at.error("`PAR1` at the end", format!("{magic:?} (truncated, or encrypted?)")));
    }
    let length = u64::from(u32::from_le_bytes([a, b, c, d]));
    if length > room.min(MAX_FOOTER) {
        return Err(at.error(format!("at most {} bytes", room.min(MAX_FOOTER)), length.to_string()));
    }
    file.seek(SeekFrom::Start(size - 8 - length)).map_err(io)?;
    let mut bytes = Vec::new();
    file.take(length).read_to_end(&mut bytes).map_err(io)?;
    parse(at, &bytes, size - 8 - length)
}

/// What the bytes of a footer say, behind a body of so many bytes.
fn parse(at: At<'_>, bytes: &[u8], body: u64) -> Result<Footer> {
    let (mut elements, mut groups) = (Vec::new(), Vec::new());
    Thrift::new(at, bytes).fields(|thrift, field| match field.number {
        2 => thrift.list(field, |thrift, entry| {
            elements.push(element(thrift, entry)?);
            few(&at, "columns", elements.len())
        }),
        4 => thrift.list(field, |thrift, entry| {
            groups.push(group(thrift, entry)?);
            few(&at, "groups of rows", groups.len())
        }),
        _ => thrift.skip(field),
    })?;
    let leaves = leaves(&at, &elements)?;
    for (g, group) in groups.iter().enumerate() {
        let at = At { field: &format!("group {g}"), ..at };
        if group.chunks.len() != leaves.len() {
            return Err(at.error(format!("{} columns", leaves.len()), group.chunks.len().to_string()));
        }
        for (chunk, leaf) in group.chunks.iter().zip(&leaves) {
            if chunk.start > chunk.end || chunk.end > body {
                let found = format!("bytes {} to {}", chunk.start, chunk.end);
                return Err(
                    at.error(format!("column `{}` within the {body} bytes before the footer", leaf.name), found)
                );
            }
        }
    }
    let footer = Footer { leaves, groups };
    if footer.num_rows() > MAX_ROWS {
        return Err(at.error(format!("at most {MAX_ROWS} rows"), footer.num_rows().to_string()));
    }
    Ok(footer)
}

fn few(at: &At<'_>, what: &str, count: usize) -> Result<()> {
    if count <= MAX_PARTS { Ok(()) } else { Err(at.error(format!("at most {MAX_PARTS} {what}"), "more")) }
}

/// A part of the schema.
#[derive(Debug, Default)]
struct Element {
    kind: Option<i64>,
    /// 0 required, 1 optional, 2 repeated.
    repetition: i64,
    name: String,
    num_children: i64,
}

fn element(thrift: &mut Thrift<'_>, entry: Field) -> Result<Element> {
    thrift.structure(entry)?;
    let mut element = Element::default();
    thrift.fields(|thrift, field| {
        match field.number {
            1 => element.kind = Some(thrift.integer(field)?),
            3 => element.repetition = thrift.integer(field)?,
            4 => element.name = thrift.text(field, MAX_NAME)?,
            5 => element.num_children = thrift.integer(field)?,
            _ => thrift.skip(field)?,
        }
        Ok(())
    })?;
    Ok(element)
}

/// The leaves of a schema, whose parts stand in the order of a walk that looks at a part before its children.
fn leaves(at: &At<'_>, elements: &[Element]) -> Result<Vec<Leaf>> {
    /// A part whose children are being walked through.
    struct Open {
        children: i64,
        name: String,
        max_def: u32,
        max_rep: u32,
    }
    let Some((root, rest)) = elements.split_first() else { return Err(at.error("a schema", "none")) };
    let mut open = vec![Open { children: root.num_children, name: String::new(), max_def: 0, max_rep: 0 }];
    let mut leaves = Vec::new();
    for element in rest {
        while open.last().is_some_and(|part| part.children <= 0) {
            open.pop();
        }
        let depth = open.len();
        let Some(parent) = open.last_mut() else { return Err(at.error("a schema", "parts of nothing")) };
        parent.children -= 1;
        let name = if depth == 1 { element.name.clone() } else { parent.name.clone() };
        let max_def = parent.max_def + u32::from(element.repetition != 0);
        let max_rep = parent.max_rep + u32::from(element.repetition == 2);
        if element.num_children > 0 {
            open.push(Open { children: element.num_children, name, max_def, max_rep });
            continue;
        }
        let physical = match element.kind {
            Some(1) => Physical::Int32,
            Some(2) => Physical::Int64,
            Some(4) => Physical::Float,
            Some(5) => Physical::Double,
            Some(6) => Physical::Bytes,
            other => Physical::Other(other.unwrap_or(-1)),
        };
        leaves.push(Leaf { name, physical, max_def, max_rep });
    }
    Ok(leaves)
}

fn group(thrift: &mut Thrift<'_>, entry: Field) -> Result<Group> {
    thrift.structure(entry)?;
    let mut group = Group::default();
    thrift.fields(|thrift, field| {
        match field.number {
            1 => thrift.list(field, |thrift, entry| {
                thrift.structure(entry)?;
                let mut found = Chunk::default();
                thrift.fields(|thrift, field| match field.number {
                    3 => {
                        found = chunk(thrift, field)?;
                        Ok(())
                    }
                    _ => thrift.skip(field),
                })?;
                group.chunks.push(found);
                Ok(())
            })?,
            3 => group.num_rows = u64::try_from(thrift.integer(field)?).unwrap_or(0),
            _ => thrift.skip(field)?,
        }
        Ok(())
    })?;
    Ok(group)
}

fn chunk(thrift: &mut Thrift<'_>, field: Field) -> Result<Chunk> {
    thrift.structure(field)?;
    let (mut chunk, mut size, mut data, mut dictionary) = (Chunk::default(), 0, 0, None);
    thrift.fields(|thrift, field| {
        let mut count = || Ok(u64::try_from(thrift.integer(field)?).unwrap_or(0));
        match field.number {
            4 => chunk.codec = thrift.integer(field)?,
            5 => chunk.num_values = count()?,
            7 => size = count()?,
            9 => data = count()?,
            11 => dictionary = Some(count()?),
            _ => thrift.skip(field)?,
        }
        Ok(())
    })?;
    chunk.start = dictionary.filter(|&start| start > 0).map_or(data, |start: u64| start.min(data));
    chunk.end = chunk.start.saturating_add(size);
    Ok(chunk)
}
