//! The points of a clip, or of all of them, as they stand beside each other.

use serde::Serialize;

use super::{
    front::{Offer, cost_of, on_front},
    record::{PointRecord, SweepRecord},
    setting::Setting,
};
use crate::{
    means::Means,
    statistics::{Quartiles, mean},
};

/// A configuration and its figures.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PointRow {
    /// A name for people.
    pub name: String,
    /// The configuration.
    pub setting: Setting,
    /// Timed runs, the fewest of a clip.
    pub repeats: usize,
    /// Seconds of a reconstruction.
    pub seconds: Quartiles,
    /// Mean figures over the held-out views.
    pub figures: Means,
    /// Gaussians of both branches at the end.
    pub gaussians: f64,
    /// Of them, those of the background.
    pub background: f64,
    /// Largest resident memory, 10^6 bytes.
    pub peak_rss_mb: Option<f64>,
    /// Whether no other point takes no more time, has no lower PSNR, and is better in one of the two.
    pub on_front: bool,
    /// Seconds after which per-scene optimisation comes to the same PSNR; `None` where it does not within its steps.
    pub reference_s: Option<f64>,
    /// File of a part of a view as it was drawn; `None` in a mean.
    pub crop: Option<String>,
}

impl PointRow {
    /// What it costs in seconds, and the figure that `quality` takes.
    pub fn offer(&self, quality: impl Fn(&Means) -> Option<f64>) -> Option<Offer> {
        quality(&self.figures).map(|quality| Offer { cost: self.seconds.median, quality })
    }

    /// How many times faster it is than per-scene optimisation of the same PSNR.
    pub fn speed_up(&self) -> Option<f64> {
        self.reference_s.filter(|_| !self.setting.is_reference()).map(|seconds| seconds / self.seconds.median)
    }

    fn of(point: &PointRecord) -> Option<Self> {
        let gaussians = point.accuracy.gaussians;
        Some(Self {
            name: point.setting.name(),
            setting: point.setting.clone(),
            repeats: point.repeats.len(),
            seconds: Quartiles::of(point.repeats.iter().map(|repeat| repeat.cost.seconds))?,
            figures: point.accuracy.figures,
            gaussians: (gaussians.last + gaussians.background) as f64,
            background: gaussians.background as f64,
            peak_rss_mb: point.peak_rss_mb,
            on_front: false,
            reference_s: None,
            crop: point.crop.clone(),
        })
    }
}

/// The rows of a clip, in the order of `settings`; configurations without a timed run are left out.
pub fn rows(record: &SweepRecord, settings: &[Setting]) -> Vec<PointRow> {
    compared(settings.iter().filter_map(|setting| PointRow::of(record.point(setting)?)).collect())
}

/// The means over clips of the rows that all of them have.
pub fn mean_rows(tables: &[Vec<PointRow>]) -> Vec<PointRow> {
    let Some((first, others)) = tables.split_first() else { return Vec::new() };
    let mean_row = |row: &PointRow| -> Option<PointRow> {
        let mut all = vec![row];
        for table in others {
            all.push(table.iter().find(|other| other.setting == row.setting)?);
        }
        let over = |value: fn(&PointRow) -> Option<f64>| -> Option<f64> {
            let values: Vec<f64> = all.iter().filter_map(|row| value(row)).collect();
            mean(values.iter().copied()).filter(|_| values.len() == all.len())
        };
        Some(PointRow {
            repeats: all.iter().map(|row| row.repeats).min().unwrap_or(0),
            seconds: Quartiles {
                q1: over(|row| Some(row.seconds.q1))?,
                median: over(|row| Some(row.seconds.median))?,
                q3: over(|row| Some(row.seconds.q3))?,
            },
            figures: Means {
                psnr: over(|row| row.figures.psnr),
                ssim: over(|row| row.figures.ssim),
                lpips: over(|row| row.figures.lpips),
                dmae: over(|row| row.figures.dmae),
                psnr_dynamic: over(|row| row.figures.psnr_dynamic),
                psnr_static: over(|row| row.figures.psnr_static),
            },
            gaussians: over(|row| Some(row.gaussians))?,
            background: over(|row| Some(row.background))?,
            peak_rss_mb: over(|row| row.peak_rss_mb),
            crop: None,
            ..row.clone()
        })
    };
    compared(first.iter().filter_map(mean_row).collect())
}

/// The rows with what they say about each other.
fn compared(mut rows: Vec<PointRow>) -> Vec<PointRow> {
    let front = on_front(&rows.iter().map(|row| row.offer(|figures| figures.psnr)).collect::<Vec<_>>());
    let curves = reference_curves(&rows);
    for (row, on_front) in rows.iter_mut().zip(front) {
        row.on_front = on_front;
        row.reference_s = row.figures.psnr.and_then(|psnr| {
            let costs = curves.iter().filter_map(|curve| cost_of(curve, psnr));
            costs.min_by(f64::total_cmp)
        });
    }
    rows
}

/// Of each way to optimise the scene, seconds and PSNR after more and more steps.
fn reference_curves(rows: &[PointRow]) -> Vec<Vec<Offer>> {
    let mut ways: Vec<Vec<&PointRow>> = Vec::new();
    for row in rows.iter().filter(|row| row.setting.is_reference()) {
        match ways.iter_mut().find(|way| way.iter().any(|other| other.setting.differs_in_steps_only(&row.setting))) {
            Some(way) => way.push(row),
            None => ways.push(vec![row]),
        }
    }
    let curve = |mut way: Vec<&PointRow>| {
        way.sort_by_key(|row| row.setting.steps());
        way.into_iter().filter_map(|row| row.offer(|figures| figures.psnr)).collect()
    };
    ways.into_iter().map(curve).collect()
}
