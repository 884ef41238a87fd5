//! Acts on the flags of `density`.

use anyhow::{Result, bail};
use lgs_cli::{progress::Bar, threads};
use lgs_measure::{ablate::job::Hashed, clips::Choice, density::job::DensityJob};
use lgs_train::stages::clips::find;

use crate::density_args::DensityArgs;

/// The text for standard output.
pub(crate) fn density(args: &DensityArgs) -> Result<String> {
    threads::set_num_threads(args.threads)?;
    let Some(loaded) = args.weights.load(args.seed)? else {
        bail!("--weights: expected weights to measure, found none")
    };
    let mut clips = Vec::new();
    for choice in &args.clips {
        // What is no directory of clips may be one that an importer knows.
        let found = find(&choice.dir).unwrap_or_else(|_| vec![choice.dir.clone()]);
        clips.extend(found.into_iter().map(|dir| Choice { dir, ..choice.clone() }));
    }
    let job = DensityJob {
        clips,
        model: Hashed { value: &loaded.model, sha256: &loaded.digest },
        settings: args.settings(),
        out: args.out.clone(),
    };
    let bar = Bar::new("density", (job.clips.len() * job.points_per_clip()) as u64);
    let page = job.run(&mut |clip, point| {
        bar.inc(1);
        let psnr = point.learned.psnr.map_or("–".to_owned(), |psnr| format!("{psnr:.2}"));
        let by = point.signal.map_or("all", |signal| signal.name());
        bar.line(&format!("{clip}: {by} {} % ({} Gaussians) {psnr} dB", point.percent, point.gaussians));
    })?;
    Ok(page)
}
