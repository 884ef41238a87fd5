//! Acts on parsed flags.

use anyhow::{Context, Result, anyhow};
use lgs_cli::progress::Bar;
use lgs_train::scenes::{
    Scene,
    export::{self, Written},
};

use crate::{
    args::{Cli, Command, ScenesArgs},
    stage,
};

/// The text for standard output.
pub(crate) fn run(cli: &Cli) -> Result<String> {
    match &cli.command {
        Command::Scenes(args) => scenes(args),
        Command::Backbone(args) => stage::backbone(args),
        Command::Policy(args) => stage::policy(args),
        Command::Finetune(args) => stage::finetune(args),
        Command::Export(args) => stage::export(args),
        Command::Ship(args) => crate::ship::ship(args),
    }
}

/// The summary of the made clips. Everything that can be known to fail is checked before the first one is made.
fn scenes(args: &ScenesArgs) -> Result<String> {
    let plan = args.plan().map_err(|message| anyhow!(message))?;
    for planned in &plan {
        planned.config.validate().with_context(|| format!("scene {}", planned.export.name))?;
        export::require_vacant(&planned.dir)?;
    }
    let images: usize = plan.iter().map(|p| p.config.num_frames * p.config.rig.cameras.len()).sum();
    let bar = Bar::new("scenes", images as u64);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(args.threads.unwrap_or(0)).build()?;
    let start = std::time::Instant::now();
    let mut total = Written::default();
    for planned in plan.iter().cloned() {
        // The pool's own threads work on a scene, so that its size is the number of threads.
        let written = pool.install(|| -> lgs_train::error::Result<Written> {
            let scene = Scene::new(planned.config)?;
            export::write(&scene, &planned.dir, &planned.export, &|| bar.inc(1))
        })?;
        total.frames += written.frames;
        total.images += written.images;
        total.points += written.points;
    }
    let seconds = start.elapsed().as_secs_f64();
    let Written { frames, images, points } = total;
    if args.json {
        let summary = serde_json::json!({
            "format": "lgs-scenes/1",
            "clips": plan.iter().map(|planned| planned.dir.display().to_string()).collect::<Vec<_>>(),
            "frames": frames,
            "images": images,
            "points": points,
            "seconds": seconds,
        });
        return Ok(summary.to_string());
    }
    let num = plan.len();
    Ok(format!(
        "{num} clips in {}: {frames} frames, {images} images, {points} points, {seconds:.1} s",
        args.out.display()
    ))
}
