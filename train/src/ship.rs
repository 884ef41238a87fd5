//! Weights as they ship: the file that programs are built with, and the card beside it.

use std::{
    collections::{BTreeMap, HashMap},
    fmt::Write as _,
    path::{Path, PathBuf},
};

use candle_core::{DType, Device};
use lgs_engine::network::{
    config::ModelConfig,
    describe::describe,
    source::{CONFIG_KEY, load_model},
    weights::WeightFile,
};
use lgs_formats::{error::FormatError, write::write_atomic};
use serde::Deserialize;

use crate::error::{Result, TrainError};

/// Name of the weights file.
pub const WEIGHTS_FILE: &str = "tiny.safetensors";
/// Name of its card.
pub const CARD_FILE: &str = "tiny.md";
/// Largest weights file that ships, bytes.
pub const MAX_BYTES: usize = 16_000_000;
/// Terms under which the weights may be used.
pub const LICENCE: &str = "MIT OR Apache-2.0";

/// How values are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Storage {
    /// As they are.
    Same,
    /// In half precision.
    Half,
}

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
struct Measured {
    weights: String,
}

/// The path of the written file: the weights of `from` in `dir`, under the name that builds look for.
///
/// # Errors
/// `from` is no weights file, or one with values that half precision cannot hold; the result would be too large; it cannot be written.
pub fn weights(from: &Path, storage: Storage, dir: &Path) -> Result<PathBuf> {
    let mut bytes = read(from)?;
    if storage == Storage::Half {
        bytes = in_half(&bytes, from)?;
    }
    if bytes.len() > MAX_BYTES {
        return Err(TrainError::config(from.display().to_string(), format!("at most {MAX_BYTES} bytes"), bytes.len()));
    }
    let path = dir.join(WEIGHTS_FILE);
    // Refused here rather than by everyone who is given the file: tensors that lack or are not finite.
    let staged = tempfile::NamedTempFile::new().map_err(|e| FormatError::io(&path, "stage", e))?;
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
    let measured: Measured = serde_json::from_str(&text(&page)?)
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

/// The weights file in half precision.
fn in_half(bytes: &[u8], from: &Path) -> Result<Vec<u8>> {
    let config = WeightFile::parse(&from.display().to_string(), bytes)?.metadata(CONFIG_KEY)?.to_owned();
    let tensors = candle_core::safetensors::load_buffer(bytes, &Device::Cpu)?;
    let half = tensors.into_iter().map(|(name, tensor)| Ok((name, tensor.to_dtype(DType::F16)?)));
    let half: BTreeMap<_, _> = half.collect::<candle_core::Result<_>>()?;
    let metadata = HashMap::from([(CONFIG_KEY.to_owned(), config)]);
    safetensors::serialize(half, Some(metadata))
        .map_err(|e| TrainError::Encode { file: from.to_owned(), reason: e.to_string() })
}

/// The types of the values, such as `F32`.
fn types(bytes: &[u8]) -> Result<String> {
    let content = safetensors::SafeTensors::deserialize(bytes).map_err(candle_core::Error::from)?;
    let mut names: Vec<String> = content.iter().map(|(_, view)| format!("{:?}", view.dtype())).collect();
    names.sort();
    names.dedup();
    Ok(names.join(", "))
}
