//! PSNR of the held-out views against the number of Gaussians.

use lgs_pages::{Axis, Curve, CurvesFrame, Scale, curves};

use super::record::DensityRecord;

/// The mean curves of the records as SVG, one for each signal, from all Gaussians down; empty without a figure.
pub fn picture(title: &str, records: &[DensityRecord]) -> String {
    let Some(settings) = records.first().map(|record| &record.key.settings) else { return String::new() };
    let mean = |signal, percent: u32| {
        let psnr = |record: &DensityRecord| record.at(signal, percent)?.learned.psnr;
        let values: Option<Vec<f64>> = records.iter().map(psnr).collect();
        values.map(|values| [f64::from(percent), values.iter().sum::<f64>() / values.len() as f64])
    };
    let curve = |&signal| {
        let all = mean(None, 100);
        let points = all.into_iter().chain(settings.percents.iter().filter_map(|&percent| mean(Some(signal), percent)));
        Curve { name: signal.to_string(), points: points.collect() }
    };
    let all: Vec<Curve> = settings.signals.iter().map(curve).filter(|curve| !curve.points.is_empty()).collect();
    let axes = [
        Axis::new("share of the Gaussians that stays, %", Scale::Even),
        Axis::new("PSNR of held-out views, dB", Scale::Even),
    ];
    curves(&CurvesFrame { title, axes, dots: 3.0 }, &all)
}
