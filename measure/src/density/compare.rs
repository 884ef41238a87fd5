//! Signals against each other on the same clips.

use serde::Serialize;

use super::{record::DensityRecord, signal::Signal};
use crate::statistics::Paired;

/// Signals that others are measured against.
const AGAINST: [Signal; 3] = [Signal::Chance, Signal::Entropy, Signal::Opacity];

/// A signal against another at one percentage, by the held-out PSNR of each clip after the learned refinement.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SignalComparison {
    /// The one.
    pub signal: Signal,
    /// The other; `None`: all Gaussians.
    pub against: Option<Signal>,
    /// Percentage of the Gaussians that stays.
    pub percent: u32,
    /// The first less the second, decibels.
    pub paired: Paired,
}

/// The comparisons that the records allow.
pub fn comparisons(records: &[DensityRecord]) -> Vec<SignalComparison> {
    let Some(settings) = records.first().map(|record| &record.key.settings) else { return Vec::new() };
    let mut all = Vec::new();
    for &signal in settings.signals.iter().filter(|signal| !AGAINST.contains(signal)) {
        for &percent in &settings.percents {
            let others = AGAINST.into_iter().filter(|other| settings.signals.contains(other)).map(Some);
            for against in std::iter::once(None).chain(others) {
                let psnr = |record: &DensityRecord, of| record.at(of, percent)?.learned.psnr;
                let difference = |record| Some(psnr(record, Some(signal))? - psnr(record, against)?);
                let differences: Vec<f64> = records.iter().filter_map(difference).collect();
                let paired = Paired::of(&differences);
                all.extend(paired.map(|paired| SignalComparison { signal, against, percent, paired }));
            }
        }
    }
    all
}
