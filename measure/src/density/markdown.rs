//! The tables as Markdown.

use std::fmt::Write;

use lgs_pages::{or_dash, thousands};

use super::{
    compare::{SignalComparison, comparisons},
    record::{DensityPoint, DensityRecord},
};

/// A page: a table for each clip, and the signals against each other over all clips.
pub fn markdown(records: &[DensityRecord]) -> String {
    let mut page = String::new();
    for record in records {
        page += &clip_table(record);
    }
    if records.len() > 1 {
        page += &comparison_table(&comparisons(records), records.len());
    }
    page
}

fn clip_table(record: &DensityRecord) -> String {
    let settings = &record.key.settings;
    let steps = settings.refine_steps;
    let mut table = format!(
        "## {}\n\n| Gaussians | % | % of pixels | decides | PSNR, {steps} learned steps | SSIM | dynamic PSNR | PSNR, {} Adam |\n|---|---|---|---|---|---|---|---|\n",
        record.clip, settings.adam
    );
    for DensityPoint { signal, percent, gaussians, learned, adam } in &record.points {
        // Writing to a String cannot fail.
        let _ = writeln!(
            table,
            "| {} | {percent} | {:.1} | {} | {} | {} | {} | {} |",
            thousands(*gaussians),
            record.percent_of_pixels(*gaussians),
            signal.map_or("–", |signal| signal.name()),
            or_dash(learned.psnr, 2),
            or_dash(learned.ssim, 3),
            or_dash(learned.psnr_dynamic, 2),
            or_dash(adam.and_then(|adam| adam.psnr), 2),
        );
    }
    table + "\n"
}

fn comparison_table(all: &[SignalComparison], clips: usize) -> String {
    let mut table = format!(
        "## All {clips} clips: held-out PSNR after the learned refinement, dB\n\n| decides | % | against | difference | deviation | wins | p (t) |\n|---|---|---|---|---|---|---|\n"
    );
    for SignalComparison { signal, against, percent, paired } in all {
        // Writing to a String cannot fail.
        let _ = writeln!(
            table,
            "| {signal} | {percent} | {} | {:+.3} | {:.3} | {} of {} | {} |",
            against.map_or("all Gaussians", |against| against.name()),
            paired.difference.mean,
            paired.difference.deviation,
            paired.wins,
            paired.difference.count,
            paired.p_t.map_or("–".to_owned(), |p| format!("{p:.1e}")),
        );
    }
    table
}
