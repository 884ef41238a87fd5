//! The page at the end of a job: what was done, what failed, how deltas and targets are spread.

use std::path::Path;

use lgs_formats::error::Result;
use lgs_formats::targets::{ActionTargets, FailedClip, Manifest, Shard};
use lgs_pages::{Range, document, escape, histogram, number, section, table};
use serde::Serialize;

use crate::generate::Seconds;

/// Bars of a histogram.
const BARS: usize = 60;
/// Thresholds whose shares the report tells.
pub const THRESHOLDS: [f32; 4] = [0.5, 0.6, 0.7, 0.8];

/// What the targets of one action look like.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ActionSummary {
    /// Targets that the masks admit.
    pub valid: u64,
    /// How many of them are above each of [`THRESHOLDS`].
    pub above: [u64; THRESHOLDS.len()],
    /// Counts of deltas over equal parts of the range.
    #[serde(skip)]
    pub delta_bars: Vec<u64>,
    /// Counts of targets over equal parts of 0..=1.
    #[serde(skip)]
    pub target_bars: Vec<u64>,
}

/// What a folder of shards holds.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Summary {
    /// Clips with targets.
    pub clips: u64,
    /// Primitives of the `LiDAR` branches.
    pub primitives: u64,
    /// Sampled primitives.
    pub sampled: u64,
    /// Of taking primitives out.
    pub prune: ActionSummary,
    /// Of copies.
    pub add: ActionSummary,
    /// End of the deltas' histogram: the largest 99 % quantile of a clip's absolute deltas; what is beyond stands in the outermost bars.
    #[serde(skip)]
    pub delta_range: f64,
}

/// What the shards of a manifest in `folder` hold.
///
/// # Errors
/// A shard that is not as the format asks.
pub fn summarise(folder: &Path, manifest: &Manifest) -> Result<Summary> {
    let mut summary = Summary::default();
    each_clip(folder, manifest, &mut |prune, add, _| {
        for action in [prune, add] {
            let mut sizes: Vec<f32> = valid(action).map(|(_, delta)| delta.abs()).collect();
            sizes.sort_by(f32::total_cmp);
            let quantile = sizes.get(sizes.len() * 99 / 100).map_or(0.0, |&size| f64::from(size));
            summary.delta_range = summary.delta_range.max(quantile);
        }
    })?;
    let range = summary.delta_range;
    let empty = || ActionSummary { delta_bars: vec![0; BARS], target_bars: vec![0; BARS], ..ActionSummary::default() };
    let mut actions = [empty(), empty()];
    each_clip(folder, manifest, &mut |prune, add, [primitives, sampled]| {
        summary.clips += 1;
        summary.primitives += primitives;
        summary.sampled += sampled;
        for (summary, action) in actions.iter_mut().zip([prune, add]) {
            for (y, delta) in valid(action) {
                summary.valid += 1;
                summary.above.iter_mut().zip(THRESHOLDS).for_each(|(count, t)| *count += u64::from(y > t));
                let place = if range > 0.0 { (f64::from(delta) / range + 1.0) / 2.0 } else { 0.5 };
                summary.delta_bars[bar(place)] += 1;
                summary.target_bars[bar(f64::from(y))] += 1;
            }
        }
    })?;
    [summary.prune, summary.add] = actions;
    Ok(summary)
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the bars before the cast")]
fn bar(place: f64) -> usize {
    (place * BARS as f64).clamp(0.0, BARS as f64 - 1.0) as usize
}

fn valid(action: &ActionTargets) -> impl Iterator<Item = (f32, f32)> + '_ {
    let rows = action.y.iter().zip(&action.delta).zip(&action.mask);
    rows.filter(|(_, set)| **set).map(|((&y, &delta), _)| (y, delta))
}

