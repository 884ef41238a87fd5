//! `ship`: flags and action.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use lgs_train::ship::{CardSource, card, weights};
use lgs_train::stages::weights::Precision;

/// Flags of `ship`.
#[derive(Clone, Debug, Args)]
pub(crate) struct ShipArgs {
    /// Weights file
    #[arg(long, value_name = "FILE")]
    pub(crate) weights: PathBuf,
    /// Stores the values in half precision; measure the result, not the original
    #[arg(long, conflicts_with = "ablation")]
    pub(crate) half: bool,
    /// Writes the card instead of the weights: directory of the ablation of exactly these weights [default: none]
    #[arg(long, value_name = "DIR", requires = "notes")]
    pub(crate) ablation: Option<PathBuf>,
    /// Markdown page on data and training for the card [default: none]
    #[arg(long, value_name = "FILE", requires = "ablation")]
    pub(crate) notes: Option<PathBuf>,
    /// Directory to write to: `models` of the repository, from which builds take what ships
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
}

/// The text for standard output.
pub(crate) fn ship(args: &ShipArgs) -> Result<String> {
    let written = match (&args.ablation, &args.notes) {
        (Some(ablation), Some(notes)) => card(CardSource { weights: &args.weights, ablation, notes }, &args.out)?,
        _ => weights(&args.weights, if args.half { Precision::Half } else { Precision::Full }, &args.out)?,
    };
    Ok(written.display().to_string())
}
