//! What a run prints for people.

use std::{fmt::Write, path::Path};

use lgs_engine::{
    photometry::CommonColours,
    pipeline::Stage,
    report::{BudgetRecord, FIGURES, Metrics, NUM_FULL_IMAGE, maps_in_words, percent, role_name},
    views::Role,
};

use crate::film::Film;

/// What the run found in the clip that its user should know, a line each.
pub(crate) fn notes(metrics: &Metrics, colours: &CommonColours) -> Vec<String> {
    let maps = maps_in_words(&metrics.depth_maps).map(|words| format!("depth maps: {words}"));
    let turn = metrics.lidar_turn.map(|turn| format!("sweeps: {}", turn.in_words()));
    let stamp = metrics.lidar_stamp.map(|stamp| format!("sweeps: {}", stamp.in_words()));
    let dropped = metrics.dropped_returns.and_then(|dropped| dropped.in_words());
    let dropped = dropped.map(|words| format!("returns: {words}"));
    let lenses = metrics.lenses.as_ref().map(|found| format!("lenses: {}", found.in_words()));
    let calibration = metrics.calibration.iter().flatten().map(|found| format!("calibration: {}", found.in_words()));
    let mounts = metrics.mounts.as_ref().map(|found| format!("mounts: {}", found.in_words()));
    let colours = colours.in_words().map(|words| format!("cameras: {words}"));
    let refused = metrics.drawn_on.refused.iter().map(|reason| format!("device: drawn by the CPU, since {reason}"));
    let clip = maps.into_iter().chain(turn).chain(stamp).chain(dropped).chain(lenses).chain(calibration).chain(mounts);
    clip.chain(colours).chain(refused).collect()
}

/// A page of text: mean figures, counts, times and where the files are.
pub(crate) fn summary(metrics: &Metrics, total_s: f64, out: &Path, film: Option<&Film>) -> String {
    let mut text = format!("{}\n", metrics.clip);
    let measured = metrics.config.at_time.is_none();
    for (role, mean) in [(Role::HeldOut, &metrics.mean.held_out), (Role::Input, &metrics.mean.input)] {
        let num_views = metrics.views.iter().filter(|view| view.role == role).count();
        if num_views > 0 && measured {
            let (full, by_motion) = FIGURES.split_at(NUM_FULL_IMAGE);
            for (name, kinds) in [(format!("{}, {num_views} views", role_name(role)), full), (String::new(), by_motion)]
            {
                let defined = kinds.iter().filter(|kind| (kind.get)(mean).is_some());
                let figures: Vec<String> = defined.map(|kind| format!("{} {}", kind.label, kind.text(mean))).collect();
                if !figures.is_empty() {
                    line(&mut text, &name, &figures.join("  "));
                }
            }
        }
    }
    let counts = metrics.gaussians;
    line(
        &mut text,
        "Gaussians",
        &format!(
            "{} from LiDAR - {} pruned + {} added = {}, and {} background",
            counts.initial, counts.pruned, counts.added, counts.last, counts.background
        ),
    );
    let [lidar, background] = [metrics.moving.lidar, metrics.moving.background].map(percent);
    line(&mut text, "of them moving", &format!("{lidar} of those from LiDAR, {background} of the background"));
    if let Some(BudgetRecord { budget_s, chosen, finished_s, .. }) = &metrics.budget {
        let verdict = if chosen.fits { "" } else { "; nothing that is recorded fits, so the quickest ran" };
        line(&mut text, "time budget", &format!("{budget_s} s, scene finished after {finished_s:.2} s{verdict}"));
        line(&mut text, "", &chosen.recipe.flags());
        let gives_up = format!("gives up about {:.2} dB against the best, which takes", chosen.gives_up_db);
        line(&mut text, "", &format!("{gives_up} {:.1} s more", (chosen.best_s - chosen.expected_s).max(0.0)));
    }
    let stages = Stage::ALL.into_iter().filter(|&stage| metrics.stages_s.get(stage) > 0.0);
    let times: Vec<String> = stages.map(|s| format!("{} {:.2}", s.key(), metrics.stages_s.get(s))).collect();
    line(&mut text, "seconds", &format!("{total_s:.2} in all, reconstruction {:.2}", metrics.reconstruction_s));
    line(&mut text, "", &times.join("  "));
    let memory = metrics.peak_rss_mb.map_or("unknown".to_owned(), |mb| format!("{mb:.0} MB"));
    line(&mut text, "peak memory", &format!("{memory}, {} threads", metrics.threads));
    line(&mut text, "drawn on", &metrics.drawn_on.device);
    line(&mut text, "written to", &out.display().to_string());
    if let Some(film) = film {
        line(&mut text, "film", &format!("{} pictures, {}", film.len(), out.join("path.png").display()));
    }
    line(&mut text, "to look at", &out.join("report.html").display().to_string());
    text
}

fn line(text: &mut String, name: &str, value: &str) {
    // writing to a String cannot fail
    let _ = writeln!(text, "  {name:<18} {value}");
}
