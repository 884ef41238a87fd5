//! A frame of pandas among the values of a pickle: blocks of columns of one type, in three layouts.
//!
//! Until pandas 1.2 the block manager's state is `(axes, values, items, {"0.14.1": {axes, blocks}})`; since 1.3 it is called
//! with `(blocks, axes)`, where a block is called with `(values, places)` and, since 1.4, the number of axes. Arrays of numpy
//! are `_reconstruct` with a state, or `_frombuffer` in protocol 5.

use super::heap::{Call, Heap, Id, Node};
use crate::{
    error::{FormatError, Result},
    importers::{
        table::{Column, Named, Table},
        values::At,
    },
    numpy::Element,
};

/// Key of the layout of pandas until 1.2 in a block manager's state.
const OLD_LAYOUT: &str = "0.14.1";

/// What makes arrays of numpy.
const ARRAYS: [&str; 2] = ["_reconstruct", "_frombuffer"];

/// The table of the frame that a pickle is of.
///
/// # Errors
/// A pickle of something else, or of a frame whose layout is not known.
pub(super) fn table(at: At<'_>, heap: &Heap<'_>) -> Result<Table> {
    let reader = Reader { at, heap };
    let root = heap.root.ok_or_else(|| at.error("a frame", "nothing"))?;
    let frame = reader.called(root, "DataFrame")?;
    let manager = frame.state.and_then(|state| heap.entry(state, "_mgr").or_else(|| heap.entry(state, "_data")));
    let manager = reader.called(manager.ok_or_else(|| at.error("a frame with blocks", "none"))?, "BlockManager")?;
    let Blocks { axes, blocks } = reader.blocks(manager)?;
    let [columns, _] = axes else { return Err(at.error("a frame of two axes", axes.len().to_string())) };
    let names = reader.names(*columns)?;
    let mut found: Vec<Option<Column>> = vec![None; names.len()];
    let mut len = None;
    for block in blocks {
        let places = reader.places(block.places)?;
        let (rows, values) = reader.rows(block.values, places.len())?;
        if let Some(rows) = rows.filter(|&rows| *len.get_or_insert(rows) != rows) {
            return Err(at.error(format!("{} rows in every block", len.unwrap_or(0)), rows.to_string()));
        }
        for (place, column) in places.into_iter().zip(values) {
            let Some(slot) = found.get_mut(place) else {
                return Err(at.error(format!("columns below {}", names.len()), place.to_string()));
            };
            *slot = Some(column);
        }
    }
    let columns = names.into_iter().zip(found).map(|(name, column)| {
        let column = column.ok_or_else(|| at.error(format!("values of column `{name}`"), "none"))?;
        Ok(Named { name, column })
    });
    Table::new(at.file, len.unwrap_or(0), columns.collect::<Result<_>>()?)
}

/// The values and the columns of a block.
#[derive(Clone, Copy)]
struct Block {
    values: Id,
    places: Id,
}

struct Blocks<'a> {
    axes: &'a [Id],
    blocks: Vec<Block>,
}

/// An array of numpy.
struct Array<'a> {
    shape: Vec<usize>,
    /// Whether the first axis runs fastest.
    first_fastest: bool,
    elements: Elements<'a>,
}

