//! The branches of an intervention: rendered once more where a primitive is gone or has a copy, everything else kept.
//!
//! One evaluation of the original branch serves all rounds. Views come outside, branches inside: what a view's projection of the
//! unchanged primitives costs is paid once for all its branches.

use lgs_engine::gaussians::physical::{Splat, SplatGradient, to_physical, to_raw_gradient};
use lgs_engine::gaussians::{GaussianSet, MEAN, NUM_ATTRIBUTES};
use lgs_engine::loss::{LossWeights, image_loss};
use lgs_engine::render::{Projection, backward_visible};
use lgs_engine::views::View;
use lgs_formats::targets::{Signal, TargetsConfig};

use crate::response::{GradientRow, Maxima, zero_non_finite};
use crate::sample::{displacement, sampled};

/// Colour behind all Gaussians.
pub(crate) const BEHIND: [f32; 3] = [0.0; 3];

/// A predicted scene, the views that it is compared with, and how.
#[derive(Clone, Copy, Debug)]
pub struct Problem<'a> {
    /// The scene before the policy.
    pub set: &'a GaussianSet,
    /// The views.
    pub views: &'a [View],
    /// Weights of the rendering loss.
    pub weights: LossWeights,
}

/// One round: who is sampled, and the copies.
#[derive(Clone, Debug)]
pub struct Round {
    /// Sampled primitives, ascending.
    pub chosen: Vec<u32>,
    /// `[num_lidar]` whether each is sampled.
    pub removed: Vec<bool>,
    /// The copies of the chosen, in their order.
    pub copies: GaussianSet,
}

impl Round {
    /// The round of a clip's seed.
    pub fn new(set: &GaussianSet, config: &TargetsConfig, seed: u64, round: u8) -> Self {
        let removed = sampled(seed, round, set.num_lidar, config.rho);
        let chosen: Vec<u32> = (0..).zip(&removed).filter(|(_, removed)| **removed).map(|(i, _)| i).collect();
        let rows: Vec<usize> = chosen.iter().map(|&i| i as usize).collect();
        let mut copies = set.select(&rows, rows.len());
        for (row, &i) in copies.attributes.iter_mut().zip(&rows) {
            *row = copy_of(set, i, displacement(seed, round, i, config.noise_m));
        }
        Self { chosen, removed, copies }
    }

    /// All primitives of the `LiDAR` branch, without copies: for what needs no sampling.
    #[expect(clippy::cast_possible_truncation, reason = "a scene holds fewer than 2^32 Gaussians")]
    fn whole(set: &GaussianSet) -> Self {
        let chosen = (0..set.num_lidar as u32).collect();
        Self { chosen, removed: vec![true; set.num_lidar], copies: GaussianSet::default() }
    }

    /// The rounds of a clip's seed; one that has everything for the exact signal.
    pub fn all(set: &GaussianSet, config: &TargetsConfig, seed: u64) -> Vec<Self> {
        if config.signal == Signal::Exact {
            return vec![Self::whole(set)];
        }
        (0..config.rounds).map(|round| Self::new(set, config, seed, round)).collect()
    }
}

/// The attributes of a primitive, moved.
pub(crate) fn copy_of(set: &GaussianSet, i: usize, by: [f32; 3]) -> [f32; NUM_ATTRIBUTES] {
    let mut row = set.attributes[i];
    row[MEAN].iter_mut().zip(by).for_each(|(x, d)| *x += d);
    row
}

/// Gradients of a branch by the raw attributes of the `LiDAR` primitives, and the largest ones of the whole branch.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BranchGradient {
    /// `[num_lidar]`, indices of the original branch; zeros for the removed.
    pub rows: Vec<GradientRow>,
    /// Over every primitive of the branch, the background and the copies included.
    pub maxima: Maxima,
    /// Primitives whose gradient was not finite and was taken as zero.
    pub non_finite: usize,
}

/// Gradients of both interventions of a round.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RoundGradients {
    /// Of the branch without the sampled.
    pub prune: BranchGradient,
    /// Of the branch with their copies.
    pub add: BranchGradient,
}

