//! Curves as a picture.

use std::{path::Path, sync::OnceLock};

use lgs_formats::image::{RgbImage, write_png};
use plotters::{
    backend::BitMapBackend,
    chart::{ChartBuilder, SeriesLabelPosition},
    coord::ranged1d::{AsRangedCoord, ValueFormatter},
    drawing::IntoDrawingArea,
    element::{Circle, PathElement},
    series::LineSeries,
    style::{BLACK, Color, FontStyle, IntoFont, Palette, Palette99, WHITE, register_font},
};

use crate::error::{Result, TrainError};

/// Width and height, pixels.
const SIZE: [u32; 2] = [960, 540];
/// Room above and below the curves, as a share of their height.
const MARGIN: f64 = 0.05;
/// The font; see [`know_font`].
const FONT: &str = "sans-serif";

/// A course.
#[derive(Clone, Debug)]
pub(crate) struct Curve {
    /// Its name.
    pub(crate) name: String,
    /// Along and up.
    pub(crate) points: Vec<[f64; 2]>,
}

/// What stands around curves.
#[derive(Clone, Debug)]
pub(crate) struct Frame<'a> {
    pub(crate) title: &'a str,
    /// What the axes show.
    pub(crate) axes: [&'a str; 2],
    /// Least height of the picture, in what the curves show.
    pub(crate) least: f64,
    /// Radius of the dot at every point, pixels; 0 for none.
    pub(crate) dots: u32,
    /// Where the names stand.
    pub(crate) names: SeriesLabelPosition,
    /// A number along the first axis as text.
    pub(crate) label: fn(&f64) -> String,
}

/// The least and the largest value of curves, along (0) or up (1).
pub(crate) fn bounds(curves: &[Curve], axis: usize) -> [f64; 2] {
    let values = curves.iter().flat_map(|curve| &curve.points).map(|point| point[axis]);
    values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
}

/// Nothing: afterwards `file` shows the curves over the axis `along`.
///
/// # Errors
/// When the picture cannot be drawn or written.
pub(crate) fn draw<X>(file: &Path, curves: &[Curve], frame: &Frame<'_>, along: X) -> Result<()>
where
    X: AsRangedCoord<Value = f64>,
    X::CoordDescType: ValueFormatter<f64>,
{
    let mut pixels = vec![0_u8; (SIZE[0] * SIZE[1] * 3) as usize];
    paint(&mut pixels, curves, frame, along).map_err(TrainError::Plot)?;
    let data = pixels.iter().map(|&v| f32::from(v) / 255.0).collect();
    Ok(write_png(file, &RgbImage { width: SIZE[0] as usize, height: SIZE[1] as usize, data })?)
}

/// Draws curves; the error is what the library says.
fn paint<X>(pixels: &mut [u8], curves: &[Curve], frame: &Frame<'_>, along: X) -> std::result::Result<(), String>
where
    X: AsRangedCoord<Value = f64>,
    X::CoordDescType: ValueFormatter<f64>,
{
    know_font()?;
    let text = |error: &dyn std::fmt::Display| error.to_string();
    let [low, high] = bounds(curves, 1);
    let margin = MARGIN * (high - low).max(frame.least).max(1e-6 * high.abs());
    let area = BitMapBackend::with_buffer(pixels, (SIZE[0], SIZE[1])).into_drawing_area();
    area.fill(&WHITE).map_err(|e| text(&e))?;
    let mut chart = ChartBuilder::on(&area)
        .caption(frame.title, (FONT, 20).into_font())
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size(64)
        .build_cartesian_2d(along, low - margin..high + margin)
        .map_err(|e| text(&e))?;
    let [x, y] = frame.axes;
    let mut mesh = chart.configure_mesh();
    mesh.label_style((FONT, 13)).x_desc(x).y_desc(y).x_label_formatter(&frame.label);
    mesh.draw().map_err(|e| text(&e))?;
    for (k, curve) in curves.iter().enumerate() {
        let style = Palette99::pick(k).stroke_width(2);
        let points = || curve.points.iter().map(|p| (p[0], p[1]));
        let legend = move |(x, y)| PathElement::new([(x, y), (x + 16, y)], style);
        let line = chart.draw_series(LineSeries::new(points(), style)).map_err(|e| text(&e))?;
        line.label(curve.name.clone()).legend(legend);
        if frame.dots > 0 {
            let dots = points().map(|point| Circle::new(point, frame.dots, style.filled()));
            chart.draw_series(dots).map_err(|e| text(&e))?;
        }
    }
    chart
        .configure_series_labels()
        .position(frame.names.clone())
        .background_style(WHITE.mix(0.8))
        .border_style(BLACK)
        .label_font((FONT, 13))
        .draw()
        .map_err(|e| text(&e))?;
    drop(chart);
    area.present().map_err(|e| text(&e))
}

/// Nothing: afterwards [`FONT`] can be drawn with; the error is a sentence.
fn know_font() -> std::result::Result<(), String> {
    static FONT_KNOWN: OnceLock<bool> = OnceLock::new();
    if *FONT_KNOWN.get_or_init(|| register_font(FONT, FontStyle::Normal, dejavu::sans::regular()).is_ok()) {
        return Ok(());
    }
    Err("the font cannot be read".to_owned())
}
