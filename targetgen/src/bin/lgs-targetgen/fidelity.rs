//! `fidelity`: signals against the true effects of single actions.

use std::io::{self, Write};
use std::path::Path;

use anyhow::{Context, Result};
use lgs_cli::threads;
use lgs_engine::loss::LossWeights;
use lgs_engine::refine::adam::{AdamRates, adam};
use lgs_engine::views::View;
use lgs_formats::write::write_atomic;
use lgs_targetgen::branches::Problem;
use lgs_targetgen::fidelity::{
    AfterSettings, CorrelationRow, Effects, Sample, after, at_once, pairs, pictures, rows, table,
};
use lgs_targetgen::sample::clip_seed;
use lgs_targetgen::scene::load_scene;

use crate::args::FidelityArgs;
use crate::run::config;

/// Measures and returns what to print.
pub(crate) fn fidelity(args: &FidelityArgs) -> Result<String> {
    threads::set_num_threads(args.scene.threads())?;
    let out = &args.out;
    std::fs::create_dir_all(out).with_context(|| format!("{}: create", out.display()))?;
    let model = args.scene.weights.load(args.scene.seed)?;
    let weights = model.as_ref().map(|loaded| loaded.digest.clone());
    let config = config(&args.scene, &args.sampling, weights);
    let mut scene = load_scene(&args.clip, &config, model.as_ref().map(|loaded| &loaded.model))?;
    let views: Vec<&View> = scene.views.iter().collect();
    let warm_up = adam(&mut scene.set, &views, &AdamRates::default(), args.warm_up as usize, |_| ());
    if let (Some(first), Some(last)) = (warm_up.losses.first(), warm_up.losses.last()) {
        say(&format!("{} steps first: loss {first:.4} to {last:.4}", args.warm_up));
    }
    let problem = Problem { set: &scene.set, views: &scene.views, weights: LossWeights::default() };
    let seed = clip_seed(args.scene.seed, "fidelity");
    let sample = Sample::new(&problem, &config, seed, args.sample as usize)?;
    let mut text = String::new();
    let mut found: Vec<(&str, Vec<CorrelationRow>)> = Vec::new();
    let effects = at_once(&problem, &sample);
    let title = format!("at once, after {} steps", args.warm_up);
    text += &section(out, "at-once", &title, &sample, &effects, &mut found)?;
    if args.after > 0 {
        let few = sample.first(args.sample_after.unwrap_or(args.sample) as usize);
        let settings = AfterSettings { steps: args.after as usize, separation_px: args.separation };
        let effects = after(&problem, &few, &settings, &mut |share| say(&format!("after: {:.0} %", 100.0 * share)));
        let title = format!("{} steps later, after {} steps", args.after, args.warm_up);
        text += &section(out, "after", &title, &few, &effects, &mut found)?;
    }
    let json = serde_json::to_string_pretty(&found.into_iter().collect::<std::collections::BTreeMap<_, _>>())?;
    write_atomic(&out.join("fidelity.json"), (json + "\n").as_bytes())?;
    write_atomic(&out.join("fidelity.txt"), text.as_bytes())?;
    Ok(text)
}

/// The table of one oracle, its pictures and pairs written.
fn section(
    out: &Path,
    key: &'static str,
    title: &str,
    sample: &Sample,
    effects: &Effects,
    found: &mut Vec<(&'static str, Vec<CorrelationRow>)>,
) -> Result<String> {
    for (name, svg) in pictures(title, sample, effects) {
        write_atomic(&out.join(format!("{key}-{name}")), svg.as_bytes())?;
    }
    write_atomic(&out.join(format!("{key}.csv")), pairs(sample, effects).as_bytes())?;
    let rows = rows(sample, effects);
    let text = table(title, &rows);
    found.push((key, rows));
    Ok(text)
}

/// A line on standard error; nobody there is no reason to stop.
fn say(line: &str) {
    let _ = writeln!(io::stderr(), "{line}");
}