enum Elements<'a> {
    Numbers {
        element: Element,
        bytes: &'a [u8],
    },
    Objects(&'a [Id]),
    /// Moments and the like: their type.
    Other(&'a str),
}

struct Reader<'a, 'h> {
    at: At<'a>,
    heap: &'h Heap<'h>,
}

impl<'h> Reader<'_, 'h> {
    fn error<T>(&self, expected: &str, found: Id) -> Result<T> {
        let found = match self.name(found) {
            Some(name) => format!("an object of `{name}`"),
            None => self.heap.get(found).kind(),
        };
        Err(self.at.error(expected, found))
    }

    /// The name of what made an object.
    fn name(&self, id: Id) -> Option<&'h str> {
        let callee = self.heap.call(id)?.callee;
        self.heap.global(callee).map(|global| global.name)
    }

    fn called(&self, id: Id, name: &str) -> Result<&'h Call> {
        match self.heap.call(id) {
            Some(call) if self.name(id) == Some(name) => Ok(call),
            _ => self.error(&format!("an object of `{name}`"), id),
        }
    }

    fn blocks(&self, manager: &'h Call) -> Result<Blocks<'h>> {
        let heap = self.heap;
        if let Some(&[blocks, axes]) = heap.sequence(manager.arguments) {
            let (Some(blocks), Some(axes)) = (heap.sequence(blocks), heap.sequence(axes)) else {
                return self.error("blocks and axes", manager.arguments);
            };
            let block = |&id: &Id| match heap.call(id).and_then(|call| heap.sequence(call.arguments)) {
                Some(&[values, places, ..]) => Ok(Block { values, places }),
                _ => self.error("a block of values", id),
            };
            return Ok(Blocks { axes, blocks: blocks.iter().map(block).collect::<Result<_>>()? });
        }
        let state = manager.state.and_then(|state| heap.sequence(state)).and_then(|state| state.last().copied());
        let state = state.and_then(|state| heap.entry(state, OLD_LAYOUT));
        let axes = state.and_then(|state| heap.entry(state, "axes")).and_then(|axes| heap.sequence(axes));
        let blocks = state.and_then(|state| heap.entry(state, "blocks")).and_then(|blocks| heap.sequence(blocks));
        let (Some(axes), Some(blocks)) = (axes, blocks) else {
            return self.error("a block manager of pandas 0.14 or later", manager.arguments);
        };
        let block = |&id: &Id| match (heap.entry(id, "values"), heap.entry(id, "mgr_locs")) {
            (Some(values), Some(places)) => Ok(Block { values, places }),
            _ => self.error("a block of values", id),
        };
        Ok(Blocks { axes, blocks: blocks.iter().map(block).collect::<Result<_>>()? })
    }

    /// The names of an index of columns.
    fn names(&self, index: Id) -> Result<Vec<String>> {
        let call = self.called(index, "_new_Index")?;
        let data = match self.heap.sequence(call.arguments) {
            Some(&[_, state]) => self.heap.entry(state, "data"),
            _ => None,
        };
        let Some(data) = data else { return self.error("names of columns", index) };
        let Array { elements: Elements::Objects(items), .. } = self.array(data)? else {
            return self.error("names of columns that are texts", data);
        };
        let text =
            |&id: &Id| self.heap.text(id).map_or_else(|| self.error("names that are texts", id), |t| Ok(t.to_owned()));
        items.iter().map(text).collect()
    }

    /// The columns of a block: a slice or an array of integers.
    fn places(&self, id: Id) -> Result<Vec<usize>> {
        if self.name(id) == Some("slice") {
            let arguments = self.heap.call(id).and_then(|call| self.heap.sequence(call.arguments)).unwrap_or_default();
            let numbers: Option<Vec<usize>> = arguments.iter().map(|&id| self.heap.count(id)).collect();
            return match numbers.as_deref() {
                Some(&[start, stop, step]) if step > 0 && start <= stop && stop <= self.heap.nodes.len() => {
                    Ok((start..stop).step_by(step).collect())
                }
                _ => self.error("a slice of columns", id),
            };
        }
        match self.array(id)?.elements {
            Elements::Numbers { element, bytes } if element.is_integer() => {
                let places: Option<Vec<usize>> =
                    element.ints(bytes).into_iter().map(|place| usize::try_from(place).ok()).collect();
                places.map_or_else(|| self.error("columns that are not negative", id), Ok)
            }
            _ => self.error("numbers of columns", id),
        }
    }

    /// The columns of a block of `count` and how many rows they have, where that is known: not for pandas' own arrays.
    fn rows(&self, values: Id, count: usize) -> Result<(Option<usize>, Vec<Column>)> {
        if let Some(what) = self.name(values).filter(|name| !ARRAYS.contains(name)) {
            return Ok((None, vec![Column::Other(format!("an array of pandas, `{what}`")); count]));
        }
        let array = self.array(values)?;
        let rows = match *array.shape {
            [columns, rows] if columns == count => rows,
            [rows] if count == 1 => rows,
            _ => {
                let expected = format!("an array of {count} columns");
                return Err(self.at.error(expected, format!("one of shape {:?}", array.shape)));
            }
        };
        let places = |column: usize| {
            let (start, step) = if array.first_fastest { (column, count) } else { (column * rows, 1) };
            (0..rows).map(move |row| start + row * step)
        };
        let columns = 0..count;
        let columns = match &array.elements {
            Elements::Numbers { element, bytes } if element.is_integer() => {
                let values = element.ints(bytes);
                columns.map(|column| Column::Ints(places(column).map(|place| values[place]).collect())).collect()
            }
            Elements::Numbers { element, bytes } => {
                let values = element.floats(bytes);
                columns.map(|column| Column::Floats(places(column).map(|place| values[place]).collect())).collect()
            }
            Elements::Objects(items) => {
                columns.map(|column| self.objects(places(column).map(|place| items[place]))).collect()
            }
            Elements::Other(what) => columns.map(|_| Column::Other((*what).to_owned())).collect(),
        };
        Ok((Some(rows), columns))
    }

    /// A column of texts; what is none of them counts as missing, as pandas' NaN does.
    fn objects(&self, items: impl Iterator<Item = Id>) -> Column {
        Column::Texts(items.map(|id| self.heap.text(id).map(str::to_owned)).collect())
    }

    fn array(&self, id: Id) -> Result<Array<'h>> {
        let heap = self.heap;
        let call = self.heap.call(id);
        let parts = match (self.name(id), call) {
            (Some("_frombuffer"), Some(call)) => heap.sequence(call.arguments).and_then(|parts| match parts {
                &[data, element, shape, order] => Some((shape, element, heap.text(order) == Some("F"), data)),
                _ => None,
            }),
            (Some("_reconstruct"), Some(call)) => {
                call.state.and_then(|state| heap.sequence(state)).and_then(|parts| match parts {
                    &[_, shape, element, order, data] => {
                        let fortran = match heap.get(order) {
                            Node::Bool(fortran) => *fortran,
                            Node::Int(fortran) => *fortran != 0,
                            _ => return None,
                        };
                        Some((shape, element, fortran, data))
                    }
                    _ => None,
                })
            }
            _ => None,
        };
        let Some((shape, element, first_fastest, data)) = parts else { return self.error("an array of numpy", id) };
        let sides: Option<Vec<usize>> =
            heap.sequence(shape).and_then(|sides| sides.iter().map(|&side| heap.count(side)).collect());
        let count = sides.as_ref().and_then(|sides| sides.iter().try_fold(1_usize, |n, &side| n.checked_mul(side)));
        let (Some(sides), Some(count)) = (sides, count) else { return self.error("the shape of an array", shape) };
        let elements = self.elements(element, data, count)?;
        Ok(Array { first_fastest: first_fastest && sides.len() > 1, shape: sides, elements })
    }

    fn elements(&self, element: Id, data: Id, count: usize) -> Result<Elements<'h>> {
        let call = self.called(element, "dtype")?;
        let text = self.heap.sequence(call.arguments).and_then(|arguments| self.heap.text(*arguments.first()?));
        let Some(text) = text else { return self.error("the type of an array's elements", element) };
        let order = call.state.and_then(|s| self.heap.sequence(s)).and_then(|s| self.heap.text(*s.get(1)?));
        let wrong = |found: String| FormatError::invalid(self.at.file, self.at.field, format!("{count} values"), found);
        match (Element::parse(text).filter(|_| order != Some(">")), self.heap.get(data)) {
            (Some(element), Node::Bytes(bytes)) if count.checked_mul(element.size()) == Some(bytes.len()) => {
                Ok(Elements::Numbers { element, bytes })
            }
            (Some(_), Node::Bytes(bytes)) => Err(wrong(format!("{} bytes of {text}", bytes.len()))),
            (Some(element), Node::Call(_)) if count == 0 => Ok(Elements::Numbers { element, bytes: &[] }),
            (None, Node::Sequence(items)) if text.starts_with('O') && items.len() == count => {
                Ok(Elements::Objects(items))
            }
            (None, Node::Bytes(_)) => Ok(Elements::Other(text)),
            (_, other) => Err(wrong(other.kind())),
        }
    }
}
