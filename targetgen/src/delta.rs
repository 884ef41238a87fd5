//! From responses or footprints to one delta per sampled primitive and action.

use lgs_engine::gaussians::{Branch, GaussianSet};
use lgs_engine::ops::knn::{Neighbours, nearest_of, nearest_other_time_of};
use lgs_formats::targets::{Normalise, TargetsConfig};

use crate::branches::{BranchGradient, BranchGradients, Round, RoundGradients};
use crate::error::Result;
use crate::footprint::RoundFootprints;
use crate::response::responses;

/// What an action did to the surroundings of primitives; `None` where there is no information.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ActionDeltas {
    /// `[M]` of taking the primitive out.
    pub prune: Vec<Option<f64>>,
    /// `[M]` of a copy.
    pub add: Vec<Option<f64>>,
}

/// Deltas of every primitive that some round sampled.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Deltas {
    /// `[M]` the primitives, ascending.
    pub index: Vec<u32>,
    /// `[M]` rounds that sampled each.
    pub samples: Vec<u8>,
    /// Means over the rounds that have information.
    pub actions: ActionDeltas,
}

/// Neighbours of the sampled primitives: among all, and among those that their round leaves.
#[derive(Clone, Debug)]
pub struct NeighbourSets {
    /// Of every primitive that some round sampled, ascending, among all.
    originals: Neighbours,
    /// `[num_lidar]` row of each sampled primitive in `originals`.
    row_of: Vec<u32>,
    /// By round: of the chosen, in their order, among those that remain.
    remaining: Vec<Neighbours>,
}

impl NeighbourSets {
    /// The nearest primitives of the `LiDAR` branch by their means.
    ///
    /// # Errors
    /// When a position is not finite.
    pub fn new(set: &GaussianSet, rounds: &[Round], k: usize) -> Result<Self> {
        let points: Vec<[f32; 3]> = set.rows(Branch::Lidar).map(|i| set.mean(i)).collect();
        let mut row_of = vec![u32::MAX; points.len()];
        rounds.iter().flat_map(|round| &round.chosen).for_each(|&i| row_of[i as usize] = 0);
        let sampled: Vec<u32> = (0..).zip(&row_of).filter(|(_, row)| **row == 0).map(|(i, _)| i).collect();
        (0..).zip(&sampled).for_each(|(row, &i)| row_of[i as usize] = row);
        let remaining = |round: &Round| {
            // A primitive finds those of the other group only: a removed one those that remain.
            let groups: Vec<u32> = round.removed.iter().map(|&removed| u32::from(removed)).collect();
            nearest_other_time_of(&points, &groups, &round.chosen, k)
        };
        Ok(Self {
            originals: nearest_of(&points, &sampled, k)?,
            row_of,
            remaining: rounds.iter().map(remaining).collect::<std::result::Result<_, _>>()?,
        })
    }
}

/// Deltas of the response signal.
///
/// # Formula
/// `delta_prune_i = sum over i's K nearest that remain of (r_j^2 - r_j^1)`, `delta_add_i = sum over i's K nearest originals of
/// (r_j^3 - r_j^1)`; no information without a neighbour, and where every response involved is zero.
pub fn response_deltas(
    gradients: &BranchGradients,
    rounds: &[Round],
    neighbours: &NeighbourSets,
    config: &TargetsConfig,
) -> Vec<ActionDeltas> {
    let original = &gradients.original;
    let branch_responses = |branch: &BranchGradient| {
        let maxima = if config.normalise == Normalise::Branch { &branch.maxima } else { &original.maxima };
        responses(&branch.rows, maxima)
    };
    let before = branch_responses(original);
    let sum = |after: &[f64], around: &[u32]| {
        let pairs = || around.iter().map(|&j| (before[j as usize], after[j as usize]));
        let known = pairs().any(|(before, after)| before != 0.0 || after != 0.0);
        known.then(|| pairs().map(|(before, after)| after - before).sum())
    };
    let round_deltas = |((round, gradients), remaining): ((&Round, &RoundGradients), &Neighbours)| {
        let (without, with) = (branch_responses(&gradients.prune), branch_responses(&gradients.add));
        let prune = (0..round.chosen.len()).map(|place| sum(&without, remaining.of(place))).collect();
        let around = |&i: &u32| neighbours.originals.of(neighbours.row_of[i as usize] as usize);
        ActionDeltas { prune, add: round.chosen.iter().map(|i| sum(&with, around(i))).collect() }
    };
    rounds.iter().zip(&gradients.rounds).zip(&neighbours.remaining).map(round_deltas).collect()
}

/// Deltas of the magnitude signal: a large response asks for a copy, a small one to be pruned.
pub fn magnitude_deltas(original: &BranchGradient, rounds: &[Round]) -> Vec<ActionDeltas> {
    let response = responses(&original.rows, &original.maxima);
    let round_deltas = |round: &Round| {
        let known = round.chosen.iter().map(|&i| Some(response[i as usize]).filter(|&r| r != 0.0));
        let prune: Vec<Option<f64>> = known.collect();
        ActionDeltas { add: prune.iter().map(|r| r.map(|r| -r)).collect(), prune }
    };
    rounds.iter().map(round_deltas).collect()
}

/// Deltas of the footprint signal; no information where no pixel shows the primitive.
pub fn footprint_deltas(footprints: Vec<RoundFootprints>) -> Vec<ActionDeltas> {
    let known = |values: Vec<f64>| values.into_iter().map(|v| Some(v).filter(|&v| v != 0.0 && v.is_finite())).collect();
    footprints.into_iter().map(|f| ActionDeltas { prune: known(f.prune), add: known(f.add) }).collect()
}

/// Means over the rounds.
pub fn merge_rounds(rounds: &[Round], deltas: &[ActionDeltas]) -> Deltas {
    let n = rounds.iter().map(|round| round.removed.len()).max().unwrap_or(0);
    let mut samples = vec![0_u8; n];
    let mut sums = vec![[(0.0_f64, 0_u32); 2]; n];
    for (round, deltas) in rounds.iter().zip(deltas) {
        for ((&i, prune), add) in round.chosen.iter().zip(&deltas.prune).zip(&deltas.add) {
            samples[i as usize] = samples[i as usize].saturating_add(1);
            for (sum, delta) in sums[i as usize].iter_mut().zip([prune, add]) {
                if let Some(delta) = delta {
                    *sum = (sum.0 + delta, sum.1 + 1);
                }
            }
        }
    }
    let mut merged = Deltas::default();
    let mean = |(sum, count): (f64, u32)| (count > 0).then(|| sum / f64::from(count));
    for ((i, &count), sums) in (0..).zip(&samples).zip(&sums).filter(|((_, count), _)| **count > 0) {
        merged.index.push(i);
        merged.samples.push(count);
        merged.actions.prune.push(mean(sums[0]));
        merged.actions.add.push(mean(sums[1]));
    }
    merged
}
