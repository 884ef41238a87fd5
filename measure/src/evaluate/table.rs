//! The table that people read in a terminal: the paper's rows, and ours below.

use std::fmt::Write;

use lgs_pages::{count, or_dash};

use super::{
    figures::{Figures, Kind, kinds},
    findings::Findings,
    paper::{PaperTable, SECONDS, columns, paper_table},
};

/// A row of the table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Row {
    /// What it is of.
    pub name: String,
    /// Its cells, in the order of the columns.
    pub cells: Vec<String>,
}

/// The heading of a column.
pub fn heading(column: &str) -> String {
    let kind = kinds().into_iter().find(|kind| kind.key == column);
    kind.map_or("s a scene".to_owned(), |kind| {
        let label = kind.label.replace(" (dB)", "").replace(" (m)", "");
        let arrow = kind.more_is_better.map_or("", |more| if more { " ↑" } else { " ↓" });
        label + arrow
    })
}

/// The paper's rows.
pub fn paper_rows(table: &PaperTable, columns: &[&str]) -> Vec<Row> {
    let of_row = |row: &super::paper::PaperRow| {
        let value = |column: &&str| table.columns.iter().position(|own| own == column).and_then(|at| row.values[at]);
        let cell = |column: &&str| or_dash(value(column), digits(column));
        Row { name: row.method.to_owned(), cells: columns.iter().map(cell).collect() }
    };
    table.rows.iter().map(of_row).collect()
}

/// The rows of what was found: each recipe, and the nearest input image in the place of every target.
pub fn own_rows(findings: &Findings, columns: &[&str]) -> Vec<Row> {
    let recipes = findings.key.recipes.iter().enumerate().map(|(index, recipe)| {
        let means = findings.averages(index, None).image;
        let seconds = or_dash(findings.seconds(index), digits(SECONDS));
        Row { name: recipe.name.clone(), cells: cells(&means, &seconds, columns) }
    });
    let copied = findings.averages(0, None).image.get("psnr_copying");
    let cell = |column: &&str| if *column == "psnr" { or_dash(copied, 2) } else { "–".to_owned() };
    let copying = Row { name: "nearest input, copied".to_owned(), cells: columns.iter().map(cell).collect() };
    recipes.chain([copying]).collect()
}

/// The cells of figures.
pub fn cells(figures: &Figures, seconds: &str, columns: &[&str]) -> Vec<String> {
    let cell = |column: &&str| {
        let kind: Option<Kind> = kinds().into_iter().find(|kind| kind.key == *column);
        kind.map_or_else(|| seconds.to_owned(), |kind| figures.text(&kind))
    };
    columns.iter().map(cell).collect()
}

fn digits(column: &str) -> usize {
    kinds().into_iter().find(|kind| kind.key == column).map_or(2, |kind| kind.digits)
}

/// What was measured, in a line.
pub fn counts(findings: &Findings) -> String {
    let (logs, snippets) = (count(findings.logs().len(), "log"), count(findings.snippets.len(), "snippet"));
    let failed = findings.failed.len();
    let failed = if failed == 0 { String::new() } else { format!(", {failed} failed") };
    format!("{snippets} of {logs}, {}{failed}", count(findings.num_images(), "image"))
}

/// Of which data the paper's rows are, seen from here.
pub fn papers_data(findings: &Findings, table: &PaperTable) -> String {
    let same = if findings.is_of_the_papers_data() { "the same data" } else { "other data than here" };
    format!("{same}: {}", table.data)
}

/// The table as text.
pub fn text(findings: &Findings) -> String {
    let columns = columns(findings.protocol());
    let own = own_rows(findings, &columns);
    let table = paper_table(findings.protocol());
    let paper = table.map_or(Vec::new(), |table| paper_rows(table, &columns));
    let headings: Vec<String> = columns.iter().map(|column| heading(column)).collect();
    let name_width = own.iter().chain(&paper).map(|row| row.name.chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = headings.iter().map(|heading| heading.chars().count().max(7)).collect();
    let line = |name: &str, cells: &[String]| {
        let cells = cells.iter().zip(&widths).map(|(cell, &width)| format!("  {cell:>width$}"));
        format!("  {name:<name_width$}{}\n", cells.collect::<String>())
    };
    let mut text = format!("{} protocol: {}\n", findings.protocol().word(), findings.cutting());
    text += &line("", &headings);
    if let Some(table) = table {
        // Writing to a String cannot fail.
        let _ = writeln!(text, "paper, {}", papers_data(findings, table));
        text.extend(paper.iter().map(|row| line(&row.name, &row.cells)));
    }
    let _ = writeln!(text, "here, {}; means over images", counts(findings));
    text.extend(own.iter().map(|row| line(&row.name, &row.cells)));
    if findings.key.lpips_weights.is_none() && columns.contains(&"lpips") {
        text += "LPIPS is not measured: its weights were not given\n";
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::{
        protocol::Protocol,
        samples::{findings, snippet},
    };

    #[test]
    fn our_rows_stand_below_those_of_the_paper_which_are_marked_as_of_other_data() {
        let found = findings(&Protocol::pandaset(), vec![snippet("002", &[20.0, 30.0], &[10.0])]);
        let text = text(&found);
        let lines: Vec<&str> = text.lines().collect();
        assert!(lines[0].starts_with("pandaset protocol: snippets of 11 frames"), "{text}");
        assert!(text.contains("paper, other data than here: PandaSet"), "{text}");
        assert!(text.contains("here, 1 snippet of 1 log, 2 images; means over images"), "{text}");
        let cells = |name: &str| {
            let line = lines.iter().find(|line| line.trim_start().starts_with(name)).unwrap_or(&"");
            line.split_whitespace().rev().take(7).map(str::to_owned).collect::<Vec<_>>()
        };
        assert_eq!(cells("LGS  "), ["1.92", "1.52", "0.762", "25.03", "2.06", "0.678", "22.43"]);
        assert_eq!(cells("<own>"), ["1.00", "–", "–", "25.00", "–", "–", "10.00"]);
        assert_eq!(cells("nearest input"), ["–", "–", "–", "–", "–", "–", "–"]);
    }
}