/// Gradients of all branches.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BranchGradients {
    /// Of the original branch.
    pub original: BranchGradient,
    /// Of the rounds.
    pub rounds: Vec<RoundGradients>,
}

/// Gradients of the mean loss over the views, in all branches.
///
/// # Formula
/// `1/V sum_v L(v)`; the velocity term is left out: no attribute has a part in it.
pub fn branch_gradients(problem: &Problem<'_>, rounds: &[Round]) -> BranchGradients {
    let set = problem.set;
    let (splats, first_copy) = with_copies(set, rounds);
    let zeros = |len: usize| vec![SplatGradient::default(); len];
    let mut original = zeros(set.len());
    let mut sums: Vec<RoundSums> = rounds
        .iter()
        .map(|round| RoundSums { prune: zeros(set.len()), add: zeros(set.len()), copies: zeros(round.chosen.len()) })
        .collect();
    let share = 1.0 / problem.views.len() as f32;
    for view in problem.views {
        let base = Projection::new(&splats[..set.len()], &view.pinhole);
        let each_visible = |branch: Projection, add: &mut dyn FnMut(usize, &SplatGradient)| {
            let state = branch.render(&view.pinhole, BEHIND);
            let (_, by_image) = image_loss(&state.images, view, &problem.weights);
            let gradients = backward_visible(&splats, &view.pinhole, &state, &by_image);
            state.visible().zip(&gradients).for_each(|(i, gradient)| add(i, gradient));
        };
        for ((round, &first), sums) in rounds.iter().zip(&first_copy).zip(&mut sums) {
            if round.chosen.is_empty() {
                continue;
            }
            each_visible(base.without(&round.removed), &mut |i, g| sums.prune[i].add_scaled(g, share));
            let copies = &splats[first..first + round.chosen.len()];
            each_visible(base.with(copies, first, &view.pinhole), &mut |i, g| match i.checked_sub(first) {
                Some(copy) => sums.copies[copy].add_scaled(g, share),
                None => sums.add[i].add_scaled(g, share),
            });
        }
        each_visible(base, &mut |i, g| original[i].add_scaled(g, share));
    }
    let original = raw(set, &original);
    let finish = |(round, sums): (&Round, RoundSums)| {
        if round.chosen.is_empty() {
            return RoundGradients { prune: original.clone(), add: original.clone() };
        }
        let (prune, mut add, copies) = (raw(set, &sums.prune), raw(set, &sums.add), raw(&round.copies, &sums.copies));
        add.maxima = add.maxima.max(copies.maxima);
        add.non_finite += copies.non_finite;
        RoundGradients { prune, add }
    };
    let rounds = rounds.iter().zip(sums).map(finish).collect();
    BranchGradients { original, rounds }
}

/// Sums over the views of the gradients of a round's two branches.
struct RoundSums {
    /// `[N]` without the sampled.
    prune: Vec<SplatGradient>,
    /// `[N]` with their copies.
    add: Vec<SplatGradient>,
    /// `[chosen]` of the copies themselves.
    copies: Vec<SplatGradient>,
}

/// The set's primitives with the copies of all rounds behind them, and the place of each round's first.
fn with_copies(set: &GaussianSet, rounds: &[Round]) -> (Vec<Splat>, Vec<usize>) {
    let mut splats = to_physical(set);
    let mut first_copy = Vec::with_capacity(rounds.len());
    for round in rounds {
        first_copy.push(splats.len());
        splats.extend(to_physical(&round.copies));
    }
    (splats, first_copy)
}

/// The chain rule to the raw attributes, and the largest gradients.
fn raw(set: &GaussianSet, sums: &[SplatGradient]) -> BranchGradient {
    let (mut rows, _) = to_raw_gradient(set, sums);
    let non_finite = zero_non_finite(&mut rows);
    let maxima = Maxima::of(&rows);
    rows.truncate(set.num_lidar);
    BranchGradient { rows, maxima, non_finite }
}
