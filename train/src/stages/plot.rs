//! Curves of a table as a picture.

use std::{path::Path, sync::OnceLock};

use lgs_formats::image::{RgbImage, write_png};
use plotters::{
    backend::BitMapBackend,
    chart::{ChartBuilder, SeriesLabelPosition},
    drawing::IntoDrawingArea,
    element::PathElement,
    series::LineSeries,
    style::{BLACK, Color, FontStyle, IntoFont, Palette, Palette99, WHITE, register_font},
};

use super::record::Table;
use crate::error::{Result, TrainError};

/// Width and height, pixels.
const SIZE: [u32; 2] = [960, 540];
/// At most so many points a curve: more rows are averaged in groups, so that noise does not hide the course.
const POINTS: usize = 200;
/// The font of all pictures; see [`know_font`].
pub(crate) const FONT: &str = "sans-serif";

/// A course of a column.
struct Curve<'a> {
    name: &'a str,
    points: Vec<[f64; 2]>,
}

/// Nothing: afterwards `file` shows the `columns` of the table over its first one. A table without two rows of values makes no picture.
///
/// # Errors
/// When the picture cannot be drawn or written.
pub fn plot(table: &Table, columns: &[usize], title: &str, file: &Path) -> Result<()> {
    let curves: Vec<Curve<'_>> = columns.iter().map(|&column| curve(table, column)).collect();
    let all = || curves.iter().flat_map(|curve| &curve.points);
    let bounds = |k: usize| {
        all().map(|point| point[k]).fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
    };
    let [x, y] = [0, 1].map(bounds);
    // Nothing to draw: no values, or all at one step.
    if all().count() == 0 || x[0] >= x[1] {
        return Ok(());
    }
    let margin = 0.05 * (y[1] - y[0]).max(1e-9 + 1e-6 * y[1].abs());
    let mut pixels = vec![0_u8; (SIZE[0] * SIZE[1] * 3) as usize];
    draw(&mut pixels, &curves, title, [x, [y[0] - margin, y[1] + margin]]).map_err(TrainError::Plot)?;
    let data = pixels.iter().map(|&v| f32::from(v) / 255.0).collect();
    Ok(write_png(file, &RgbImage { width: SIZE[0] as usize, height: SIZE[1] as usize, data })?)
}

fn curve(table: &Table, column: usize) -> Curve<'_> {
    let group = table.rows().len().div_ceil(POINTS).max(1);
    let point = |rows: &[Vec<f64>]| {
        let finite: Vec<&Vec<f64>> = rows.iter().filter(|row| row[column].is_finite()).collect();
        let mean = |k: usize| finite.iter().map(|row| row[k]).sum::<f64>() / finite.len() as f64;
        (!finite.is_empty()).then(|| [mean(0), mean(column)])
    };
    Curve { name: &table.columns()[column], points: table.rows().chunks(group).filter_map(point).collect() }
}

/// Nothing: afterwards [`FONT`] can be drawn with; the error is a sentence.
pub(crate) fn know_font() -> std::result::Result<(), String> {
    static FONT_KNOWN: OnceLock<bool> = OnceLock::new();
    if *FONT_KNOWN.get_or_init(|| register_font(FONT, FontStyle::Normal, dejavu::sans::regular()).is_ok()) {
        return Ok(());
    }
    Err("the font cannot be read".to_owned())
}

/// Draws curves; the error is what the library says.
fn draw(
    pixels: &mut [u8],
    curves: &[Curve<'_>],
    title: &str,
    [x, y]: [[f64; 2]; 2],
) -> std::result::Result<(), String> {
    know_font()?;
    let text = |error: &dyn std::fmt::Display| error.to_string();
    let area = BitMapBackend::with_buffer(pixels, (SIZE[0], SIZE[1])).into_drawing_area();
    area.fill(&WHITE).map_err(|e| text(&e))?;
    let mut chart = ChartBuilder::on(&area)
        .caption(title, (FONT, 20).into_font())
        .margin(12)
        .x_label_area_size(36)
        .y_label_area_size(64)
        .build_cartesian_2d(x[0]..x[1], y[0]..y[1])
        .map_err(|e| text(&e))?;
    chart.configure_mesh().label_style((FONT, 13)).x_desc("step").draw().map_err(|e| text(&e))?;
    for (k, curve) in curves.iter().enumerate() {
        let style = Palette99::pick(k).stroke_width(2);
        let line = LineSeries::new(curve.points.iter().map(|p| (p[0], p[1])), style);
        let legend = move |(x, y)| PathElement::new([(x, y), (x + 16, y)], style);
        chart.draw_series(line).map_err(|e| text(&e))?.label(curve.name).legend(legend);
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .background_style(WHITE.mix(0.8))
        .border_style(BLACK)
        .label_font((FONT, 13))
        .draw()
        .map_err(|e| text(&e))?;
    drop(chart);
    area.present().map_err(|e| text(&e))
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
        let file = dir.path().join("t.png");
        plot(&table, &[1, 2], "none", &file).unwrap();
        assert!(!file.exists(), "nothing to draw");
        for k in 0..500 {
            table.push(vec![f64::from(k), f64::from(k % 7), if k % 5 == 0 { f64::NAN } else { 3.0 }]);
        }
        plot(&table, &[1, 2], "two", &file).unwrap();
        assert!(std::fs::metadata(&file).unwrap().len() > 2_000);
    }
}
