//! What the commands do.

use std::{ffi::OsStr, path::Path};

use anyhow::{Context, Result, bail};
use lgs_cli::Outcome;
use lgs_formats::{
    clip_dir::ClipDir,
    importers::{self, Additions, DepthFolder, Selection},
    ply::read_ply,
    viewer,
    write::write_atomic,
};

use crate::{
    args::{Args, Command, Import, Inspect, View},
    inspect::{self, contact_sheet},
};

/// Does what the command line asks for.
pub(crate) fn run(args: &Args) -> Result<Outcome> {
    match &args.command {
        Command::Import(args) => import(args),
        Command::Inspect(args) => look(args),
        Command::View(args) => view(args),
    }
}

fn import(args: &Import) -> Result<Outcome> {
    let selection = Selection {
        scene: args.scene.clone(),
        frames: args.frames.as_ref().map(|list| list.0.clone()),
        cameras: args.cameras.clone(),
        lidars: args.lidars.clone(),
    };
    let source = importers::open_as(args.layout.layout(), &args.source, &selection)?;
    let depth = args.depth.as_ref().zip(args.depth_kind);
    let depth = depth.map(|(folder, arg)| DepthFolder { folder: folder.clone(), kind: arg.kind() });
    importers::write_with(&source, &args.out, &Additions { masks: args.masks.clone(), depth })?;
    let has_images = source.clip().frames.iter().any(|frame| !frame.cameras.is_empty());
    let no_images = "no images: the folder has none that belong to these sweeps, so that lgs-infer can colour nothing";
    let notes = if has_images { Vec::new() } else { vec![no_images.to_owned()] };
    Ok(Outcome { text: summary(&source, &args.out, has_images), notes, has_findings: false })
}

fn summary(source: &ClipDir, out: &Path, has_images: bool) -> String {
    let sheet = if has_images { " --contact-sheet sheet.png" } else { "" };
    let clip = source.clip();
    let num_images: usize = clip.frames.iter().map(|frame| frame.cameras.len()).sum();
    let boxes = match clip.frames.iter().filter_map(|frame| frame.boxes.as_ref()).map(Vec::len).reduce(|a, b| a + b) {
        Some(count) => format!("{count} boxes"),
        None => "boxes unknown".to_owned(),
    };
    format!(
        "{}: {} frames, {num_images} images, {boxes}\n{:<18} {}\n{:<18} {}\n{:<18} {}\n",
        clip.name,
        clip.frames.len(),
        "  licence",
        clip.licence,
        "  written to",
        out.display(),
        "  to look at it",
        format_args!("lgs-clip inspect {}{sheet}", out.display()),
    )
}

fn look(args: &Inspect) -> Result<Outcome> {
    let clip = importers::open(&args.directory)?;
    let report = inspect::measure(&clip)?;
    let sheet = args.contact_sheet.as_deref().map(|file| contact_sheet(&clip, file)).transpose()?;
    let has_findings = !report.warnings.is_empty();
    let text = if args.json {
        serde_json::to_string_pretty(&report).context("report: encode")? + "\n"
    } else {
        let mut text = report.to_string();
        if let (Some(sheet), Some(file)) = (sheet, &args.contact_sheet) {
            text += &format!("  {:<18} {}: {sheet}\n", "contact sheet", file.display());
        }
        text
    };
    Ok(Outcome { text, notes: Vec::new(), has_findings })
}

fn view(args: &View) -> Result<Outcome> {
    let scene = read_ply(&args.scene)?;
    let out = args.out.clone().unwrap_or_else(|| args.scene.with_extension("html"));
    if out == args.scene {
        bail!("--out: expected another file than the scene, found {}", out.display());
    }
    let title = args.scene.file_stem().map_or_else(|| "scene".into(), OsStr::to_string_lossy);
    write_atomic(&out, viewer::html(&scene, &[], &title).as_bytes())?;
    Ok(format!("{}: {} Gaussians, to open in a browser", out.display(), scene.means.len()).into())
}