fn each_clip(
    folder: &Path,
    manifest: &Manifest,
    see: &mut dyn FnMut(&ActionTargets, &ActionTargets, [u64; 2]),
) -> Result<()> {
    for record in &manifest.shards {
        let shard = Shard::read(&folder.join(&record.file))?;
        for name in shard.names() {
            let clip = shard.clip(name)?;
            see(&clip.prune, &clip.add, [clip.gaussians.len() as u64, clip.index.len() as u64]);
        }
    }
    Ok(())
}

const STYLE: &str = "figure{display:inline-block;margin:.3rem}figure svg{max-width:100%;height:auto}\n\
    pre{white-space:pre-wrap;overflow-wrap:anywhere}td{text-align:left}\n";

/// The page.
pub fn html(summary: &Summary, manifest: &Manifest, seconds: &Seconds, passes: usize) -> String {
    let part = manifest.part.map_or(String::new(), |part| format!(", part {} of {}", part.index, part.count));
    let mut body = format!(
        "<header>\n<p class=\"brand\">LGS targets</p>\n<h1>Targets</h1>\n<p>{} clips with targets, {} failed{part}; {} primitives, {} \
         of them sampled.</p>\n</header>\n",
        summary.clips,
        manifest.failed.len(),
        summary.primitives,
        share(summary.sampled, summary.primitives)
    );
    body += &section("Targets", &(shares(summary) + &histograms(summary)));
    if passes > 0 {
        body += &section("Time of this run", &times(seconds, passes));
    }
    if !manifest.failed.is_empty() {
        let row = |failed: &FailedClip| {
            format!("<tr><th>{}</th><td>{}</td></tr>\n", escape(&failed.clip), escape(&failed.reason))
        };
        body += &section("Failed", &table(&["clip", "reason"], &manifest.failed.iter().map(row).collect::<String>()));
    }
    let settings = serde_json::to_string_pretty(&manifest.config).unwrap_or_default();
    body += &section("Settings", &format!("<pre>{}</pre>\n", escape(&settings)));
    document("LGS targets", STYLE, &body, "")
}

fn share(count: u64, of: u64) -> String {
    if of == 0 { "–".to_owned() } else { format!("{:.2} %", 100.0 * count as f64 / of as f64) }
}

/// How many targets are valid, and above each threshold.
fn shares(summary: &Summary) -> String {
    let names = THRESHOLDS.map(|t| format!("y &gt; {t}"));
    let head: Vec<&str> = ["action", "valid"].into_iter().chain(names.iter().map(String::as_str)).collect();
    let row = |(name, action): (&str, &ActionSummary)| {
        let above: String = action.above.iter().map(|&n| format!("<td>{}</td>", share(n, action.valid))).collect();
        format!("<tr><th>{name}</th><td>{}</td>{above}</tr>\n", share(action.valid, summary.sampled))
    };
    table(&head, &[("prune", &summary.prune), ("add", &summary.add)].map(row).concat())
}

/// How deltas and targets are spread.
fn histograms(summary: &Summary) -> String {
    let range = summary.delta_range;
    let unit = Range { name: "target y", low: 0.0, high: 1.0 };
    let axis = Range { name: "delta (negative: helps)", low: -range, high: range };
    let pictures = [("prune", &summary.prune), ("add", &summary.add)].map(|(name, action)| {
        [
            histogram(&format!("{name}: deltas"), &axis, "primitives", &action.delta_bars),
            histogram(&format!("{name}: targets"), &unit, "primitives", &action.target_bars),
        ]
    });
    pictures.as_flattened().iter().map(|svg| format!("<figure>{svg}</figure>\n")).collect()
}

fn times(seconds: &Seconds, passes: usize) -> String {
    let total = seconds.total().max(f64::MIN_POSITIVE);
    let row = |(name, spent): (&str, f64)| {
        format!("<tr><th>{name}</th><td>{spent:.2}</td><td>{:.1} %</td></tr>\n", 100.0 * spent / total)
    };
    let rows: String = seconds.by_stage().into_iter().map(row).collect();
    let per_pass = number(seconds.render / passes as f64);
    table(&["stage", "seconds", "share"], &rows) + &format!("<p>{passes} rendering passes, {per_pass} s each.</p>\n")
}
