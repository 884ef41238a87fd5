//! PSNR of the held-out views against steps, learned and per scene.

use std::path::Path;

use plotters::{chart::SeriesLabelPosition, coord::combinators::IntoLogRange};

use super::record::{ClipRecord, CurveOf};
use crate::{
    curves::{Curve, Frame, bounds, draw},
    error::Result,
};

/// Where 0 steps stand on the logarithmic axis.
const NO_STEPS: f64 = 0.5;

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
    let label = |x: &f64| if *x < 1.0 { "0".to_owned() } else { format!("{x:.0}") };
    let axes = ["steps (logarithmic; 0 at the left)", "PSNR of held-out views, dB"];
    let frame = Frame { title, axes, least: 0.1, dots: 3, names: SeriesLabelPosition::LowerRight, label };
    draw(file, &curves, &frame, (NO_STEPS..bounds(&curves, 0)[1].max(1.0) * 1.2).log_scale())
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
