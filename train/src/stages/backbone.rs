//! The rendering loss and its gradient: prediction, query and refinement (stage 1), with the policy's decisions between them (stage 3).
//!
//! The scene is rendered after the prediction and after every refinement step. What these renderings say is used twice: the gradient of the
//! input views is the next step's input, and the gradient of input and target views together is the loss gradient of the pass that
//! has just run. Inputs of a refinement step are constants, so every pass is supervised on its own and its memory is freed.

use candle_core::backprop::GradStore;
use lgs_engine::{
    densify::{self, Action, Limit, Scope},
    evidence::survivors,
    gaussians::{Branch, GaussianSet, NUM_ATTRIBUTES, RawGradient},
    loss::LossWeights,
    network::{
        config::{Guidance, ModelConfig, StepLength},
        normalise::residual_gradients,
    },
    objective::{Objective, Terms, Wanted, objective, objective_with},
    predict::add_outputs,
    refine::{lengthen, step_lengths, wanted, zero_non_finite_guide},
    render::Device,
    views::View,
};
use rayon::prelude::*;

use super::{
    frozen::FrozenPolicy,
    passes::{Outcome, Passes},
    sample::Sample,
    settings::{RunSettings, Settings},
    variables::{Values, Variables},
};
use crate::{
    error::Result,
    scenes::{maths::narrow, rng::Rng},
    velocity::{TrueVelocities, VelocityErrors},
};

/// Largest shares of primitives that a perturbation prunes and copies.
const PERTURBED: [f64; 2] = [0.1, 0.25];
/// Least and largest percentage of a scene that pruning by exact effects leaves.
const PRUNED_TO: [f64; 2] = [35.0, 95.0];

/// Losses of a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Losses {
    /// Over the input views.
    pub inputs: f64,
    /// Over the target views; that of the input views where there is none.
    pub targets: f64,
    /// Terms of the loss over the target views.
    pub terms: Terms,
}

/// What a step computed.
#[derive(Clone, Debug)]
pub struct Rendered {
    /// After the prediction and after every refinement step.
    pub losses: Vec<Losses>,
    /// By all tensors.
    pub gradients: Values,
    /// Errors of the velocities after the last step, as far as the truth is known.
    pub velocity: VelocityErrors,
    /// Gaussians of the `LiDAR` branch and of the background.
    pub gaussians: [usize; 2],
}

/// Losses and gradients of one sample.
///
/// # Errors
/// When a position leaves the voxel grid.
pub fn compute(
    variables: &Variables,
    settings: &Settings,
    policy: Option<&FrozenPolicy>,
    sample: &mut Sample,
) -> Result<Rendered> {
    let model = variables.model()?;
    let batch_statistics = settings.calibrates(sample.step);
    let passes = Passes { model: &model, batch_statistics };
    let mut gradients = variables.zeros();
    let (inputs, targets): (Vec<&View>, Vec<&View>) = (sample.inputs.iter().collect(), sample.targets.iter().collect());
    let config = variables.config();
    let look = |set: &GaussianSet, truth: Option<&TrueVelocities>| {
        let mut looked = Looked::at(set, [&inputs, &targets], settings, config);
        if let Some(truth) = truth {
            let gradient = truth.gradient(set, settings.velocity);
            let velocities = looked.gradient.velocities.iter_mut().zip(&gradient);
            velocities.for_each(|(sum, g)| sum.iter_mut().zip(g).for_each(|(s, g)| *s += g));
        }
        looked
    };

    let start = &sample.scene;
    let outcomes = outcomes(|branch| passes.initial(start, branch))?;
    let updated = updated(start, &outcomes)?;
    // What is not finite has to be seen in the loss, so that the step changes nothing.
    let limit = pruned_to(settings, &mut sample.rng).filter(|_| updated.check_finite().is_ok());
    let perturbed = match limit {
        Some(limit) => Perturbed::pruned(&updated, &inputs, limit),
        None => {
            let actions = match policy {
                Some(policy) => policy.actions(&outcomes, &updated, settings)?,
                None => at_random(&updated, settings, &mut sample.rng),
            };
            Perturbed::by(&updated, actions, &mut sample.rng)?
        }
    };
    let truth = sample.velocities.take().map(|truth| match &perturbed.sources {
        Some(sources) => truth.of_sources(&sources[..perturbed.set.num_lidar]),
        None => truth,
    });
    let mut looked = look(&perturbed.set, truth.as_ref());
    let mut losses = vec![looked.losses];
    carry_back(variables, start, &outcomes, &perturbed.pulled_back(&looked.gradient, start.len()), &mut gradients)?;

    let mut set = perturbed.set;
    for _ in 0..settings.refine_steps {
        zero_non_finite_guide(&mut looked.inputs, config.guidance);
        let before = &looked.inputs;
        let outcomes = self::outcomes(|branch| passes.refine(&set, before, branch))?;
        let mut next = self::updated(&set, &outcomes)?;
        let local = config.step_length == StepLength::Local;
        let lengths = local.then(|| step_lengths(Device::Cpu, &before.images, &next, &inputs));
        if let Some(lengths) = &lengths {
            lengthen(&mut next, &set, lengths);
        }
        looked = look(&next, truth.as_ref());
        losses.push(looked.losses);
        let gradient = along_steps(std::mem::take(&mut looked.gradient), &lengths.unwrap_or_default());
        carry_back(variables, &set, &outcomes, &gradient, &mut gradients)?;
        set = next;
    }
    let velocity = truth.map(|truth| truth.errors(&set)).unwrap_or_default();
    Ok(Rendered { losses, gradients, velocity, gaussians: [set.num_lidar, set.len() - set.num_lidar] })
}

