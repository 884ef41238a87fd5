//! Stage 2: the policy alone, on targets that were made before.

mod loss;
mod shards;

use candle_core::Tensor;
use lgs_engine::{
    densify::Thresholds,
    network::{config::ModelConfig, policy::Geometry, weights::TensorSpec},
    ops::tensors::of_rows,
    predict::{PolicyInputs, scores_of},
};
use lgs_targetgen::fidelity::rank_correlation;

pub use shards::{PolicyClip, Recompute, ShardClips, ShardOptions};

use super::{
    settings::PolicySettings,
    task::{Columns, Computed, Picture, Task},
    variables::Variables,
};
use crate::{
    error::{Result, TrainError},
    scenes::rng::Rng,
};
use loss::{Targets, loss, targets};

/// Tensors of the policy begin so.
const POLICY: &str = "policy.";
const PICTURES: &[Picture] = &[
    Picture { prefixes: &["loss"], title: "loss of the scores", file: "loss.svg" },
    Picture { prefixes: &["gradient"], title: "norm of the gradient", file: "gradient.svg" },
];

/// The policy, trained on the targets of clips.
#[derive(Debug)]
pub struct PolicyTask {
    clips: ShardClips,
    held_out: Vec<PolicyClip>,
    config: ModelConfig,
}

/// What a step of the policy is computed from.
#[derive(Debug)]
pub struct PolicySample {
    step: u64,
    /// `None` where there is nothing to score.
    inputs: Option<(Tensor, Geometry)>,
    targets: Targets,
}

impl PolicyTask {
    /// The task on some clips, of which at most `most_held_out` are measured on.
    ///
    /// # Errors
    /// A model without a policy; whatever is wrong with a clip that is held out.
    pub fn new(clips: ShardClips, most_held_out: usize, config: &ModelConfig) -> Result<Self> {
        if config.policy.is_none() {
            return Err(TrainError::config("policy", "a model with a policy", "one without"));
        }
        Ok(Self { held_out: clips.held_out(most_held_out)?, clips, config: config.clone() })
    }

    /// The features of a clip, `[N, width]`.
    fn features(&self, clip: &PolicyClip) -> Result<Tensor> {
        Ok(of_rows(clip.features.clone(), self.config.unet.width())?)
    }
}

impl Task for PolicyTask {
    type Settings = PolicySettings;
    type Sample = PolicySample;

    /// Never fails: what is held out was told apart when the shards were opened.
    fn check(&self) -> Result<()> {
        Ok(())
    }

    fn trains(&self, spec: &TensorSpec) -> bool {
        spec.name.starts_with(POLICY)
    }

    fn sample(&self, settings: &PolicySettings, step: u64) -> Result<PolicySample> {
        let seed = settings.optimisation.seed;
        let clip = self.clips.draw(seed, step)?;
        let chosen = around_one(&clip, settings.max_primitives, &mut Rng::new(seed, step));
        let mut place = vec![None; clip.set.len()];
        chosen.iter().enumerate().for_each(|(at, &i)| place[i] = Some(at));
        let Some(inputs) = PolicyInputs::new(&self.features(&clip)?, &clip.set, &chosen, &self.config)? else {
            return Ok(PolicySample { step, inputs: None, targets: Targets::default() });
        };
        let site = |i: usize| place[i].map(|at| inputs.points.segment_of()[at] as usize);
        let targets = targets(&clip.targets, settings.gamma, site);
        Ok(PolicySample { step, inputs: Some((inputs.rows, inputs.geometry)), targets })
    }

    fn compute(&self, variables: &Variables, settings: &PolicySettings, sample: PolicySample) -> Result<Computed> {
        let mut gradients = variables.zeros();
        let (Some((rows, geometry)), Some(policy)) = (sample.inputs, variables.model()?.policy) else {
            return Ok(Computed { values: vec![f64::NAN; 5], gradients, usable: false });
        };
        let num_sites = geometry.num_sites();
        let calibrates = sample.step < settings.optimisation.calibration;
        let scores = policy.scores(&rows, &geometry, calibrates)?;
        let values: Vec<[f32; 2]> = scores.flatten_all()?.to_vec1::<f32>()?.as_chunks::<2>().0.to_vec();
        let found = loss(&values, &sample.targets);
        let by_scores = of_rows(found.gradient.concat(), 2)?;
        variables.add_gradients(&(scores * by_scores)?.sum_all()?.backward()?, &mut gradients)?;
        let [prune, add] = found.values;
        let num_targets = sample.targets.iter().map(Vec::len).sum::<usize>();
        let values = vec![num_sites as f64, num_targets as f64, prune + add, prune, add];
        Ok(Computed { values, gradients, usable: num_targets > 0 && (prune + add).is_finite() })
    }

