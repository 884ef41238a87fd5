//! Curves of a table as a picture.

use std::path::Path;

use lgs_formats::write::write_atomic;
use lgs_pages::{Axis, Curve, CurvesFrame, Scale, curves};

use super::record::Table;
use crate::error::Result;

/// At most so many points a curve: more rows are averaged in groups, so that noise does not hide the course.
const POINTS: usize = 200;

/// Writes the `columns` of the table over its first one into `file`, as SVG. A table without two rows of values makes no picture.
///
/// # Errors
/// When the picture cannot be written.
pub fn plot(table: &Table, columns: &[usize], title: &str, file: &Path) -> Result<()> {
    let courses: Vec<Curve> = columns.iter().map(|&column| curve(table, column)).collect();
    if courses.iter().all(|curve| curve.points.len() < 2) {
        return Ok(());
    }
    let axes = ["step", ""].map(|label| Axis::new(label, Scale::Even));
    let svg = curves(&CurvesFrame { title, axes, dots: 0.0 }, &courses);
    Ok(write_atomic(file, svg.as_bytes())?)
}

fn curve(table: &Table, column: usize) -> Curve {
    let group = table.rows().len().div_ceil(POINTS).max(1);
    let point = |rows: &[Vec<f64>]| {
        let finite: Vec<&Vec<f64>> = rows.iter().filter(|row| row[column].is_finite()).collect();
        let mean = |k: usize| finite.iter().map(|row| row[k]).sum::<f64>() / finite.len() as f64;
        (!finite.is_empty()).then(|| [mean(0), mean(column)])
    };
    Curve { name: table.columns()[column].clone(), points: table.rows().chunks(group).filter_map(point).collect() }
}

#[cfg(test)]
mod tests {
    use super::super::record::Table;
    use super::plot;

    #[test]
    fn curves_become_a_picture() {
        let dir = tempfile::tempdir().unwrap();
        let columns = ["step", "a", "b"].map(str::to_owned).to_vec();
        let mut table = Table::open(dir.path().join("t.csv"), columns, 0).unwrap();
        let file = dir.path().join("t.svg");
        plot(&table, &[1, 2], "none", &file).unwrap();
        assert!(!file.exists(), "nothing to draw");
        for k in 0..500 {
            table.push(vec![f64::from(k), f64::from(k % 7), if k % 5 == 0 { f64::NAN } else { 3.0 }]);
        }
        plot(&table, &[1, 2], "two", &file).unwrap();
        assert!(std::fs::metadata(&file).unwrap().len() > 2_000);
    }
}
