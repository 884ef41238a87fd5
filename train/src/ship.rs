//! Weights as they ship: the file that programs are built with, and the card beside it.

use std::{
    fmt::Write as _,
    path::{Path, PathBuf},
};

use lgs_engine::network::{
    config::ModelConfig,
    describe::describe,
    source::{CONFIG_KEY, load_model},
    weights::WeightFile,
};
use lgs_formats::{error::FormatError, write::write_atomic};
use serde::Deserialize;

use crate::{
    error::{Result, TrainError},
    stages::weights::{Precision, StartWeights, write_weights},
};

/// Name of the weights file.
pub const WEIGHTS_FILE: &str = "tiny.safetensors";
/// Name of its card.
pub const CARD_FILE: &str = "tiny.md";
/// Largest weights file that ships, bytes.
pub const MAX_BYTES: usize = 16_000_000;
/// Terms under which the weights may be used.
pub const LICENCE: &str = "MIT OR Apache-2.0";

/// What a card says beside what the files themselves say.
#[derive(Clone, Copy, Debug)]
pub struct CardSource<'a> {
    /// The weights file.
    pub weights: &'a Path,
    /// Directory of its ablation.
    pub ablation: &'a Path,
    /// Markdown on data and training, by people.
    pub notes: &'a Path,
}

/// What is read of `ablation.json`.
#[derive(Deserialize)]
struct AblationPage {
    weights: String,
}

/// The path of the written file: the weights of `from` in `dir`, under the name that builds look for.
///
/// # Errors
/// `from` is no weights file, or one with values that half precision cannot hold; the result would be too large; it cannot be written.
pub fn weights(from: &Path, precision: Precision, dir: &Path) -> Result<PathBuf> {
    let path = dir.join(WEIGHTS_FILE);
    let staged = tempfile::NamedTempFile::new().map_err(|e| FormatError::io(&path, "stage", e))?;
    let bytes = match precision {
        Precision::Full => read(from)?,
        Precision::Half => {
            write_weights(&StartWeights::read(from)?.variables, precision, staged.path())?;
            read(staged.path())?
        }
    };
    if bytes.len() > MAX_BYTES {
        return Err(TrainError::config(from.display().to_string(), format!("at most {MAX_BYTES} bytes"), bytes.len()));
    }
    // Refused here rather than by everyone who is given the file: tensors that lack or are not finite.
    write_atomic(staged.path(), &bytes)?;
    load_model(staged.path())?;
    write_atomic(&path, &bytes)?;
    Ok(path)
}

/// The path of the written card: what `dir` ships, what it was made from and what it is worth.
///
/// # Errors
/// A file cannot be read; the ablation is of other weights; the card cannot be written.
pub fn card(source: CardSource<'_>, dir: &Path) -> Result<PathBuf> {
    let bytes = read(source.weights)?;
    let file = WeightFile::parse(&source.weights.display().to_string(), &bytes)?;
    let page = source.ablation.join("ablation.json");
    let measured: AblationPage = serde_json::from_str(&text(&page)?)
        .map_err(|e| FormatError::invalid(&page, "content", "an ablation", e.to_string()))?;
    if measured.weights != file.sha256() {
        let expected = format!("an ablation of the weights {}", file.sha256());
        return Err(FormatError::invalid(&page, "weights", expected, measured.weights).into());
    }
    let config = ModelConfig::parse(file.metadata(CONFIG_KEY)?, source.weights)?;
    let mut card = format!("# `{WEIGHTS_FILE}`\n\n");
    // Writing to a string cannot fail.
    let _ = writeln!(card, "| | |\n|---|---|\n| SHA-256 | `{}` |\n| bytes | {} |", file.sha256(), bytes.len());
    let _ = writeln!(card, "| values | {} |\n| licence | {LICENCE} |\n", types(&bytes)?);
    let _ = writeln!(card, "{}\n", text(source.notes)?.trim());
    let _ = writeln!(card, "## Scores\n\n{}\n", text(&source.ablation.join("ablation.md"))?.trim());
    let _ = writeln!(card, "## Tensors\n\n```text\n{}\n```", describe(&config)?.trim());
    let path = dir.join(CARD_FILE);
    write_atomic(&path, card.as_bytes())?;
    Ok(path)
}

fn read(path: &Path) -> Result<Vec<u8>> {
    std::fs::read(path).map_err(|e| FormatError::io(path, "read", e).into())
}

fn text(path: &Path) -> Result<String> {
    std::fs::read_to_string(path).map_err(|e| FormatError::io(path, "read", e).into())
}

/// The types of the values, such as `F32`.
fn types(bytes: &[u8]) -> Result<String> {
    let content = safetensors::SafeTensors::deserialize(bytes).map_err(candle_core::Error::from)?;
    let mut names: Vec<String> = content.iter().map(|(_, view)| format!("{:?}", view.dtype())).collect();
    names.sort();
    names.dedup();
    Ok(names.join(", "))
}