    fn columns(&self, _: &PolicySettings) -> Columns {
        let names = |names: &[&str]| names.iter().map(ToString::to_string).collect::<Vec<_>>();
        Columns {
            step: names(&["voxels", "targets", "loss", "loss_prune", "loss_add"]),
            validation: names(&["loss", "loss_of_half", "rank_prune", "rank_add", "above_prune", "above_add"]),
        }
    }

    fn score(&self, model: &Variables, settings: &PolicySettings) -> Result<Option<Vec<f64>>> {
        let Some(policy) = model.model()?.policy.filter(|_| !self.held_out.is_empty()) else { return Ok(None) };
        let policy = policy.fold()?;
        let mut sums = [0.0; 6];
        for clip in &self.held_out {
            let [prune, add] = scores_of(&self.features(clip)?, &clip.set, &policy, &self.config)?;
            let scores: Vec<[f32; 2]> = prune.iter().zip(&add).map(|(&p, &a)| [p, a]).collect();
            let found = measured(clip, &scores, settings.gamma);
            sums.iter_mut().zip(found).for_each(|(sum, v)| *sum += v);
        }
        Ok(Some(sums.iter().map(|sum| sum / self.held_out.len() as f64).collect()))
    }

    fn pictures(&self) -> &'static [Picture] {
        PICTURES
    }

    fn step_text(&self, _: &PolicySettings, values: &[f64]) -> String {
        match values {
            [voxels, _, all, prune, add] => format!("loss {all:.4} = {prune:.4} + {add:.4} ({voxels} voxels)"),
            _ => String::new(),
        }
    }

    fn score_text(&self, values: &[f64]) -> String {
        match values {
            [all, half, prune, add, above_prune, above_add] => format!(
                "loss {all:.4} (of scores of 1/2: {half:.4}), rank correlation prune {prune:.3} add {add:.3}, above 0.7: \
                 {:.1} % {:.1} %",
                100.0 * above_prune,
                100.0 * above_add
            ),
            _ => String::new(),
        }
    }
}

/// At most `most` primitives: those that lie nearest, seen from above, to one that has a target.
fn around_one(clip: &PolicyClip, most: usize, rng: &mut Rng) -> Vec<usize> {
    let n = clip.set.len();
    let mut chosen: Vec<usize> = (0..n).collect();
    if n <= most || clip.targets.index.is_empty() {
        chosen.truncate(most);
        return chosen;
    }
    let centre = clip.set.attributes[clip.targets.index[rng.index(clip.targets.index.len())] as usize];
    let distance = |&i: &usize| {
        let row = clip.set.attributes[i];
        let [x, y] = [0, 1].map(|k| f64::from(row[k]) - f64::from(centre[k]));
        x * x + y * y
    };
    chosen.select_nth_unstable_by(most, |a, b| distance(a).total_cmp(&distance(b)).then(a.cmp(b)));
    chosen.truncate(most);
    chosen.sort_unstable();
    chosen
}

/// Loss, loss of scores of 1/2, rank correlations of scores and targets, shares of scores above the thresholds of inference.
fn measured(clip: &PolicyClip, scores: &[[f32; 2]], gamma: f64) -> [f64; 6] {
    let targets = targets(&clip.targets, gamma, Some);
    let halves = vec![[0.5; 2]; scores.len()];
    let total = |scores: &[[f32; 2]]| loss(scores, &targets).values.iter().sum::<f64>();
    let rank = |a: usize| {
        let (found, wanted): (Vec<f64>, Vec<f64>) =
            targets[a].iter().map(|t| (f64::from(scores[t.at][a]), t.y)).unzip();
        rank_correlation(&found, &wanted).value
    };
    let Thresholds { prune, add } = Thresholds::default();
    let above =
        |a: usize, theta: f32| scores.iter().filter(|s| s[a] > theta).count() as f64 / scores.len().max(1) as f64;
    [total(scores), total(&halves), rank(0), rank(1), above(0, prune), above(1, add)]
}
