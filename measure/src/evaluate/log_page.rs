//! A log as a page that plays the scenes of its snippets one after the other, each in its own page below.

use lgs_pages::{document, escape};

use super::{
    findings::{Findings, Found},
    scene_page::VIEWER,
};

const STYLE: &str = include_str!("log_page.css");
const SCRIPT: &str = include_str!("log_page.js");
/// The file of a log's page.
pub fn log_file(log: &str) -> String {
    format!("play-{log}.html")
}

/// The page of a log.
pub fn log_page(findings: &Findings, log: &str) -> String {
    let own = || findings.snippets.iter().filter(|found| found.record.log == log);
    let button = |found: &Found| {
        let frames = [&found.record.inputs, &found.record.targets].map(|frames| frames.iter().copied());
        let [first, last] = frames.into_iter().flatten().fold([usize::MAX, 0], |[a, b], f| [a.min(f), b.max(f)]);
        let psnr = found.record.runs.last().and_then(|run| run.mean().get("psnr"));
        let psnr = psnr.map_or(String::new(), |psnr| format!("<small>{psnr:.2} dB</small>"));
        format!("<button data-page=\"items/{}/{VIEWER}\">frames {first} to {last}{psnr}</button>\n", found.item)
    };
    let title = escape(log);
    let buttons: String = own().map(button).collect();
    let body = format!(
        "<header>\n<p class=\"brand\">LGS evaluation</p>\n<h1>{title}</h1>\n\
         <p>The scenes of a log, a snippet after the other. A snippet's page opens by itself, too.</p>\n</header>\n\
         <nav><button id=\"all\">Play all</button>\n{buttons}</nav>\n<iframe id=\"scene\" title=\"scene\"></iframe>\n"
    );
    document(&title, STYLE, &body, SCRIPT)
}
