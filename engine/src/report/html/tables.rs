//! The page's tables: figures, times, settings.

use lgs_pages::{escape, ranges, thousands};

use super::Page;
use crate::{
    densify::Limit,
    evaluate::ViewFigures,
    pipeline::{NetworkSummary, Stage, UpdateSkipped},
    predict::QuerySkipped,
    recipe::{Recipe, word},
    report::{
        maps::maps_in_words,
        metrics::{Config, FIGURES, FigureKind, Metrics, role_name},
        moving::{MOVING_SPEED, percent},
    },
    views::Role,
};

/// Mean figures by role, and the figures of every view; nothing when there are none.
pub(super) fn figure_table(metrics: &Metrics) -> String {
    let measured = |kind: &&FigureKind| metrics.views.iter().any(|view| (kind.get)(&view.figures).is_some());
    let columns: Vec<&FigureKind> = FIGURES.iter().filter(measured).collect();
    let heads: String = columns.iter().map(|kind| format!("<th>{}</th>", kind.heading())).collect();
    let row = |class: &str, name: &str, figures: &ViewFigures| {
        let cells: String = columns.iter().map(|kind| format!("<td>{}</td>", kind.text(figures))).collect();
        format!("<tr{class}><th>{name}</th>{cells}</tr>\n")
    };
    let mut rows = String::new();
    for (role, mean) in [(Role::HeldOut, &metrics.mean.held_out), (Role::Input, &metrics.mean.input)] {
        let mut views = metrics.views.iter().filter(|view| view.role == role).peekable();
        if views.peek().is_none() {
            continue;
        }
        rows += &row(" class=\"mean\"", &format!("mean, {}", role_name(role)), mean);
        rows.extend(views.map(|v| row("", &format!("frame {} · {}", v.frame, escape(&v.camera)), &v.figures)));
    }
    if columns.is_empty() {
        return String::new();
    }
    format!(
        "<div class=\"wide\"><table>\n<thead><tr><th></th>{heads}</tr></thead>\n<tbody>\n{rows}</tbody></table></div>\n"
    )
}

/// A bar for every stage that ran.
pub(super) fn stage_bars(metrics: &Metrics) -> String {
    let ran = Stage::ALL.into_iter().filter(|&stage| metrics.stages_s.get(stage) > 0.0);
    let longest = Stage::ALL.into_iter().map(|stage| metrics.stages_s.get(stage)).fold(f64::MIN_POSITIVE, f64::max);
    let bar = |stage: Stage| {
        let seconds = metrics.stages_s.get(stage);
        let percent = 100.0 * seconds / longest;
        let name = stage.key().replace('_', " ");
        format!("<dt>{name}</dt><dd><i style=\"width:{percent:.1}%\"></i><span>{seconds:.3} s</span></dd>\n")
    };
    let note =
        format!("reconstruction {:.3} s: from the loaded input views to the finished scene", metrics.reconstruction_s);
    format!("<dl class=\"bars\">\n{}</dl>\n<p>{note}</p>\n", ran.map(bar).collect::<String>())
}

/// Everything that decided the result, and the command.
pub(super) fn settings(page: &Page<'_>) -> String {
    let Metrics { config, gaussians, threads, seed, weights, network, .. } = page.metrics;
    let moment = config.at_time.map_or("each view's own".to_owned(), |s| format!("{s} s after time zero"));
    let none = || "none".to_owned();
    let rows = [
        ("cameras", escape(&config.cameras.join(", "))),
        ("image size", config.image_size.map_or("each image's own".to_owned(), |[h, w]| format!("{h}x{w}"))),
        ("frames", ranges(&config.frames)),
        ("held out", if config.hold_out.is_empty() { none() } else { ranges(&config.hold_out) }),
        ("background", word(&config.recipe.background)),
        ("depth maps", depth_maps(page.metrics)),
        ("initial velocities", word(&config.motion)),
        ("views", escape(&config.views)),
        ("moment", moment),
        ("weights", weights.clone().unwrap_or_else(none)),
        ("network", network.as_ref().map_or_else(none, |summary| network_settings(config, summary))),
        ("refined by", refined_by(&config.recipe).unwrap_or_else(none)),
        ("LPIPS weights", config.lpips_weights.clone().unwrap_or_else(none)),
        ("threads", threads.to_string()),
        ("seed", seed.to_string()),
        ("Gaussians at first", thousands(gaussians.initial)),
        ("pruned, added", format!("{}, {}", thousands(gaussians.pruned), thousands(gaussians.added))),
        ("Gaussians in the end", thousands(gaussians.last)),
        ("background Gaussians", thousands(gaussians.background)),
        ("moving Gaussians", moving(page.metrics)),
    ];
    let rows: String = rows.iter().map(|(name, value)| format!("<dt>{name}</dt><dd>{value}</dd>\n")).collect();
    format!("<dl class=\"settings\">\n{rows}</dl>\n<pre>{}</pre>\n", escape(page.command))
}

/// Which shares of both branches move.
fn moving(metrics: &Metrics) -> String {
    let [lidar, background] = [metrics.moving.lidar, metrics.moving.background].map(percent);
    format!("{lidar} of those from LiDAR, {background} of the background: faster than {MOVING_SPEED} m/s")
}

/// How well the clip's depth maps fit its sweeps.
fn depth_maps(metrics: &Metrics) -> String {
    maps_in_words(&metrics.depth_maps).map_or("none".to_owned(), |words| escape(&words))
}

/// Who refined: `None` for nobody.
fn refined_by(recipe: &Recipe) -> Option<String> {
    match recipe.adam_passes {
        0 => recipe.network.then(|| "learned".to_owned()),
        passes => Some(format!("adam:{passes}")),
    }
}

fn limit_text(limit: Limit) -> String {
    match limit {
        Limit::Count(count) => thousands(count),
        Limit::Percent(_) => limit.to_string(),
    }
}

/// What the network was asked for and what it left out, as one line.
fn network_settings(config: &Config, summary: &NetworkSummary) -> String {
    let query = match summary.query_skipped {
        None => "query".to_owned(),
        Some(QuerySkipped::Off) => "no query".to_owned(),
        Some(QuerySkipped::NotInModel) => "no query in the model".to_owned(),
        Some(QuerySkipped::SingleTimestamp) => "no query: a single timestamp".to_owned(),
    };
    let recipe = &config.recipe;
    let density = match summary.set_update_skipped {
        None => {
            let budget = recipe.max_gaussians.map_or(String::new(), |limit| format!(", at most {}", limit_text(limit)));
            format!(
                "density {} ({}, {}{budget})",
                word(&recipe.density),
                recipe.thresholds.prune,
                recipe.thresholds.add
            )
        }
        Some(UpdateSkipped::NotInModel) => "no policy in the model".to_owned(),
        Some(UpdateSkipped::Off) => "density off".to_owned(),
    };
    let stop = if summary.refine.stopped_early { ", stopped early" } else { "" };
    let steps = recipe.refine_steps;
    format!("{query}; {density}; {} of {steps} refinement steps{stop}", summary.refine.steps)
}
