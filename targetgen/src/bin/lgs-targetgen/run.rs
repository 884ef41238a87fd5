//! Does what the command line asks for.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

use anyhow::{Context, Result};
use lgs_cli::{Outcome, threads};
use lgs_engine::allocator;
use lgs_formats::jobs::choose_part;
use lgs_formats::targets::{FailedClip, MANIFEST_FILE, Manifest, TargetsConfig};
use lgs_formats::write::write_atomic;
use lgs_targetgen::job::{self, TargetJob, find_clips};
use lgs_targetgen::report::{Summary, THRESHOLDS, html, summarise};

use crate::args::{Args, Command, JobArgs, SamplingArgs, SceneArgs};
use crate::progress::Teller;

const MEGABYTE: u64 = 1_000_000;

/// Does what the command line asks for.
pub(crate) fn run(args: &Args) -> Result<Outcome> {
    match &args.command {
        None => generate(&args.job),
        Some(Command::Merge(merge)) => {
            let out = merge.out.as_ref().unwrap_or(&merge.folders[0]);
            let manifest = job::merge(&merge.folders, out, merge.shard_mb * MEGABYTE)?;
            let summary = summarise(out, &manifest)?;
            write_atomic(&out.join("report.html"), html(&summary, &manifest, &Default::default(), 0).as_bytes())?;
            Ok(outcome(text(&summary, &manifest, out), &manifest.failed))
        }
        Some(Command::Retarget(retarget)) => {
            let (transform, out) = (retarget.transform, &retarget.out);
            let manifest = job::retarget(&retarget.folder, out, transform.log_scale, transform.zscore)?;
            let summary = summarise(out, &manifest)?;
            write_atomic(&out.join("report.html"), html(&summary, &manifest, &Default::default(), 0).as_bytes())?;
            Ok(text(&summary, &manifest, out).into())
        }
        Some(Command::Verify(verify)) => {
            let manifest = Manifest::read(&verify.folder.join(MANIFEST_FILE))?;
            manifest.verify(&verify.folder)?;
            Ok(format!("{} shards are as {MANIFEST_FILE} says", manifest.shards.len()).into())
        }
        Some(Command::Fidelity(args)) => Ok(crate::fidelity::fidelity(args)?.into()),
    }
}

fn generate(args: &JobArgs) -> Result<Outcome> {
    threads::set_num_threads(args.scene.threads())?;
    let out = args.out.as_deref().context("--out: expected a folder, found nothing")?;
    let clips = find_clips(&args.clips)?;
    let share = choose_part(out, args.part, &|name| std::env::var(name).ok())?;
    let part = share.map(|(part, _)| part);
    let model = args.scene.weights.load(args.scene.seed)?;
    let weights = model.as_ref().map(|loaded| loaded.digest.clone());
    let config = TargetsConfig {
        signal: args.signal,
        normalise: args.normalise,
        log_scale: args.transform.log_scale,
        zscore: args.transform.zscore,
        with_features: args.with_features,
        ..config(&args.scene, &args.sampling, weights)
    };
    let job = TargetJob {
        clips: &clips,
        part,
        out: out.to_owned(),
        config,
        model: model.as_ref().map(|loaded| &loaded.model),
        shard_bytes: args.shard_mb * MEGABYTE,
        resume: args.resume,
    };
    let mut teller = Teller::new();
    if let Some((_, shares)) = share {
        shares.write(out)?;
    }
    let run = job::run(&job, &mut |event| teller.tell(event))?;
    let manifest = &run.manifest;
    let summary = summarise(out, manifest)?;
    let name = part.map_or("report.html".to_owned(), |part| format!("report-{}-of-{}.html", part.index, part.count));
    write_atomic(&out.join(name), html(&summary, manifest, &run.seconds, run.passes).as_bytes())?;
    let text = if args.json { json(&summary, &run)? } else { text(&summary, manifest, out) + &times(&run) };
    Ok(outcome(text, &run.manifest.failed))
}

/// What a run says whose `failed` clips have no targets.
fn outcome(text: String, failed: &[FailedClip]) -> Outcome {
    let notes = failed.iter().map(|clip| format!("{}: {}", clip.clip, clip.reason)).collect();
    Outcome { text, notes, has_findings: !failed.is_empty() }
}

/// The settings that jobs and measurements share; what is left is the default.
pub(crate) fn config(scene: &SceneArgs, sampling: &SamplingArgs, weights: Option<String>) -> TargetsConfig {
    TargetsConfig {
        rounds: sampling.rounds,
        rho: sampling.rho,
        neighbours: sampling.neighbours,
        noise_m: sampling.noise_m,
        cameras: scene.cameras.clone(),
        image_size: scene.image_size.map(|size| [size.height, size.width]),
        seed: scene.seed,
        weights,
        ..TargetsConfig::default()
    }
}

fn line(text: &mut String, name: &str, value: &str) {
    // writing to a String cannot fail
    let _ = writeln!(text, "  {name:<18} {value}");
}

fn text(summary: &Summary, manifest: &Manifest, out: &Path) -> String {
    let mut text = String::from("targets\n");
    let percent = |count: u64, of: u64| 100.0 * count as f64 / (of.max(1)) as f64;
    line(&mut text, "clips", &format!("{} with targets, {} failed", summary.clips, manifest.failed.len()));
    let sampled = percent(summary.sampled, summary.primitives);
    line(&mut text, "primitives", &format!("{}, {sampled:.1} % of them sampled", summary.primitives));
    for (name, action) in [("prune", &summary.prune), ("add", &summary.add)] {
        let above =
            action.above.iter().zip(THRESHOLDS).map(|(&n, t)| format!("y > {t}: {:.2} %", percent(n, action.valid)));
        let shares = above.collect::<Vec<_>>().join("  ");
        line(&mut text, name, &format!("{:.1} % valid  {shares}", percent(action.valid, summary.sampled)));
    }
    let bytes: u64 = manifest.shards.iter().map(|shard| shard.bytes).sum();
    line(
        &mut text,
        "written to",
        &format!("{}: {} shards, {:.1} MB", out.display(), manifest.shards.len(), bytes as f64 / 1e6),
    );
    text
}

fn times(run: &job::Outcome) -> String {
    let mut text = String::new();
    if run.done_now > 0 {
        let total = run.seconds.total();
        let stages = run.seconds.by_stage().map(|(name, spent)| format!("{name} {:.0} %", 100.0 * spent / total));
        let per_hour = 3600.0 * run.done_now as f64 / total;
        let per_pass = 1e3 * run.seconds.render / run.passes.max(1) as f64;
        line(&mut text, "this run", &format!("{} clips, {per_hour:.0} an hour, {per_pass:.0} ms a pass", run.done_now));
        line(&mut text, "", &stages.join("  "));
    }
    let memory = allocator::peak_rss_mb().map_or("unknown".to_owned(), |mb| format!("{mb:.0} MB"));
    line(&mut text, "peak memory", &memory);
    text
}

fn json(summary: &Summary, run: &job::Outcome) -> Result<String> {
    let seconds: BTreeMap<&str, f64> = run.seconds.by_stage().into_iter().collect();
    let value = serde_json::json!({
        "format": "lgs-targetgen/1",
        "summary": summary,
        "failed": run.manifest.failed,
        "done_now": run.done_now,
        "done_before": run.done_before,
        "seconds": seconds,
        "passes": run.passes,
        "peak_rss_mb": allocator::peak_rss_mb(),
    });
    Ok(serde_json::to_string_pretty(&value)? + "\n")
}
