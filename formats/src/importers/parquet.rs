//! Parquet files: columns of numbers, texts and lists of numbers, of which single rows are read.
//!
//! The pages of a column are found one after the other, as far as rows are asked for, and unpacked when a row in them is read. A file says
//! nothing that is trusted: counts are bounded by the bytes that are there.
//!
//! # Source
//! <https://parquet.apache.org/docs/file-format>

mod cells;
mod footer;
mod hybrid;
mod page;
mod thrift;

use std::{
    fs::File,
    io::{Read, Seek, SeekFrom},
    ops::Range,
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
};

use cells::{Cell, Value};
use footer::{Chunk, Footer, Leaf};
use page::{Header, Kind, Page};

use super::values::At;
use crate::error::{FormatError, Result};

/// Longest header of a page, bytes: it may hold the least and the largest value.
const MAX_HEADER: u64 = 1 << 16;
/// Longest body of a page, bytes.
const MAX_PAGE: u64 = 1 << 30;

/// A file whose footer has been read.
#[derive(Debug)]
pub(super) struct ParquetFile {
    path: PathBuf,
    footer: Footer,
    /// For each group and leaf, the pages that are known.
    pages: Mutex<Vec<Vec<Pages>>>,
}

/// The pages of a chunk, as far as somebody has looked.
#[derive(Clone, Debug, Default)]
struct Pages {
    dictionary: Option<LocatedPage>,
    data: Vec<LocatedPage>,
    /// Where the next one is looked for, from the chunk's start.
    next: u64,
    /// Rows that begin in the pages that are known, and their values.
    num_rows: u64,
    num_values: u64,
}

/// A page and where it is.
#[derive(Clone, Copy, Debug)]
struct LocatedPage {
    header: Header,
    /// Where its body begins in the file.
    body: u64,
    /// The rows that begin in it.
    first_row: u64,
    num_rows: u64,
}

/// Part of a chunk: its place in the footer.
#[derive(Clone, Copy, Debug)]
struct Place<'a> {
    group: usize,
    leaf: usize,
    column: &'a Leaf,
    chunk: &'a Chunk,
}

