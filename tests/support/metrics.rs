//! `metrics.json` as its readers rely on it.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::Outcome;

/// The figures of a view.
pub const FIGURES: [&str; 9] =
    ["psnr", "psnr_copying", "ssim", "lpips", "dmae", "psnr_dynamic", "ssim_dynamic", "psnr_static", "ssim_static"];
const TOP: [&str; 14] = [
    "format",
    "clip",
    "config",
    "weights",
    "threads",
    "drawn_on",
    "seed",
    "gaussians",
    "moving",
    "stages_s",
    "reconstruction_s",
    "peak_rss_mb",
    "views",
    "mean",
];
/// What only some clips have: findings about them.
const FINDINGS: [&str; 6] = ["lidar_turn", "lenses", "calibration", "mounts", "photometry", "dropped_returns"];
/// What a network adds.
const NETWORK: [&str; 3] = ["query_skipped", "set_update_skipped", "refine"];
const REFINE: [&str; 8] = [
    "losses",
    "pixel_stride",
    "steps",
    "stopped_early",
    "unseen",
    "pyramids_kept",
    "non_finite_gradients",
    "non_finite_outputs",
];
const REFINE_STAGES: [&str; 3] = ["refine_render", "refine_loss", "refine_network"];
const GAUSSIANS: [&str; 7] = ["returns", "initial", "pruned", "added", "final", "background_pruned", "background"];
const STAGES: [&str; 10] =
    ["load", "points", "background", "backbone", "query", "policy", "set_update", "refine", "render", "evaluate"];

/// The `metrics.json` of an output directory.
///
/// # Errors
/// It cannot be read.
pub fn read(out: &Path) -> Result<Value, String> {
    let path = out.join("metrics.json");
    let text = fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    serde_json::from_str(&text).map_err(|e| format!("{}: {e}", path.display()))
}

/// The number at a path of keys.
///
/// # Errors
/// There is none.
pub fn number(page: &Value, keys: &[&str]) -> Result<f64, String> {
    let place = keys.iter().fold(page, |value, key| &value[*key]);
    place.as_f64().ok_or_else(|| format!("{} is no number but {place}", keys.join(".")))
}

/// The page without times, memory and the number of threads: what must not depend on the machine.
pub fn without_costs(page: &Value) -> Value {
    let mut page = page.clone();
    if let Some(keys) = page.as_object_mut() {
        for cost in ["stages_s", "reconstruction_s", "peak_rss_mb", "threads"] {
            keys.remove(cost);
        }
    }
    page
}

/// Fails unless every object of the page has exactly the keys that its readers know.
pub fn expect_promised_keys(page: &Value) -> Outcome {
    expect_keys("metrics.json", page, &TOP)?;
    expect_keys("gaussians", &page["gaussians"], &GAUSSIANS)?;
    expect_keys("moving", &page["moving"], &["lidar", "background"])?;
    expect_keys("stages_s", &page["stages_s"], &STAGES)?;
    expect_keys("mean", &page["mean"], &["input", "held_out"])?;
    expect_keys("mean.input", &page["mean"]["input"], &FIGURES)?;
    expect_keys("mean.held_out", &page["mean"]["held_out"], &FIGURES)?;
    let view_keys = [["frame", "camera", "role"].as_slice(), &FIGURES].concat();
    let views = page["views"].as_array().ok_or("views is no list")?;
    for (i, view) in views.iter().enumerate() {
        expect_keys(&format!("views[{i}]"), view, &view_keys)?;
    }
    if views.is_empty() { Err("views is empty".into()) } else { Ok(()) }
}

/// Fails unless the page of a run with a network has exactly the keys that it adds.
pub fn expect_network_keys(page: &Value) -> Outcome {
    expect_keys("metrics.json", page, &[TOP.as_slice(), &["network"]].concat())?;
    expect_keys("network", &page["network"], &NETWORK)?;
    expect_keys("network.refine", &page["network"]["refine"], &REFINE)?;
    expect_keys("stages_s", &page["stages_s"], &[STAGES.as_slice(), &REFINE_STAGES].concat())
}

/// Fails unless the page of a run with a per-scene optimisation, and no network, has exactly the keys that it adds.
pub fn expect_optimised_keys(page: &Value) -> Outcome {
    expect_keys("metrics.json", page, &[TOP.as_slice(), &["optimisation"]].concat())?;
    expect_keys("optimisation", &page["optimisation"], &["losses", "pixel_stride", "non_finite_gradients"])?;
    expect_keys("stages_s", &page["stages_s"], &[STAGES.as_slice(), &REFINE_STAGES].concat())
}

fn expect_keys(what: &str, object: &Value, want: &[&str]) -> Outcome {
    let object = object.as_object().ok_or_else(|| format!("{what} is no object"))?;
    let is_finding = |key: &&str| what == "metrics.json" && FINDINGS.contains(key);
    let got: BTreeSet<&str> = object.keys().map(String::as_str).filter(|key| !is_finding(key)).collect();
    let want: BTreeSet<&str> = want.iter().copied().collect();
    if got == want { Ok(()) } else { Err(format!("{what}: keys {got:?}, want {want:?}").into()) }
}
