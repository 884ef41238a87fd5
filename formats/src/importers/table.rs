//! Tables of named columns, as feather files and pickled frames hold them.

use std::{
    borrow::Cow,
    path::{Path, PathBuf},
};

use crate::error::{FormatError, Result};

/// The values of a column.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Column {
    Floats(Vec<f64>),
    Ints(Vec<i64>),
    /// `None` where the table has no value.
    Texts(Vec<Option<String>>),
    /// Values that no importer needs, and what they are.
    Other(String),
}

impl Column {
    fn len(&self) -> Option<usize> {
        match self {
            Self::Floats(values) => Some(values.len()),
            Self::Ints(values) => Some(values.len()),
            Self::Texts(values) => Some(values.len()),
            Self::Other(_) => None,
        }
    }

    fn kind(&self) -> &str {
        match self {
            Self::Floats(_) => "floating-point numbers",
            Self::Ints(_) => "integers",
            Self::Texts(_) => "texts",
            Self::Other(kind) => kind,
        }
    }
}

/// A column and its name.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Named {
    pub(super) name: String,
    pub(super) column: Column,
}

/// Columns of one length.
#[derive(Clone, Debug)]
pub(super) struct Table {
    file: PathBuf,
    len: usize,
    columns: Vec<Named>,
}

impl Table {
    /// A table of columns that were read from `file`.
    ///
    /// # Errors
    /// A column whose length is not `len`.
    pub(super) fn new(file: &Path, len: usize, columns: Vec<Named>) -> Result<Self> {
        for Named { name, column } in &columns {
            if let Some(found) = column.len().filter(|&found| found != len) {
                return Err(FormatError::invalid(file, name, format!("{len} values"), format!("{found}")));
            }
        }
        Ok(Self { file: file.to_owned(), len, columns })
    }

    /// The number of rows.
    pub(super) fn len(&self) -> usize {
        self.len
    }

    /// Whether there is a column `name`.
    pub(super) fn has(&self, name: &str) -> bool {
        self.columns.iter().any(|column| column.name == name)
    }

    /// `[N]` numbers of the column `name`.
    ///
    /// # Errors
    /// No such column, or one of texts.
    #[expect(clippy::cast_precision_loss, reason = "counters and codes below 2^53")]
    pub(super) fn floats(&self, name: &str) -> Result<Cow<'_, [f64]>> {
        match self.column(name)? {
            Column::Floats(values) => Ok(Cow::Borrowed(values)),
            Column::Ints(values) => Ok(Cow::Owned(values.iter().map(|&value| value as f64).collect())),
            other => Err(self.wrong(name, "numbers", other)),
        }
    }

    /// `[N]` integers of the column `name`.
    ///
    /// # Errors
    /// No such column, or one of other values.
    pub(super) fn ints(&self, name: &str) -> Result<&[i64]> {
        match self.column(name)? {
            Column::Ints(values) => Ok(values),
            other => Err(self.wrong(name, "integers", other)),
        }
    }

    /// The text of the column `name` in row `row`.
    ///
    /// # Errors
    /// No such column, one of other values, no value in that row.
    pub(super) fn text(&self, name: &str, row: usize) -> Result<&str> {
        match self.column(name)? {
            Column::Texts(values) => values
                .get(row)
                .and_then(Option::as_deref)
                .ok_or_else(|| FormatError::invalid(&self.file, format!("{name}[{row}]"), "a text", "none")),
            other => Err(self.wrong(name, "texts", other)),
        }
    }

    /// Rows of the columns `names`, side by side.
    ///
    /// # Errors
    /// Those of [`Table::floats`].
    pub(super) fn rows<const K: usize>(&self, names: [&str; K]) -> Result<Vec<[f64; K]>> {
        // First of all: only a column that is there has as many values as the table says.
        let columns = names.into_iter().map(|name| self.floats(name)).collect::<Result<Vec<_>>>()?;
        let mut rows = vec![[0.0; K]; self.len];
        for (k, column) in columns.iter().enumerate() {
            for (row, &value) in rows.iter_mut().zip(column.iter()) {
                row[k] = value;
            }
        }
        Ok(rows)
    }

    fn column(&self, name: &str) -> Result<&Column> {
        let found = self.columns.iter().find(|column| column.name == name).map(|column| &column.column);
        found.ok_or_else(|| {
            let names: Vec<&str> = self.columns.iter().map(|column| column.name.as_str()).collect();
            FormatError::invalid(
                &self.file,
                "columns",
                format!("a column `{name}`"),
                format!("`{}`", names.join("`, `")),
            )
        })
    }

    fn wrong(&self, name: &str, expected: &str, found: &Column) -> FormatError {
        FormatError::invalid(&self.file, name, expected, found.kind())
    }
}