impl ParquetFile {
    /// The file at `path`.
    ///
    /// # Errors
    /// A file that is missing or no Parquet file, is cut off, or contradicts itself.
    pub(super) fn open(path: &Path) -> Result<Self> {
        let footer = footer::read(path)?;
        let pages = footer.groups.iter().map(|group| vec![Pages::default(); group.chunks.len()]).collect();
        Ok(Self { path: path.to_owned(), footer, pages: Mutex::new(pages) })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// `[N]` integers of the column `name`; `None` where there is no value.
    ///
    /// # Errors
    /// No such column, one of other values or of lists, pages that are damaged.
    pub(super) fn ints(&self, name: &str) -> Result<Vec<Option<i64>>> {
        self.flat(name, "integers", |value| match value {
            Value::Int(value) => Some(value),
            _ => None,
        })
    }

    /// `[N]` numbers of the column `name`; `None` where there is no value.
    ///
    /// # Errors
    /// Those of [`ParquetFile::ints`].
    pub(super) fn floats(&self, name: &str) -> Result<Vec<Option<f64>>> {
        self.flat(name, "floating-point numbers", |value| match value {
            Value::Float(value) => Some(value),
            _ => None,
        })
    }

    /// `[N]` texts of the column `name`; `None` where there is no value.
    ///
    /// # Errors
    /// Those of [`ParquetFile::ints`].
    pub(super) fn texts(&self, name: &str) -> Result<Vec<Option<String>>> {
        self.flat(name, "texts", |value| match value {
            Value::Bytes(bytes) => String::from_utf8(bytes.to_vec()).ok(),
            _ => None,
        })
    }

    /// The bytes of the column `name` in a row; `None` where there is no value.
    ///
    /// # Errors
    /// Those of [`ParquetFile::ints`].
    pub(super) fn bytes(&self, name: &str, row: u64) -> Result<Option<Vec<u8>>> {
        let mut found = None;
        self.visit(name, row..row.saturating_add(1), |_, value| match value {
            Value::Bytes(bytes) => {
                found = Some(bytes.to_vec());
                Ok(())
            }
            _ => Err("bytes"),
        })?;
        Ok(found)
    }

    /// The numbers of the list of the column `name` in a row; none where there is no list.
    ///
    /// # Errors
    /// No such column, one of other values, pages that are damaged.
    #[expect(clippy::cast_precision_loss, reason = "sizes and codes below 2^53")]
    pub(super) fn numbers(&self, name: &str, row: u64) -> Result<Vec<f64>> {
        let mut found = Vec::new();
        self.visit(name, row..row.saturating_add(1), |_, value| {
            found.push(match value {
                Value::Float(value) => value,
                Value::Int(value) => value as f64,
                Value::Bytes(_) => return Err("numbers"),
            });
            Ok(())
        })?;
        Ok(found)
    }

    fn flat<T: Clone>(
        &self,
        name: &str,
        kind: &'static str,
        of: impl Fn(Value<'_>) -> Option<T>,
    ) -> Result<Vec<Option<T>>> {
        let mut values = Vec::new();
        self.visit(name, 0..u64::MAX, |row, value| {
            let row = usize::try_from(row).map_err(|_e| kind)?;
            values.resize(values.len().max(row), None);
            values.truncate(row);
            values.push(Some(of(value).ok_or(kind)?));
            Ok(())
        })?;
        values.resize(usize::try_from(self.footer.num_rows()).unwrap_or(0), None);
        Ok(values)
    }

    /// Calls `act` with each value of some rows of the column `name`, and its row.
    ///
    /// # Errors
    /// No such column, pages that are damaged; what `act` expected instead.
    fn visit(
        &self,
        name: &str,
        rows: Range<u64>,
        mut act: impl FnMut(u64, Value<'_>) -> std::result::Result<(), &'static str>,
    ) -> Result<()> {
        let at = At { file: &self.path, field: name };
        let Some(leaf) = self.footer.leaves.iter().position(|leaf| leaf.name == name) else {
            let names: Vec<&str> = self.footer.leaves.iter().take(20).map(|leaf| leaf.name.as_str()).collect();
            let at = At { field: "columns", ..at };
            return Err(at.error(format!("a column `{name}`"), format!("`{}`", names.join("`, `"))));
        };
        let column = &self.footer.leaves[leaf];
        if column.max_rep > 1 {
            return Err(at.error("values or lists of values", "lists of lists"));
        }
        let mut first = 0_u64;
        for (g, group) in self.footer.groups.iter().enumerate() {
            let end = first.saturating_add(group.num_rows);
            let wanted = rows.start.max(first)..rows.end.min(end);
            if !wanted.is_empty() {
                let place = Place { group: g, leaf, column, chunk: &group.chunks[leaf] };
                let own = wanted.start - first..wanted.end - first;
                self.visit_chunk(at, place, own, |row, value| {
                    act(first + row, value).map_err(|kind| at.error(kind, format!("{:?}", column.physical)))
                })?;
            }
            first = end;
        }
        Ok(())
    }

    /// As [`ParquetFile::visit`], for rows of one group, counted from its first.
    fn visit_chunk(
        &self,
        at: At<'_>,
        place: Place<'_>,
        rows: Range<u64>,
        mut act: impl FnMut(u64, Value<'_>) -> Result<()>,
    ) -> Result<()> {
        let mut file = File::open(&self.path).map_err(|e| FormatError::io(&self.path, "read", e))?;
        let (mut dictionary, mut next, mut row) = (None, None, None::<u64>);
        while let Some((index, found)) = self.page(at, place, &mut file, next, rows.start)? {
            let known = self.dictionary(place);
            if let (None, Some(page)) = (&dictionary, known) {
                dictionary = Some(self.load(at, place, &mut file, &page)?);
            }
            if found.first_row >= rows.end {
                break;
            }
            let page = self.load(at, place, &mut file, &found)?;
            let mut cells = page.cells(at, place.column, dictionary.as_ref())?;
            let mut starts = found.first_row;
            while let Some(Cell { starts: is_start, value }) = cells.next()? {
                if is_start {
                    row = Some(starts);
                    starts += 1;
                }
                match row {
                    Some(row) if row >= rows.end => return Ok(()),
                    Some(row) if row >= rows.start => value.map_or(Ok(()), |value| act(row, value))?,
                    _ => {}
                }
            }
            next = Some(index + 1);
        }
        Ok(())
    }

    /// The page `index` of a chunk, or (`None`) that in which `row` begins; nothing behind the last one.
    fn page(
        &self,
        at: At<'_>,
        place: Place<'_>,
        file: &mut File,
        index: Option<usize>,
        row: u64,
    ) -> Result<Option<(usize, LocatedPage)>> {
        let mut known = self.pages.lock().unwrap_or_else(PoisonError::into_inner);
        let pages = &mut known[place.group][place.leaf];
        loop {
            let index =
                index.unwrap_or_else(|| pages.data.partition_point(|page| page.first_row + page.num_rows <= row));
            if let Some(found) = pages.data.get(index) {
                return Ok(Some((index, *found)));
            }
            if !self.look_on(at, place, file, pages)? {
                return Ok(None);
            }
        }
    }

    fn dictionary(&self, place: Place<'_>) -> Option<LocatedPage> {
        let known = self.pages.lock().unwrap_or_else(PoisonError::into_inner);
        known[place.group][place.leaf].dictionary
    }

    /// Whether there is one more page in a chunk, which is then known.
    fn look_on(&self, at: At<'_>, place: Place<'_>, file: &mut File, pages: &mut Pages) -> Result<bool> {
        let io = |e| FormatError::io(&self.path, "read", e);
        let start = place.chunk.start + pages.next;
        let left = place.chunk.end - start;
        if left == 0 {
            return Ok(false);
        }
        file.seek(SeekFrom::Start(start)).map_err(io)?;
        let mut head = Vec::new();
        file.take(left.min(MAX_HEADER)).read_to_end(&mut head).map_err(io)?;
        let (header, length) = page::header(at, &head)?;
        let whole = length.saturating_add(header.packed);
        if whole > left || header.packed > MAX_PAGE {
            let expected = format!("a page of at most {} bytes, what is left of its column", left.min(MAX_PAGE));
            return Err(at.error(expected, format!("{whole} bytes")));
        }
        pages.num_values += header.num_values;
        let most = page::most_values(place.chunk.end - place.chunk.start);
        if pages.num_values > most {
            return Err(at.error(format!("at most {most} values"), "more"));
        }
        let mut found = LocatedPage { header, body: start + length, first_row: pages.num_rows, num_rows: 0 };
        match header.kind {
            Kind::Data | Kind::DataV2 => {
                let column = place.column;
                found.num_rows = match column.max_rep {
                    0 => header.num_values,
                    _ => self.load(at, place, file, &found)?.num_starts(column),
                };
                pages.num_rows += found.num_rows;
                pages.data.push(found);
            }
            Kind::Dictionary => pages.dictionary = Some(found),
            Kind::Other => {}
        }
        pages.next += whole;
        Ok(true)
    }

    /// The page whose place is known.
    fn load(&self, at: At<'_>, place: Place<'_>, file: &mut File, found: &LocatedPage) -> Result<Page> {
        let io = |e| FormatError::io(&self.path, "read", e);
        file.seek(SeekFrom::Start(found.body)).map_err(io)?;
        let mut body = vec![0; usize::try_from(found.header.packed).unwrap_or(0)];
        file.read_exact(&mut body).map_err(io)?;
        Page::new(at, place.column, &found.header, place.chunk.codec, body)
    }
}

#[cfg(test)]
mod tests;
