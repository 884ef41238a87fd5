//! Correlations as a table and as pictures.

use std::fmt::Write;

use lgs_pages::{Range, csv, scatter};
use serde::Serialize;

use super::{Correlation, Effects, Sample, rank_correlation, sign_agreement};

/// One signal against the truth, for one action.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CorrelationRow {
    /// The signal and its normalisation.
    pub signal: &'static str,
    /// `prune` or `add`.
    pub action: &'static str,
    /// Pairs.
    pub count: usize,
    /// Spearman's rank correlation of delta and true change of the loss.
    pub correlation: f64,
    /// Its standard error.
    pub standard_error: f64,
    /// Share of pairs whose signs agree.
    pub sign_agreement: f64,
    /// Share of actions that truly lower the loss.
    pub helpful: f64,
}

/// Every signal and action.
pub fn rows(sample: &Sample, effects: &Effects) -> Vec<CorrelationRow> {
    let mut rows = Vec::new();
    for measured in &sample.signals {
        for (action, delta, truth) in [("prune", &measured.prune, &effects.prune), ("add", &measured.add, &effects.add)]
        {
            let Correlation { value, error } = rank_correlation(delta, truth);
            rows.push(CorrelationRow {
                signal: measured.signal.name(),
                action,
                count: delta.len(),
                correlation: value,
                standard_error: error,
                sign_agreement: sign_agreement(delta, truth),
                helpful: truth.iter().filter(|&&change| change < 0.0).count() as f64 / truth.len().max(1) as f64,
            });
        }
    }
    rows
}

/// The rows as text.
pub fn table(title: &str, rows: &[CorrelationRow]) -> String {
    let mut text = format!(
        "{title}\n  {:<20} {:<6} {:>5}  {:>14}  {:>5}  {:>7}\n",
        "signal", "action", "n", "rank corr.", "sign", "helpful"
    );
    for row in rows {
        // writing to a String cannot fail
        let _ = writeln!(
            text,
            "  {:<20} {:<6} {:>5}  {:>6.2} +- {:.2}   {:>4.0} %  {:>5.0} %",
            row.signal,
            row.action,
            row.count,
            row.correlation,
            row.standard_error,
            100.0 * row.sign_agreement,
            100.0 * row.helpful
        );
    }
    text
}

/// One line per tried primitive: its index, the true change of the loss by each action, the pixels that it shows, what every signal says.
pub fn pairs(sample: &Sample, effects: &Effects) -> String {
    let mut head = ["primitive", "visible_px", "effect_prune", "effect_add"].map(str::to_owned).to_vec();
    for measured in &sample.signals {
        let key = measured.signal.key();
        head.extend([format!("prune-{key}"), format!("add-{key}")]);
    }
    let lines = sample.chosen.iter().enumerate().map(|(k, primitive)| {
        let values = [sample.visible_px[k], effects.prune[k], effects.add[k]];
        let signals = sample.signals.iter().flat_map(|measured| [measured.prune[k], measured.add[k]]);
        let texts = values.into_iter().chain(signals).map(|value| format!("{value:e}"));
        std::iter::once(primitive.to_string()).chain(texts).collect()
    });
    csv(&head.iter().map(String::as_str).collect::<Vec<_>>(), lines)
}

/// A scatter plot of every signal and action: name of its file, content.
pub fn pictures(title: &str, sample: &Sample, effects: &Effects) -> Vec<(String, String)> {
    let mut pictures = Vec::new();
    for measured in &sample.signals {
        for (action, delta, truth) in [("prune", &measured.prune, &effects.prune), ("add", &measured.add, &effects.add)]
        {
            let (x, y) = (spread(delta), spread(truth));
            let x = Range { name: "delta (signal)", low: -x, high: x };
            let y = Range { name: "change of the loss", low: -y, high: y };
            let points: Vec<[f64; 2]> = delta.iter().zip(truth).map(|(&delta, &truth)| [delta, truth]).collect();
            let signal = measured.signal;
            let svg = scatter(&format!("{action}: {}, {title}", signal.name()), [x, y], &points);
            pictures.push((format!("{action}-{}.svg", signal.key()), svg));
        }
    }
    pictures
}

/// A range that holds 97 of 100 values.
fn spread(values: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = values.iter().map(|v| v.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    sizes.get(sizes.len() * 97 / 100).copied().filter(|&size| size > 0.0).unwrap_or(1.0)
}
