//! PSNR of the held-out views against steps, learned and per scene.

use lgs_pages::{Axis, Curve, CurvesFrame, Scale, curves, number};

use super::record::{AblationRecord, CurveOf};

/// Where 0 steps stand on the logarithmic axis.
const NO_STEPS: f64 = 0.5;

/// The mean curves of the records as SVG; empty without a figure. A point is drawn where all records that begin the curve have it.
pub fn picture(title: &str, records: &[AblationRecord]) -> String {
    let kinds: [(&str, CurveOf); 3] = [
        ("learned", |r| &r.learned),
        ("Adam, same start", |r| &r.adam),
        ("Adam from the initial Gaussians", |r| &r.adam_from_start),
    ];
    let means: Vec<Curve> = kinds
        .into_iter()
        .map(|(name, of)| Curve { name: name.to_owned(), points: mean_curve(records, of) })
        .filter(|curve| !curve.points.is_empty())
        .collect();
    let tick = |steps: f64| if steps < 1.0 { "0".to_owned() } else { number(steps) };
    let steps = Axis { label: "steps (logarithmic; 0 at the left)", scale: Scale::Logarithmic, tick };
    let axes = [steps, Axis::new("PSNR of held-out views, dB", Scale::Even)];
    curves(&CurvesFrame { title, axes, dots: 3.0 }, &means)
}

fn mean_curve(records: &[AblationRecord], of: CurveOf) -> Vec<[f64; 2]> {
    let steps: Vec<usize> =
        records.first().map(|r| of(r).iter().map(|point| point.steps).collect()).unwrap_or_default();
    let mean = |steps: usize| {
        let values: Option<Vec<f64>> = records.iter().map(|r| AblationRecord::at(of(r), steps)?.figures.psnr).collect();
        values.map(|values| [(steps as f64).max(NO_STEPS), values.iter().sum::<f64>() / values.len() as f64])
    };
    steps.into_iter().filter_map(mean).collect()
}
