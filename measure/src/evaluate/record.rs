//! What is recorded of a snippet: figures alone, which are the same in every run.

use serde::{Deserialize, Serialize};

use super::figures::Figures;
use crate::sweep::measure::Counts;

/// The figures of a snippet.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SnippetRecord {
    /// The name of its drive.
    pub log: String,
    /// Indices of the frames that the reconstruction read.
    pub inputs: Vec<usize>,
    /// Indices of the frames that were drawn and measured.
    pub targets: Vec<usize>,
    /// Of each recipe, in their order.
    pub runs: Vec<RunRecord>,
    /// The view whose pictures are kept: the one of the lowest PSNR by the last recipe.
    pub shown: Option<ShownView>,
}

/// What a recipe made of a snippet.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunRecord {
    /// The name of the recipe.
    pub recipe: String,
    /// How many Gaussians there were.
    pub gaussians: Counts,
    /// The views of the target frames.
    pub views: Vec<ViewRecord>,
}

/// The figures of a view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ViewRecord {
    /// Index of its frame.
    pub frame: usize,
    /// Name of its camera.
    pub camera: String,
    /// The figures.
    pub figures: Figures,
}

/// A view of which there are pictures.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShownView {
    /// Index of its frame.
    pub frame: usize,
    /// Name of its camera.
    pub camera: String,
    /// Width and height of the view, pixels.
    pub size: [u32; 2],
}

impl RunRecord {
    /// The means over the views.
    pub fn mean(&self) -> Figures {
        Figures::mean(self.views.iter().map(|view| &view.figures))
    }
}
