//! Tables of comma-separated values.

/// A table: the names of the columns, then a line for each row. Fields are quoted where a reader needs it.
pub fn csv<R, F>(head: &[&str], rows: R) -> String
where
    R: IntoIterator<Item = Vec<F>>,
    F: AsRef<str>,
{
    let mut writer = csv::WriterBuilder::new().flexible(true).from_writer(Vec::new());
    // Writing to a vector cannot fail.
    let _ = writer.write_record(head);
    for row in rows {
        let _ = writer.write_record(row.iter().map(|field| field.as_ref().as_bytes()));
    }
    String::from_utf8(writer.into_inner().unwrap_or_default()).unwrap_or_default()
}

/// The rows of a table, the names of its columns first. What comes after a line that is no such row is left out.
pub fn csv_rows(table: &str) -> Vec<Vec<String>> {
    let mut reader = csv::ReaderBuilder::new().has_headers(false).flexible(true).from_reader(table.as_bytes());
    reader.records().map_while(Result::ok).map(|row| row.iter().map(str::to_owned).collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::{csv, csv_rows};

    #[test]
    fn what_was_written_is_read() {
        let rows = [vec!["x y", "1, \"2\""], vec!["", "3\n4"], vec!["one"]];
        assert_eq!(csv_rows(&csv(&["a", "b"], rows.clone())), [vec![vec!["a", "b"]], rows.to_vec()].concat());
        assert!(csv_rows("").is_empty());
    }

    #[test]
    fn fields_are_quoted_where_a_reader_needs_it() {
        assert_eq!(
            csv(&["a", "b"], [vec!["x y", "1, \"2\""], vec!["", "3\n4"]]),
            "a,b\nx y,\"1, \"\"2\"\"\"\n,\"3\n4\"\n"
        );
        assert_eq!(csv(&["a"], Vec::<Vec<String>>::new()), "a\n");
    }
}
