//! `report.html`: one file that shows what was measured, without anything from elsewhere.

mod budgets;
mod crops;
mod plot;
mod plots;
mod rows;

use std::path::Path;

use lgs_pages::{document, escape};

use crate::{error::Result, machine::Machine};

use super::{
    budget::BudgetRow,
    record::{Failed, SweepRecord},
    table::PointRow,
};
use budgets::budget_table;
use crops::crops;
use plots::plots;
use rows::{best, row_table};

/// What the pages of this crate share.
pub(crate) const STYLE: &str = include_str!("style.css");
const SCRIPT: &str = include_str!("script.js");

/// A clip.
#[derive(Clone, Copy, Debug)]
pub struct Chapter<'a> {
    /// What was found on it.
    pub record: &'a SweepRecord,
    /// The same as rows.
    pub rows: &'a [PointRow],
    /// Of each row, the command that runs it.
    pub commands: &'a [String],
    /// What came of time budgets.
    pub budgets: &'a [BudgetRow],
}

/// What the page shows.
#[derive(Clone, Copy, Debug)]
pub struct Page<'a> {
    /// What measured.
    pub machine: &'a Machine,
    /// The clips.
    pub chapters: &'a [Chapter<'a>],
    /// The means over the clips; empty for a single one.
    pub mean: &'a [PointRow],
    /// Directory of the results.
    pub out: &'a Path,
    /// What could not be measured.
    pub failed: &'a [Failed],
}

/// The page.
///
/// # Errors
/// When a crop cannot be read.
pub fn html(page: &Page<'_>) -> Result<String> {
    let mut body = header(page);
    if !page.mean.is_empty() {
        body +=
            &section("Mean over the clips", "", &(plots(page.mean) + &best(page.mean) + &row_table(page.mean, &[])));
    }
    for chapter in page.chapters {
        let work = &chapter.record.work;
        let note = format!(
            "{} input views of {} moments, {:.2} megapixels in all; {} held-out views",
            work.input_views,
            work.input_frames,
            work.input_pixels as f64 / 1e6,
            work.held_out_views
        );
        let content = plots(chapter.rows)
            + &best(chapter.rows)
            + &crops(chapter, page.out)?
            + &row_table(chapter.rows, chapter.commands)
            + &budget_table(chapter.budgets);
        body += &section(&chapter.record.clip, &note, &content);
    }
    if !page.failed.is_empty() {
        let line = |failed: &Failed| {
            let Failed { clip, name, reason } = failed;
            format!("<li>{}, {}: {}</li>\n", escape(clip), escape(name), escape(reason))
        };
        let lines: String = page.failed.iter().map(line).collect();
        body += &section("Could not be measured", "", &format!("<ul>\n{lines}</ul>\n"));
    }
    Ok(document("Speed and accuracy – LGS", STYLE, &body, SCRIPT))
}

fn header(page: &Page<'_>) -> String {
    let Machine { version, build, target, cpu, cores, threads, .. } = page.machine;
    let cpu = cpu.as_deref().unwrap_or("a processor without a name");
    let repeats = page.chapters.iter().flat_map(|chapter| chapter.rows).map(|row| row.repeats).min().unwrap_or(0);
    format!(
        "<header>\n<p class=\"brand\">LGS sweep</p>\n<h1>Speed and accuracy</h1>\n<p>{}, {threads} of {cores} cores, {} · version \
         {} ({})</p>\n<p>Times: median of at least {repeats} runs in turns, with quartiles, from loaded images to the finished scene. \
         Figures: means over the held-out views, and memory, from a run of the same configuration in a process of its own. Blue: \
         nothing is both faster and better. Orange: per-scene optimisation (Adam) from the initial Gaussians, with its number of \
         steps, hollow where something beats it. Point at one to find it everywhere.</p>\n</header>\n",
        escape(cpu),
        escape(target),
        escape(version),
        escape(build)
    )
}

fn section(title: &str, note: &str, content: &str) -> String {
    format!("<section>\n<h2>{}</h2>\n<p>{}</p>\n{content}</section>\n", escape(title), escape(note))
}