/// The outcomes of both branches, which run side by side: one's serial parts do not hold up the other.
fn outcomes(run: impl Fn(Branch) -> Result<Option<Outcome>> + Sync) -> Result<Vec<Outcome>> {
    let [first, second] = Branch::ALL;
    let (first, second) = rayon::join(|| run(first), || run(second));
    Ok([first?, second?].into_iter().flatten().collect())
}

fn updated(set: &GaussianSet, outcomes: &[Outcome]) -> Result<GaussianSet> {
    let mut updated = set.clone();
    for outcome in outcomes {
        // Seen in the loss, so that the step changes nothing.
        let left_out = add_outputs(&mut updated, &outcome.chosen, &outcome.outputs)?;
        for i in left_out.not_finite.into_iter().chain(left_out.carried_away) {
            (updated.attributes[i], updated.velocities[i]) = ([f32::NAN; NUM_ATTRIBUTES], [f32::NAN; 3]);
        }
    }
    Ok(updated)
}

/// Gradients by steps of these lengths, which are constants, from those by where they end.
fn along_steps(mut gradient: RawGradient, lengths: &[f32]) -> RawGradient {
    let rows = gradient.attributes.iter_mut().zip(&mut gradient.velocities).zip(lengths);
    rows.for_each(|((attributes, velocity), length)| attributes.iter_mut().chain(velocity).for_each(|g| *g *= length));
    gradient
}

/// Adds the gradients by the parameters of the passes that made `outcomes`.
fn carry_back(
    variables: &Variables,
    before: &GaussianSet,
    outcomes: &[Outcome],
    gradient: &RawGradient,
    sums: &mut Values,
) -> Result<()> {
    let back = |outcome: &Outcome| {
        let v_outputs = residual_gradients(before, &outcome.chosen, gradient, outcome.width()?);
        Ok(outcome.carry(v_outputs)?.backward()?)
    };
    let stores: Vec<Result<GradStore>> = outcomes.par_iter().map(back).collect();
    stores.into_iter().try_for_each(|store| variables.add_gradients(&store?, sums))
}

/// A scene as the views see it.
struct Looked {
    losses: Losses,
    /// Of the input views.
    inputs: Objective,
    /// Of the loss that is trained.
    gradient: RawGradient,
}

