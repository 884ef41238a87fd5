//! `report.html`: one file that shows a run, without anything from elsewhere.

mod tables;
#[cfg(test)]
mod tests;
mod views;

use lgs_pages::{count, document, escape, thousands};

use super::{
    metrics::{FIGURES, Metrics, NUM_FULL_IMAGE},
    pictures::PictureKind,
};
use crate::views::Role;
use tables::{figure_table, settings, stage_bars};
use views::{legend, views_of};

const STYLE: &str = include_str!("style.css");

/// What the page shows.
#[derive(Clone, Copy, Debug)]
pub struct Page<'a> {
    /// The figures.
    pub metrics: &'a Metrics,
    /// The pictures of each of the metrics' views, in the same order.
    pub views: &'a [PageView],
    /// Where the clip comes from.
    pub source: &'a str,
    /// Terms under which the clip may be used.
    pub licence: &'a str,
    /// The command that made the run.
    pub command: &'a str,
    /// What the run found in the clip, each as `what: words`.
    pub notes: &'a [String],
}

/// The pictures of a view.
#[derive(Clone, Debug)]
pub struct PageView {
    /// Width and height of the pictures, pixels.
    pub size: [u32; 2],
    /// What each shows, and the bytes of a JPEG file.
    pub pictures: Vec<(PictureKind, Vec<u8>)>,
}

/// The page.
pub fn html(page: &Page<'_>) -> String {
    let metrics = page.metrics;
    let title = format!("{} – LGS reconstruction", escape(&metrics.clip));
    let (held_out, input) = (views_of(page, Role::HeldOut), views_of(page, Role::Input));
    let mut body = header(page) + &cards(metrics);
    if !page.views.is_empty() {
        body += &legend(page);
    }
    body += &section("Held-out views", "The reconstruction saw neither these images nor their sweeps.", &held_out);
    if held_out.is_empty() {
        body += &section("Input views", INPUT_NOTE, &input);
    } else {
        body += &folded("Input views", INPUT_NOTE, &input);
    }
    body += &section("Figures", figures_note(metrics), &figure_table(metrics));
    body += &section(
        "Found in the clip",
        "What differs from what the clip states, and what was made use of.",
        &found(page.notes),
    );
    body += &section("Time", "", &stage_bars(metrics));
    body += &section("Scene and settings", "", &settings(page));
    document(&title, STYLE, &body, "")
}

const INPUT_NOTE: &str = "The reconstruction was made from these images and sweeps.";

fn header(page: &Page<'_>) -> String {
    let Metrics { clip, config, gaussians, .. } = page.metrics;
    let size = config.image_size.map_or("images at their own size".to_owned(), |[h, w]| format!("{h} × {w} pixels"));
    let facts = [
        count(config.frames.len(), "frame"),
        format!("{} held out", config.hold_out.len()),
        count(config.cameras.len(), "camera"),
        size,
        format!("{} Gaussians", thousands(gaussians.last + gaussians.background)),
    ];
    format!(
        "<header>\n<p class=\"brand\">LGS reconstruction</p>\n<h1>{}</h1>\n<p class=\"facts\">{}</p>\n\
         <p class=\"origin\">{} · {}</p>\n</header>\n",
        escape(clip),
        facts.map(|fact| format!("<span>{fact}</span>")).join(" · "),
        escape(page.source),
        escape(page.licence)
    )
}

/// The few numbers that a reader looks for first.
fn cards(metrics: &Metrics) -> String {
    let held_out = metrics.views.iter().any(|view| view.role == Role::HeldOut);
    let (figures, whose) =
        if held_out { (&metrics.mean.held_out, "held-out mean") } else { (&metrics.mean.input, "input mean") };
    let defined = FIGURES.iter().take(NUM_FULL_IMAGE).filter(|kind| (kind.get)(figures).is_some());
    let mut cards: Vec<[String; 3]> =
        defined.map(|kind| [kind.heading(), kind.text(figures), whose.to_owned()]).collect();
    let (total, memory) = (metrics.gaussians.last + metrics.gaussians.background, metrics.peak_rss_mb);
    cards.push(["Reconstruction".into(), format!("{:.2} s", metrics.reconstruction_s), "after loading".into()]);
    cards.push([
        "Gaussians".into(),
        thousands(total),
        format!("{} background", thousands(metrics.gaussians.background)),
    ]);
    cards.extend(memory.map(|mb| ["Peak memory".into(), format!("{mb:.0} MB"), count(metrics.threads, "thread")]));
    let cell = |[label, value, note]: &[String; 3]| {
        format!("<div><span>{label}</span><strong>{value}</strong><small>{note}</small></div>\n")
    };
    format!("<div class=\"cards\">\n{}</div>\n", cards.iter().map(cell).collect::<String>())
}

/// A list of what was found, what it is about first.
fn found(notes: &[String]) -> String {
    if notes.is_empty() {
        return String::new();
    }
    let item = |note: &String| match note.split_once(": ") {
        Some((about, words)) => format!("<li><b>{}</b>: {}</li>\n", escape(about), escape(words)),
        None => format!("<li>{}</li>\n", escape(note)),
    };
    format!("<ul class=\"found\">\n{}</ul>\n", notes.iter().map(item).collect::<String>())
}

/// What the figures alone do not say.
fn figures_note(metrics: &Metrics) -> &'static str {
    let copies = metrics.views.iter().any(|view| view.figures.psnr_copying.is_some());
    if copies { "Copying: PSNR of the nearest input image of the same camera in place of what was drawn." } else { "" }
}

fn section(title: &str, note: &str, content: &str) -> String {
    if content.is_empty() {
        return String::new();
    }
    format!("<section>\n<h2>{title}</h2>\n{}{content}</section>\n", paragraph(note))
}

fn folded(title: &str, note: &str, content: &str) -> String {
    if content.is_empty() {
        return String::new();
    }
    format!(
        "<section><details>\n<summary><h2>{title}</h2></summary>\n{}{content}</details></section>\n",
        paragraph(note)
    )
}

fn paragraph(note: &str) -> String {
    if note.is_empty() { String::new() } else { format!("<p>{note}</p>\n") }
}
