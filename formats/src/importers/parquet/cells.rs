//! Places of a page, one after the other: whether a row begins, and the value.

use super::{footer::Physical, hybrid::Hybrid};
use crate::{error::Result, importers::values::At};

/// A value of a column.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Value<'a> {
    Int(i64),
    Float(f64),
    Bytes(&'a [u8]),
}

impl<'a> Value<'a> {
    /// The value at the start of plain bytes, which is taken from them.
    pub(super) fn take(physical: Physical, bytes: &mut &'a [u8]) -> Option<Self> {
        fn first<const N: usize>(bytes: &mut &[u8]) -> Option<[u8; N]> {
            let (value, rest) = bytes.split_first_chunk()?;
            *bytes = rest;
            Some(*value)
        }
        Some(match physical {
            Physical::Int32 => Self::Int(i64::from(i32::from_le_bytes(first(bytes)?))),
            Physical::Int64 => Self::Int(i64::from_le_bytes(first(bytes)?)),
            Physical::Float => Self::Float(f64::from(f32::from_le_bytes(first(bytes)?))),
            Physical::Double => Self::Float(f64::from_le_bytes(first(bytes)?)),
            Physical::Bytes => {
                let length = usize::try_from(u32::from_le_bytes(first(bytes)?)).ok()?;
                let (value, rest) = bytes.split_at_checked(length)?;
                *bytes = rest;
                Self::Bytes(value)
            }
            Physical::Other(_) => return None,
        })
    }
}

/// A place of a page.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cell<'a> {
    /// Whether a row begins here.
    pub(super) starts: bool,
    /// `None` where there is no value, or the list is empty.
    pub(super) value: Option<Value<'a>>,
}

/// The places of a page, one after the other.
#[derive(Debug)]
pub(super) struct Cells<'a> {
    pub(super) at: At<'a>,
    pub(super) left: u64,
    pub(super) max_def: u32,
    pub(super) reps: Hybrid<'a>,
    pub(super) defs: Hybrid<'a>,
    pub(super) physical: Physical,
    /// Plain values, or the entries of the dictionary.
    pub(super) plain: &'a [u8],
    /// Indices of a dictionary, and where its entries begin.
    pub(super) indices: Option<(Hybrid<'a>, Vec<usize>)>,
}

impl<'a> Cells<'a> {
    /// The next place.
    ///
    /// # Errors
    /// Fewer levels or values than the header says; an index beyond the dictionary.
    pub(super) fn next(&mut self) -> Result<Option<Cell<'a>>> {
        let Some(left) = self.left.checked_sub(1) else { return Ok(None) };
        self.left = left;
        let levels = self.reps.next().zip(self.defs.next());
        let (rep, def) = levels.ok_or_else(|| self.at.error("a level for each value", "fewer (truncated?)"))?;
        let value = if def >= self.max_def { Some(self.value()?) } else { None };
        Ok(Some(Cell { starts: rep == 0, value }))
    }

    fn value(&mut self) -> Result<Value<'a>> {
        let found = match &mut self.indices {
            None => Value::take(self.physical, &mut self.plain),
            Some((indices, entries)) => {
                let index = indices.next().and_then(|index| usize::try_from(index).ok());
                let start = index.and_then(|index| entries.get(index));
                start.and_then(|&start| Value::take(self.physical, &mut self.plain.get(start..)?))
            }
        };
        found.ok_or_else(|| self.at.error("as many values as its header says", "fewer (truncated?)"))
    }
}
