//! Tables of what a run did, as CSV.

use std::path::PathBuf;

use lgs_formats::{error::FormatError, write::write_atomic};
use lgs_pages::{csv, csv_rows};

use crate::error::Result;

/// A table whose first column is the step.
#[derive(Clone, Debug)]
pub struct Table {
    file: PathBuf,
    columns: Vec<String>,
    rows: Vec<Vec<f64>>,
}

impl Table {
    /// The table in `file` up to and including `step`; an empty one when there is no such file or its columns are others.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn open(file: PathBuf, columns: Vec<String>, step: u64) -> Result<Self> {
        let text = match std::fs::read_to_string(&file) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => String::new(),
            Err(error) => return Err(FormatError::io(&file, "read", error).into()),
        };
        let mut lines = csv_rows(&text).into_iter();
        let same = lines.next().is_some_and(|head| head == columns);
        let parse = |line: Vec<String>| line.iter().map(|value| value.parse().ok()).collect::<Option<Vec<f64>>>();
        let mut rows: Vec<Vec<f64>> = if same { lines.filter_map(parse).collect() } else { Vec::new() };
        rows.retain(|row| row.len() == columns.len() && row[0] <= step as f64);
        Ok(Self { file, columns, rows })
    }

    /// Adds a row.
    pub fn push(&mut self, row: Vec<f64>) {
        self.rows.push(row);
    }

    /// Names of the columns.
    pub fn columns(&self) -> &[String] {
        &self.columns
    }

    /// The rows.
    pub fn rows(&self) -> &[Vec<f64>] {
        &self.rows
    }

    /// Writes the table into its file.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write(&self) -> Result<()> {
        let head: Vec<&str> = self.columns.iter().map(String::as_str).collect();
        let lines = self.rows.iter().map(|row| row.iter().map(f64::to_string).collect::<Vec<_>>());
        let text = csv(&head, lines);
        Ok(write_atomic(&self.file, text.as_bytes())?)
    }
}

#[cfg(test)]
mod tests {
    use super::Table;

    #[test]
    fn a_table_goes_on_after_a_step() {
        let dir = tempfile::tempdir().unwrap();
        let (file, columns) = (dir.path().join("a.csv"), vec!["step".to_owned(), "x".to_owned()]);
        let mut table = Table::open(file.clone(), columns.clone(), 0).unwrap();
        (1..=3).for_each(|k| table.push(vec![f64::from(k), 0.1 * f64::from(k)]));
        table.push(vec![4.0, f64::NAN]);
        table.write().unwrap();
        assert_eq!(std::fs::read_to_string(&file).unwrap(), "step,x\n1,0.1\n2,0.2\n3,0.30000000000000004\n4,NaN\n");
        let again = Table::open(file.clone(), columns, 2).unwrap();
        assert_eq!(again.rows(), [vec![1.0, 0.1], vec![2.0, 0.2]]);
        let others = Table::open(file, vec!["step".to_owned()], 9).unwrap();
        assert!(others.rows().is_empty());
    }
}
