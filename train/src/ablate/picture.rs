//! PSNR of the held-out views against steps, learned and per scene.

use std::path::Path;

use lgs_formats::image::{RgbImage, write_png};
use plotters::{
    backend::BitMapBackend,
    chart::{ChartBuilder, SeriesLabelPosition},
    coord::combinators::IntoLogRange,
    drawing::IntoDrawingArea,
    element::{Circle, PathElement},
    series::LineSeries,
    style::{BLACK, Color, IntoFont, Palette, Palette99, WHITE},
};

use super::record::{ClipRecord, CurveOf};
use crate::{
    error::{Result, TrainError},
    stages::plot::{FONT, know_font},
};

/// Width and height, pixels.
const SIZE: [u32; 2] = [960, 540];
/// Where 0 steps stand on the logarithmic axis.
const NO_STEPS: f64 = 0.5;

/// A course: steps, and PSNR in decibels.
struct Curve {
    name: String,
    points: Vec<[f64; 2]>,
}

/// Nothing: afterwards `file` shows the mean curves of the records; no picture without a figure. A point is drawn where all records that
/// begin the curve have it.
///
/// # Errors
/// When it cannot be drawn or written.
pub fn picture(title: &str, records: &[ClipRecord], file: &Path) -> Result<()> {
    let kinds: [(&str, CurveOf); 3] = [
        ("learned", |r| &r.learned),
        ("Adam, same start", |r| &r.adam),
        ("Adam from the initial Gaussians", |r| &r.adam_from_start),
    ];
    let curves: Vec<Curve> = kinds
        .into_iter()
        .map(|(name, of)| Curve { name: name.to_owned(), points: mean_curve(records, of) })
        .filter(|curve| !curve.points.is_empty())
        .collect();
    if curves.is_empty() {
        return Ok(());
    }
    let mut pixels = vec![0_u8; (SIZE[0] * SIZE[1] * 3) as usize];
    draw(&mut pixels, &curves, title).map_err(TrainError::Plot)?;
    let data = pixels.iter().map(|&v| f32::from(v) / 255.0).collect();
    Ok(write_png(file, &RgbImage { width: SIZE[0] as usize, height: SIZE[1] as usize, data })?)
}

fn mean_curve(records: &[ClipRecord], of: CurveOf) -> Vec<[f64; 2]> {
    let steps: Vec<usize> =
        records.first().map(|r| of(r).iter().map(|point| point.steps).collect()).unwrap_or_default();
    let mean = |steps: usize| {
        let values: Option<Vec<f64>> = records.iter().map(|r| ClipRecord::at(of(r), steps)?.figures.psnr).collect();
        values.map(|values| [(steps as f64).max(NO_STEPS), values.iter().sum::<f64>() / values.len() as f64])
    };
    steps.into_iter().filter_map(mean).collect()
}

/// Draws curves; the error is what the library says.
fn draw(pixels: &mut [u8], curves: &[Curve], title: &str) -> std::result::Result<(), String> {
    know_font()?;
    let text = |error: &dyn std::fmt::Display| error.to_string();
    let all = || curves.iter().flat_map(|curve| &curve.points);
    let last = all().map(|p| p[0]).fold(1.0, f64::max);
    let [low, high] = all().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], p| [low.min(p[1]), high.max(p[1])]);
    let margin = 0.05 * (high - low).max(0.1);
    let area = BitMapBackend::with_buffer(pixels, (SIZE[0], SIZE[1])).into_drawing_area();
    area.fill(&WHITE).map_err(|e| text(&e))?;
    let mut chart = ChartBuilder::on(&area)
        .caption(title, (FONT, 20).into_font())
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size(64)
        .build_cartesian_2d((NO_STEPS..last * 1.2).log_scale(), low - margin..high + margin)
        .map_err(|e| text(&e))?;
    chart
        .configure_mesh()
        .label_style((FONT, 13))
        .x_desc("steps (logarithmic; 0 at the left)")
        .y_desc("PSNR of held-out views, dB")
        .x_label_formatter(&|x| if *x < 1.0 { "0".to_owned() } else { format!("{x:.0}") })
        .draw()
        .map_err(|e| text(&e))?;
    for (k, curve) in curves.iter().enumerate() {
        let style = Palette99::pick(k).stroke_width(2);
        let line = LineSeries::new(curve.points.iter().map(|p| (p[0], p[1])), style);
        let legend = move |(x, y)| PathElement::new([(x, y), (x + 16, y)], style);
        chart.draw_series(line).map_err(|e| text(&e))?.label(curve.name.clone()).legend(legend);
        let dots = curve.points.iter().map(|p| Circle::new((p[0], p[1]), 3, style.filled()));
        chart.draw_series(dots).map_err(|e| text(&e))?;
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::LowerRight)
        .background_style(WHITE.mix(0.8))
        .border_style(BLACK)
        .label_font((FONT, 13))
        .draw()
        .map_err(|e| text(&e))?;
    drop(chart);
    area.present().map_err(|e| text(&e))
}
