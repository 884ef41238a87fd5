//! What an evaluation leaves beside its snippets: `evaluation.json`, tables, times, the page, and a page for each log that plays.

use std::path::Path;

use lgs_engine::report::PictureKind;
use lgs_formats::{error::FormatError, write::write_atomic};
use serde_json::{Value, json};

use super::{
    averages::Averages,
    csv,
    findings::{Findings, Found},
    log_page::{log_file, log_page},
    page::{Pictures, html},
    paper::paper_table,
    snippet::picture_file,
};
use crate::{error::Result, records};

/// The pictures of a snippet's view.
const PICTURES: [PictureKind; 3] = [PictureKind::Truth, PictureKind::Render, PictureKind::Error];

/// The figures as a page of JSON: the same bytes for the same snippets.
///
/// # Errors
/// A value that JSON cannot hold.
pub fn figures_json(findings: &Findings) -> Result<String> {
    records::json("evaluation.json", &figures(findings))
}

/// Figures and times as a page of JSON.
///
/// # Errors
/// A value that JSON cannot hold.
pub fn summary_json(findings: &Findings) -> Result<String> {
    let mut page = figures(findings);
    page["seconds"] = seconds(findings);
    records::json("evaluation.json", &page)
}

fn figures(findings: &Findings) -> Value {
    let of_log = |log: Option<&str>| -> Vec<Value> {
        let recipes = findings.key.recipes.iter().enumerate();
        let of_recipe = |(index, recipe): (usize, &super::findings::RecordedRecipe)| {
            let Averages { image, snippet, log, images } = findings.averages(index, log);
            json!({ "recipe": recipe.name, "image": image, "snippet": snippet, "log": log, "images": images })
        };
        recipes.map(of_recipe).collect()
    };
    let snippet = |found: &Found| {
        let runs = found.record.runs.iter().map(|run| json!({ "recipe": run.recipe, "mean": run.mean() }));
        json!({
            "snippet": found.item,
            "log": found.record.log,
            "inputs": found.record.inputs,
            "targets": found.record.targets,
            "runs": runs.collect::<Vec<_>>(),
        })
    };
    json!({
        "key": findings.key,
        "counts": {
            "logs": findings.logs().len(),
            "snippets": findings.snippets.len(),
            "images": findings.num_images(),
            "failed": findings.failed.len(),
        },
        "means": of_log(None),
        "logs": findings.logs().iter().map(|log| json!({ "log": log, "means": of_log(Some(log)) })).collect::<Vec<_>>(),
        "snippets": findings.snippets.iter().map(snippet).collect::<Vec<_>>(),
        "paper": paper_table(findings.protocol()),
        "papers_data": findings.is_of_the_papers_data(),
        "failed": findings.failed,
    })
}

fn seconds(findings: &Findings) -> Value {
    let recipes = findings.key.recipes.iter().enumerate();
    recipes
        .map(|(index, recipe)| json!({ "recipe": recipe.name, "reconstruction_s": findings.seconds(index) }))
        .collect()
}

/// Writes the files into the folder of the whole job, which has the snippets.
///
/// # Errors
/// A picture that cannot be read, and a folder that cannot be written to.
pub fn write(out: &Path, findings: &Findings) -> Result<()> {
    let put = |name: &str, text: &str| write_atomic(&out.join(name), text.as_bytes());
    put("views.csv", &csv::views(findings))?;
    put("snippets.csv", &csv::snippets(findings))?;
    put("times.csv", &csv::times(findings))?;
    if findings.key.viewer {
        for log in findings.logs() {
            put(&log_file(log), &log_page(findings, log))?;
        }
    }
    put("report.html", &html(findings, &|found| pictures(out, found))?)?;
    put("evaluation.json", &figures_json(findings)?)?;
    Ok(())
}

fn pictures(out: &Path, found: &Found) -> Result<Pictures> {
    if found.record.shown.is_none() {
        return Ok(Vec::new());
    }
    let read = |kind: PictureKind| {
        let path = out.join("items").join(&found.item).join(picture_file(kind));
        let bytes = std::fs::read(&path).map_err(|e| FormatError::io(&path, "read", e))?;
        Ok((kind, bytes))
    };
    PICTURES.into_iter().map(read).collect()
}
