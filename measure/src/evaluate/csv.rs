//! Tables for programs: every view, every snippet, and what each took.

use lgs_pages::csv;

use super::{
    figures::{Figures, kinds},
    findings::{Findings, Found},
    record::RunRecord,
};

fn head(before: &[&'static str]) -> Vec<&'static str> {
    before.iter().copied().chain(kinds().map(|kind| kind.key)).collect()
}

fn exact(figures: &Figures) -> impl Iterator<Item = String> {
    kinds().map(|kind| figures.exact(&kind)).into_iter()
}

fn runs(findings: &Findings) -> impl Iterator<Item = (&Found, &RunRecord)> {
    findings.snippets.iter().flat_map(|found| found.record.runs.iter().map(move |run| (found, run)))
}

/// A line for each view of each recipe.
pub fn views(findings: &Findings) -> String {
    let rows = runs(findings).flat_map(|(found, run)| {
        run.views.iter().map(move |view| {
            let named = [&found.record.log, &found.item, &run.recipe].map(String::clone);
            named.into_iter().chain([view.frame.to_string(), view.camera.clone()]).chain(exact(&view.figures)).collect()
        })
    });
    csv::<_, String>(&head(&["log", "snippet", "recipe", "frame", "camera"]), rows)
}

/// A line for each snippet of each recipe.
pub fn snippets(findings: &Findings) -> String {
    let list = |frames: &[usize]| frames.iter().map(usize::to_string).collect::<Vec<_>>().join(" ");
    let rows = runs(findings).map(|(found, run)| {
        let named = [&found.record.log, &found.item, &run.recipe].map(String::clone);
        let frames = [list(&found.record.inputs), list(&found.record.targets)];
        let gaussians = (run.gaussians.last + run.gaussians.background).to_string();
        named.into_iter().chain(frames).chain([gaussians]).chain(exact(&run.mean())).collect()
    });
    csv::<_, String>(&head(&["log", "snippet", "recipe", "inputs", "targets", "gaussians"]), rows)
}

/// A line for each snippet of each recipe: what it took.
pub fn times(findings: &Findings) -> String {
    let rows =
        findings.snippets.iter().filter_map(|found| Some((found, found.times.as_ref()?))).flat_map(|(found, times)| {
            found.record.runs.iter().zip(&times.reconstruction_s).enumerate().map(move |(index, (run, seconds))| {
                let memory = times.peak_rss_mb.map_or(String::new(), |mb| mb.to_string());
                let numbers = [times.load_s, *seconds, times.evaluate_s].map(|number| number.to_string());
                let named = [&found.item, &run.recipe].map(String::clone);
                let drawn_on = times.drawn_on.get(index).map_or(String::new(), |drawn_on| drawn_on.device.clone());
                named.into_iter().chain(numbers).chain([memory, times.threads.to_string(), drawn_on]).collect()
            })
        });
    let head = ["snippet", "recipe", "load_s", "reconstruction_s", "evaluate_s", "peak_rss_mb", "threads", "drawn_on"];
    csv::<_, String>(&head, rows)
}
