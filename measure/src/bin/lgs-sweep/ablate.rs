//! Acts on the flags of `ablate`.

use std::path::Path;

use anyhow::{Context, Result, bail};
use lgs_cli::{progress::Bar, threads};
use lgs_engine::evaluate::lpips::Lpips;
use lgs_formats::digest::sha256;
use lgs_measure::ablate::{
    job::{AblationJob, Hashed, Observer},
    record::AblationRecord,
    settings::STEPS,
};
use lgs_train::stages::clips::find;

use crate::ablate_args::AblateArgs;

/// The text for standard output.
pub(crate) fn ablate(args: &AblateArgs) -> Result<String> {
    threads::set_num_threads(args.threads)?;
    let Some(loaded) = args.weights.load(args.seed)? else {
        bail!("--weights: expected weights to measure, found none")
    };
    let lpips = args
        .lpips_weights
        .as_deref()
        .map(|file| Ok::<_, anyhow::Error>((Lpips::load(file)?, digest(file)?)))
        .transpose()?;
    let mut dirs = Vec::new();
    for path in &args.scenes {
        dirs.extend(find(path)?);
    }
    dirs.truncate(args.count.unwrap_or(usize::MAX));
    if dirs.is_empty() && args.clips.is_empty() {
        bail!("--scenes: expected scenes, or a --clip, found none");
    }
    let job = AblationJob {
        scenes: dirs.into_iter().map(|dir| args.scene(dir)).collect(),
        clips: args.clips.clone(),
        model: Hashed { value: &loaded.model, sha256: &loaded.digest },
        lpips: lpips.as_ref().map(|(value, sha256)| Hashed { value, sha256 }),
        settings: args.settings(),
        short: args.short(),
        out: args.out.clone(),
    };
    Ok(job.run(&Watch { bar: Bar::new("ablate", job.num_steps()) })?)
}

fn digest(file: &Path) -> Result<String> {
    let bytes = std::fs::read(file).with_context(|| format!("{}: read", file.display()))?;
    Ok(sha256(&bytes))
}

/// Progress on standard error.
struct Watch {
    bar: Bar,
}

impl Observer for Watch {
    fn begin(&self, clip: &Path, there: bool) {
        self.bar.message(clip.display().to_string());
        if there && !self.bar.is_hidden() {
            self.bar.line(&format!("{}: measured already", clip.display()));
        }
    }

    fn step(&self, steps: u64) {
        self.bar.inc(steps);
    }

    fn end(&self, record: &AblationRecord, left_out: u64) {
        self.bar.inc(left_out);
        let text = |psnr: Option<f64>| psnr.map_or("–".to_owned(), |psnr| format!("{psnr:.2}"));
        let learned = [0, STEPS].map(|steps| text(record.learned_at(steps).and_then(|point| point.figures.psnr)));
        let adam: Vec<String> =
            record.adam.iter().map(|point| format!("{} {}", point.steps, text(point.figures.psnr))).collect();
        let line = format!(
            "{}: start {} dB, predicted {}, {STEPS} steps {}; Adam {}; {} s left",
            record.clip,
            text(record.start.psnr),
            learned[0],
            learned[1],
            adam.join(" / "),
            self.bar.eta().as_secs()
        );
        self.bar.line(&line);
    }
}