impl Looked {
    fn at(set: &GaussianSet, [inputs, targets]: [&[&View]; 2], settings: &Settings, config: &ModelConfig) -> Self {
        let guidance = config.guidance;
        let weights = LossWeights { psnr: narrow(settings.psnr), ..LossWeights::default() };
        let mut by_inputs = objective_with(set, inputs, &weights, Wanted { gradient: true, ..wanted(config) });
        let trained = match guidance {
            Guidance::Residual => std::mem::take(&mut by_inputs.gradient),
            Guidance::Gradient => by_inputs.gradient.clone(),
        };
        if guidance == Guidance::Gradient && settings.psnr > 0.0 {
            // What guides the network is the gradient of the loss as inference knows it.
            by_inputs.gradient = objective(set, inputs, &LossWeights::default()).gradient;
        }
        if targets.is_empty() {
            let losses = Losses { inputs: by_inputs.loss, targets: by_inputs.loss, terms: by_inputs.terms };
            return Self { losses, gradient: trained, inputs: by_inputs };
        }
        let by_targets = objective(set, targets, &weights);
        let losses = Losses { inputs: by_inputs.loss, targets: by_targets.loss, terms: by_targets.terms };
        let gradient = mixed(&trained, &by_targets.gradient, narrow(settings.target_share));
        Self { losses, inputs: by_inputs, gradient }
    }
}

/// `(1 - share) a + share b`.
fn mixed(a: &RawGradient, b: &RawGradient, share: f32) -> RawGradient {
    fn mix<const D: usize>(a: &[[f32; D]], b: &[[f32; D]], share: f32) -> Vec<[f32; D]> {
        let rows = a.iter().zip(b);
        rows.map(|(a, b)| std::array::from_fn(|k| (1.0 - share) * a[k] + share * b[k])).collect()
    }
    RawGradient {
        attributes: mix(&a.attributes, &b.attributes, share),
        velocities: mix(&a.velocities, &b.velocities, share),
    }
}

/// A set after an update, and where its primitives come from.
struct Perturbed {
    set: GaussianSet,
    /// `[N]` index in the set before; `None` when nothing was changed.
    sources: Option<Vec<usize>>,
}

impl Perturbed {
    fn by(set: &GaussianSet, actions: Option<Vec<Action>>, rng: &mut Rng) -> Result<Self> {
        let Some(actions) = actions else { return Ok(Self { set: set.clone(), sources: None }) };
        let sources = densify::origins(&actions).into_iter().chain(set.num_lidar..set.len()).collect();
        Ok(Self { set: densify::apply(set, &actions, u64::from(rng.bits()))?, sources: Some(sources) })
    }

    /// What is left when a scene is pruned by exact effects.
    fn pruned(set: &GaussianSet, views: &[&View], limit: Limit) -> Self {
        let sources = survivors(set, views, (Scope::All, Some(limit)), Device::Cpu, &mut || ());
        let num_lidar = sources.partition_point(|&i| i < set.num_lidar);
        Self { set: set.select(&sources, num_lidar), sources: Some(sources) }
    }

    /// The gradient by the primitives before the update: a copy's is added to that of its source.
    fn pulled_back(&self, gradient: &RawGradient, num_before: usize) -> RawGradient {
        let Some(sources) = &self.sources else { return gradient.clone() };
        let mut sums = RawGradient { attributes: vec![[0.0; 14]; num_before], velocities: vec![[0.0; 3]; num_before] };
        for (at, &source) in sources.iter().enumerate() {
            sums.attributes[source].iter_mut().zip(gradient.attributes[at]).for_each(|(s, g)| *s += g);
            sums.velocities[source].iter_mut().zip(gradient.velocities[at]).for_each(|(s, g)| *s += g);
        }
        sums
    }
}

/// How much pruning by exact effects leaves, in a share of the steps; `None`: there is none.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between the two percentages")]
fn pruned_to(settings: &Settings, rng: &mut Rng) -> Option<Limit> {
    let [least, most] = PRUNED_TO;
    let pruned = settings.pruned > 0.0 && rng.chance(settings.pruned);
    pruned.then(|| Limit::Percent(rng.uniform(least, most) as u32))
}

/// Actions at random in a share of the steps, so that the refinement knows sets that a policy has changed; `None`: no change.
fn at_random(set: &GaussianSet, settings: &Settings, rng: &mut Rng) -> Option<Vec<Action>> {
    if !rng.chance(settings.perturbed) || set.num_lidar == 0 {
        return None;
    }
    let [prune, copy] = PERTURBED.map(|most| rng.uniform(0.0, most));
    let action = |rng: &mut Rng| match rng.unit() {
        u if u < prune => Action::Prune,
        u if u < prune + copy => Action::Copy,
        _ => Action::Keep,
    };
    Some((0..set.num_lidar).map(|_| action(rng)).collect())
}
