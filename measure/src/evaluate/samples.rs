//! Made findings, for tests.

use lgs_engine::{evaluate::ViewFigures, pipeline::GaussianCounts, render::DrawnOn};
use serde_json::Map;

use super::{
    figures::Figures,
    findings::{Findings, Found, KEY_FORMAT, Key, RecordedRecipe},
    protocol::Protocol,
    record::{RunRecord, SnippetRecord, ViewRecord},
    times::SnippetTimes,
};

/// A snippet of a log, with an image for each PSNR; those of the second list have the figure of what moves too.
pub(super) fn snippet(log: &str, psnr: &[f64], dynamic: &[f64]) -> SnippetRecord {
    let view = |(frame, &psnr): (usize, &f64)| {
        let psnr_dynamic = dynamic.get(frame).copied();
        let figures = ViewFigures { psnr: Some(psnr), psnr_dynamic, ..ViewFigures::default() };
        ViewRecord { frame, camera: "c".to_owned(), figures: Figures::of(&figures, None) }
    };
    let views = psnr.iter().enumerate().map(view).collect();
    let runs = vec![RunRecord { recipe: "own".to_owned(), gaussians: GaussianCounts::default().into(), views }];
    SnippetRecord { log: log.to_owned(), inputs: vec![0, 2], targets: vec![1], runs, shown: None }
}

/// What a protocol found: the snippets, each of which took a second more than the one before.
pub(super) fn findings(protocol: &Protocol, records: Vec<SnippetRecord>) -> Findings {
    let found = |(index, record): (usize, SnippetRecord)| {
        let seconds = (index + 1) as f64;
        let times = SnippetTimes {
            load_s: 0.5,
            reconstruction_s: vec![seconds],
            evaluate_s: 0.25,
            peak_rss_mb: None,
            threads: 2,
            drawn_on: vec![DrawnOn { device: "CPU".to_owned(), refused: Vec::new() }],
        };
        Found { item: format!("{}-{index:05}", record.log), record, times: Some(times) }
    };
    Findings {
        key: Key {
            format: KEY_FORMAT.to_owned(),
            protocol: protocol.recorded(),
            recipes: vec![RecordedRecipe { name: "<own>".to_owned(), options: Map::new() }],
            weights: None,
            lpips_weights: None,
            seed: 0,
            scenes: false,
            viewer: false,
        },
        snippets: records.into_iter().enumerate().map(found).collect(),
        failed: Vec::new(),
    }
}
