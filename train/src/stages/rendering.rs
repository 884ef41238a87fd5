//! The stages by the rendering loss: 1, and 3, in which the policy has its say.

use lgs_engine::network::weights::TensorSpec;

use super::{
    backbone::{Losses, Rendered, compute},
    clips::TrainingClip,
    frozen::FrozenPolicy,
    sample::{Sample, sample},
    settings::Settings,
    task::{Columns, Computed, Picture, Task, numbered},
    validate::{ValidationClip, mean_score},
    variables::Variables,
};
use crate::error::{Result, TrainError};

/// Tensors that these stages leave as they are begin so.
const POLICY: &str = "policy.";
/// Terms of the loss, in the order of their columns.
const TERMS: [&str; 4] = ["l1", "dissimilarity", "depth", "speed"];
/// Errors of velocities: how many primitives move, their error over their speed, the speed of what stands still.
const VELOCITIES: [&str; 3] = ["moving", "moving_error", "resting_speed"];
const PICTURES: &[Picture] = &[
    Picture { prefixes: &["inputs"], title: "loss of the input views", file: "loss_inputs.svg" },
    Picture { prefixes: &["targets"], title: "loss of the target views", file: "loss_targets.svg" },
    Picture {
        prefixes: &TERMS,
        title: "terms of the loss of the target views after the last step",
        file: "loss_terms.svg",
    },
    Picture { prefixes: &["moving_error", "resting_speed"], title: "errors of velocities", file: "velocities.svg" },
    Picture { prefixes: &["gradient"], title: "norm of the gradient", file: "gradient.svg" },
];

/// Prediction, query and refinement, trained by what they render.
#[derive(Debug)]
pub struct Rendering {
    /// Clips that the network learns from.
    pub clips: Vec<TrainingClip>,
    /// Clips that it is measured on.
    pub validation: Vec<ValidationClip>,
    /// The policy whose decisions are applied; `None`: random ones, as often as the settings say.
    pub policy: Option<FrozenPolicy>,
}

impl Task for Rendering {
    type Settings = Settings;
    type Sample = Sample;

    fn check(&self) -> Result<()> {
        let trained: Vec<String> = self.clips.iter().map(TrainingClip::identity).collect();
        match self.validation.iter().find(|clip| trained.contains(&clip.identity)) {
            Some(clip) => Err(TrainError::config("validation", "clips that are not trained on", &clip.identity)),
            None => Ok(()),
        }
    }

    fn trains(&self, spec: &TensorSpec) -> bool {
        !spec.name.starts_with(POLICY)
    }

    fn sample(&self, settings: &Settings, step: u64) -> Result<Sample> {
        sample(&self.clips, settings, step)
    }

    fn compute(&self, variables: &Variables, settings: &Settings, mut sample: Sample) -> Result<Computed> {
        let Rendered { losses, gradients, velocity, gaussians } =
            compute(variables, settings, self.policy.as_ref(), &mut sample)?;
        let finite = losses.iter().all(|l| l.inputs.is_finite() && l.targets.is_finite());
        let mut values: Vec<f64> = gaussians.iter().map(|&n| n as f64).collect();
        values.extend(losses.iter().map(|l: &Losses| l.inputs));
        values.extend(losses.iter().map(|l| l.targets));
        let last = losses.last().map(|l| l.terms).unwrap_or_default();
        values.extend([last.l1, last.dissimilarity, last.depth, last.speed]);
        values.extend([velocity.moving as f64, velocity.relative, velocity.resting_speed]);
        Ok(Computed { values, gradients, usable: finite && !sample.scene.is_empty() })
    }

    fn columns(&self, settings: &Settings) -> Columns {
        let states = |kind: &str| numbered(&format!("{kind}after"), settings.refine_steps);
        let names = |names: &[&str]| names.iter().map(ToString::to_string).collect::<Vec<_>>();
        Columns {
            step: [
                names(&["lidar", "background"]),
                states("inputs_"),
                states("targets_"),
                names(&TERMS),
                names(&VELOCITIES),
            ]
            .concat(),
            validation: [names(&["start"]), states("")].concat(),
        }
    }

    fn score(&self, model: &Variables, settings: &Settings) -> Result<Option<Vec<f64>>> {
        if self.validation.is_empty() {
            return Ok(None);
        }
        let model = model.model()?.fold()?;
        let score = mean_score(&self.validation, &model, settings.refine_steps, settings.update())?;
        Ok(Some([vec![score.start], score.after].concat()))
    }

    fn pictures(&self) -> &'static [Picture] {
        PICTURES
    }

    fn step_text(&self, settings: &Settings, values: &[f64]) -> String {
        let num_states = settings.refine_steps + 1;
        let targets: Vec<String> =
            values.iter().skip(2 + num_states).take(num_states).map(|l| format!("{l:.4}")).collect();
        let [lidar, background] = [0, 1].map(|k| values.get(k).copied().unwrap_or_default());
        format!("loss {} ({lidar} + {background} Gaussians)", targets.join(" "))
    }

    fn score_text(&self, values: &[f64]) -> String {
        let texts: Vec<String> = values.iter().map(|psnr| format!("{psnr:.2}")).collect();
        match texts.split_first() {
            Some((start, after)) => format!("{start} dB at the start, then {}", after.join(" ")),
            None => String::new(),
        }
    }
}
