//! The page at the end of a job: what was done, what failed, how deltas and targets are spread.

use std::fmt::Write;
use std::path::Path;

use lgs_engine::report::escape;
use lgs_formats::error::Result;
use lgs_formats::targets::{ActionTargets, Manifest, Shard};
use serde::Serialize;

use crate::generate::Seconds;
use crate::picture::{Axis, histogram, number};

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

/// The page.
pub fn html(summary: &Summary, manifest: &Manifest, seconds: &Seconds, passes: usize) -> String {
    let mut page = String::from(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<title>LGS targets</title>\n<style>\n\
         body{font:15px/1.5 sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#222}\n\
         td,th{padding:.15rem .8rem;text-align:right;border-bottom:1px solid #ddd}th:first-child,td:first-child{text-align:left}\n\
         figure{display:inline-block;margin:.3rem}pre{white-space:pre-wrap;background:#f5f5f5;padding:.6rem}\n\
         </style>\n</head>\n<body>\n<h1>LGS targets</h1>\n",
    );
    let share = |count: u64, of: u64| {
        if of == 0 { "–".to_owned() } else { format!("{:.2} %", 100.0 * count as f64 / of as f64) }
    };
    let mut put = |text: String| {
        // writing to a String cannot fail
        let _ = writeln!(page, "{text}");
    };
    let part = manifest.part.map_or(String::new(), |part| format!(", part {} of {}", part.index, part.count));
    put(format!(
        "<p>{} clips with targets, {} failed{part}; {} primitives, {} of them sampled.</p>",
        summary.clips,
        manifest.failed.len(),
        summary.primitives,
        share(summary.sampled, summary.primitives)
    ));
    put("<h2>Targets</h2>\n<table>\n<tr><th>action</th><th>valid</th>".to_owned());
    put(THRESHOLDS.iter().map(|t| format!("<th>y &gt; {t}</th>")).collect::<String>() + "</tr>");
    for (name, action) in [("prune", &summary.prune), ("add", &summary.add)] {
        let above: String = action.above.iter().map(|&n| format!("<td>{}</td>", share(n, action.valid))).collect();
        put(format!("<tr><td>{name}</td><td>{}</td>{above}</tr>", share(action.valid, summary.sampled)));
    }
    put("</table>".to_owned());
    let (range, unit) = (summary.delta_range, Axis { name: "target y", low: 0.0, high: 1.0 });
    let axis = Axis { name: "delta (negative: helps)", low: -range, high: range };
    for (name, action) in [("prune", &summary.prune), ("add", &summary.add)] {
        let pictures = [
            histogram(&format!("{name}: deltas"), &axis, &action.delta_bars),
            histogram(&format!("{name}: targets"), &unit, &action.target_bars),
        ];
        put(pictures.map(|svg| format!("<figure>{svg}</figure>")).concat());
    }
    if passes > 0 {
        put("<h2>Time of this run</h2>\n<table>\n<tr><th>stage</th><th>seconds</th><th>share</th></tr>".to_owned());
        for (name, spent) in seconds.by_stage() {
            let percent = 100.0 * spent / seconds.total().max(f64::MIN_POSITIVE);
            put(format!("<tr><td>{name}</td><td>{spent:.2}</td><td>{percent:.1} %</td></tr>"));
        }
        let per_pass = number(seconds.render / passes as f64);
        put(format!("</table>\n<p>{passes} rendering passes, {per_pass} s each.</p>"));
    }
    if !manifest.failed.is_empty() {
        put("<h2>Failed</h2>\n<table>\n<tr><th>clip</th><th>reason</th></tr>".to_owned());
        for failed in &manifest.failed {
            put(format!("<tr><td>{}</td><td>{}</td></tr>", escape(&failed.clip), escape(&failed.reason)));
        }
        put("</table>".to_owned());
    }
    let settings = serde_json::to_string_pretty(&manifest.config).unwrap_or_default();
    put(format!("<h2>Settings</h2>\n<pre>{}</pre>\n</body>\n</html>", escape(&settings)));
    page
}
