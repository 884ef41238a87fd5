//! What the commands do.

use std::path::Path;

use anyhow::{Context, Result};
use lgs_formats::{
    clip_dir::ClipDir,
    importers::{self, Additions, DepthFolder, Selection},
    program::Outcome,
};

use crate::{
    args::{Args, Command, Import, Inspect},
    inspect::{self, contact_sheet},
};

/// Does what the command line asks for.
pub(crate) fn run(args: &Args) -> Result<Outcome> {
    match &args.command {
        Command::Import(args) => import(args),
        Command::Inspect(args) => look(args),
    }
}

fn import(args: &Import) -> Result<Outcome> {
    let selection = Selection {
        scene: args.scene.clone(),
        frames: args.frames.as_ref().map(|list| list.0.clone()),
        cameras: args.cameras.clone(),
    };
    let source = importers::open_as(args.layout.layout(), &args.source, &selection)?;
    let depth = args.depth.as_ref().zip(args.depth_kind);
    let depth = depth.map(|(folder, arg)| DepthFolder { folder: folder.clone(), kind: arg.kind() });
    importers::write_with(&source, &args.out, &Additions { masks: args.masks.clone(), depth })?;
    Ok(summary(&source, &args.out).into())
}

fn summary(source: &ClipDir, out: &Path) -> String {
    let clip = source.clip();
    let num_images: usize = clip.frames.iter().map(|frame| frame.cameras.len()).sum();
    let num_boxes: usize = clip.frames.iter().filter_map(|frame| frame.boxes.as_ref()).map(Vec::len).sum();
    format!(
        "{}: {} frames, {num_images} images, {num_boxes} boxes\n{:<18} {}\n{:<18} {}\n{:<18} {}\n",
        clip.name,
        clip.frames.len(),
        "  licence",
        clip.licence,
        "  written to",
        out.display(),
        "  to look at it",
        format_args!("lgs-clip inspect {} --contact-sheet sheet.png", out.display()),
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
