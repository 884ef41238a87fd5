//! What a refinement is asked for, and what it did.

use std::time::Instant;

use super::{PixelStride, ViewSchedule};
use crate::{network::config::StepLength, objective::ObjectiveSeconds, render::Device};

/// After which learned steps every Gaussian's length of the step is searched for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LineSearch {
    /// As the model's config asks: every one, or none.
    #[default]
    Auto,
    /// Every one.
    Every,
    /// The last alone: what follows mends most of what the others would have gained.
    Last,
    /// None: a step is as long as the network says.
    Off,
}

impl LineSearch {
    /// Whether it is as usual.
    pub(crate) fn is_auto(&self) -> bool {
        *self == Self::Auto
    }

    /// Whether lengths are searched for after a step, the last one or another, of a model whose config has these.
    pub const fn takes(self, lengths: StepLength, is_last: bool) -> bool {
        match self {
            Self::Auto => matches!(lengths, StepLength::Local),
            Self::Every => true,
            Self::Last => is_last,
            Self::Off => false,
        }
    }
}

/// What becomes of the last step of a refinement whose steps look at all views.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LastStep {
    /// As of every other: it is kept where the loss has fallen.
    #[default]
    Checked,
    /// It is kept, as what follows corrects it: nobody draws the views for it.
    Kept,
}

/// How far a refinement goes, and what its steps look at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RefineSettings {
    /// Steps.
    pub steps: usize,
    /// Views that a step looks at.
    pub schedule: ViewSchedule,
    /// Which of their pixels.
    pub pixel_stride: PixelStride,
    /// No step begins, after the first, that would probably end later than this; `None` for no limit.
    pub until: Option<Instant>,
    /// Steps after which lengths are searched for.
    pub line_search: LineSearch,
    /// What becomes of the last one.
    pub last: LastStep,
    /// Where views are drawn.
    pub device: Device,
}

impl From<usize> for RefineSettings {
    /// So many steps over all of the views.
    fn from(steps: usize) -> Self {
        Self {
            steps,
            schedule: ViewSchedule::default(),
            pixel_stride: PixelStride::ALL,
            until: None,
            line_search: LineSearch::Auto,
            last: LastStep::Checked,
            device: Device::Cpu,
        }
    }
}

/// What a refinement did, and what it left out because the scene did not need it.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct RefineSummary {
    /// Loss over the input views before each step that was begun, and after the last one when it was measured.
    pub losses: Vec<f64>,
    /// How far apart the pixels were that they drew, in columns and rows; `None` where there was no step.
    pub pixel_stride: Option<usize>,
    /// Steps whose result was kept.
    pub steps: usize,
    /// Whether the refinement ended because a step did not help: it changed nothing, or was taken back as the loss had not fallen.
    pub stopped_early: bool,
    /// Gaussians that no input view shows and that were left as they are, in the last step.
    pub unseen: usize,
    /// Steps that used the voxel pyramid of the step before, because no primitive had left its voxel.
    pub pyramids_kept: usize,
    /// Gaussians whose gradient was not finite and was taken as zero, over all steps.
    pub non_finite_gradients: usize,
    /// Gaussians that an output of the network would have given a value that is not finite, or carried off the voxel grid, and that were left as
    /// they were, over all steps.
    pub non_finite_outputs: usize,
    /// What it took; no result, so not part of what is written of one.
    #[serde(skip)]
    pub seconds: RefineSeconds,
}

impl RefineSummary {
    /// Seconds of drawing the views for a step, its loss and gradient, the mean; `None` where nothing was drawn.
    pub(crate) fn drawing_s(&self) -> Option<f64> {
        (!self.losses.is_empty()).then(|| (self.seconds.render + self.seconds.loss) / self.losses.len() as f64)
    }
}

/// Seconds of a refinement by kind of work.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RefineSeconds {
    /// Drawing the input views, and its gradient; with the loss where that is not known by itself.
    pub(crate) render: f64,
    /// The loss of the drawn views, and its gradient, as far as it is known by itself.
    pub(crate) loss: f64,
    /// Whether `render` holds the loss of some drawings, as on a GPU.
    pub(crate) loss_in_render: bool,
    /// The network.
    pub network: f64,
    /// Drawing the input views once more, for the lengths of the steps.
    pub(crate) lengths: f64,
}

impl RefineSeconds {
    /// Adds those of an objective.
    pub(super) fn add(&mut self, seconds: ObjectiveSeconds) {
        self.render += seconds.render;
        self.loss += seconds.loss.unwrap_or(0.0);
        self.loss_in_render |= seconds.loss.is_none();
    }

    /// Those of drawing the input views: for steps with their gradients, and for the lengths of the steps.
    pub fn drawing(&self) -> f64 {
        self.render + self.lengths
    }

    /// Those of the loss and its gradient; `None` where some of them are not known.
    pub fn loss_alone(&self) -> Option<f64> {
        (!self.loss_in_render).then_some(self.loss)
    }
}
