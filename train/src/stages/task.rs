//! What tells the stages of training apart: what a step reads, what it computes, what is recorded and measured.

use lgs_engine::network::weights::TensorSpec;

use super::{
    settings::RunSettings,
    variables::{Values, Variables},
};
use crate::error::Result;

/// What one step computed.
#[derive(Clone, Debug)]
pub struct Computed {
    /// Of the columns that [`Task::columns`] names.
    pub values: Vec<f64>,
    /// By all tensors.
    pub gradients: Values,
    /// Whether the weights may follow: something was seen, and the losses are finite.
    pub usable: bool,
}

/// Names of what is recorded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Columns {
    /// Of a step.
    pub step: Vec<String>,
    /// Of a validation.
    pub validation: Vec<String>,
}

/// A picture of some columns over the steps.
#[derive(Clone, Copy, Debug)]
pub struct Picture {
    /// Beginnings of the names of its columns.
    pub prefixes: &'static [&'static str],
    /// What it shows.
    pub title: &'static str,
    /// Name of its file.
    pub file: &'static str,
}

/// A stage of training.
pub trait Task: Sync {
    /// Settings of a run.
    type Settings: RunSettings;
    /// What a step is computed from.
    type Sample: Send;

    /// Fails when something that is measured on is also trained on.
    ///
    /// # Errors
    /// When something that is measured on is also trained on.
    fn check(&self) -> Result<()>;

    /// Whether a parameter of the model is trained.
    fn trains(&self, spec: &TensorSpec) -> bool;

    /// The sample of a step: the same for a seed and a step, whatever came before.
    ///
    /// # Errors
    /// Whatever is wrong with what is read.
    fn sample(&self, settings: &Self::Settings, step: u64) -> Result<Self::Sample>;

    /// Losses and gradients of a sample.
    ///
    /// # Errors
    /// When a position leaves the voxel grid.
    fn compute(&self, variables: &Variables, settings: &Self::Settings, sample: Self::Sample) -> Result<Computed>;

    /// Names of what is recorded of steps and of validations.
    fn columns(&self, settings: &Self::Settings) -> Columns;

    /// What a model is worth on what is held out, by the path of inference; `None` where nothing is.
    ///
    /// # Errors
    /// When a position leaves the voxel grid.
    fn score(&self, model: &Variables, settings: &Self::Settings) -> Result<Option<Vec<f64>>>;

    /// Pictures of the columns of steps.
    fn pictures(&self) -> &'static [Picture];

    /// The values of a step in a few words.
    fn step_text(&self, settings: &Self::Settings, values: &[f64]) -> String;

    /// The values of a validation in a few words.
    fn score_text(&self, values: &[f64]) -> String;
}

/// `name_0`, `name_1`, ... as often as there are states of a scene: after the prediction and after every refinement step.
pub(crate) fn numbered(name: &str, steps: usize) -> Vec<String> {
    (0..=steps).map(|k| format!("{name}_{k}")).collect()
}
