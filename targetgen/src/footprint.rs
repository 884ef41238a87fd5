//! The footprint signal: how the loss changes under a primitive's own blending weights.

use lgs_engine::gaussians::physical::to_physical;
use lgs_engine::loss::{LossCounts, LossMap, loss_map};
use lgs_engine::render::{MAPS, Projection, RenderedWithState, blended_sums};

use crate::branches::{BEHIND, Problem, Round};

/// Changes under the weights of a round's chosen primitives.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RoundFootprints {
    /// `[chosen]` when all of them are removed.
    pub prune: Vec<f64>,
    /// `[chosen]` when all of them have a copy.
    pub add: Vec<f64>,
}

/// Changes of the loss under the weights that primitives have in the original branch; exactly zero for those that no pixel shows.
///
/// # Formula
/// `1/E sum_v sum_p w_i(p) (l_B(p) - l_1(p))`, l the loss as a map whose mean is a view's loss, E the mean loss of the original branch: in
/// pixels of average loss, whatever the loss is multiplied by.
pub fn footprints(problem: &Problem<'_>, rounds: &[Round]) -> Vec<RoundFootprints> {
    let splats = to_physical(problem.set);
    let mut sums: Vec<RoundFootprints> = rounds
        .iter()
        .map(|round| RoundFootprints { prune: vec![0.0; round.chosen.len()], add: vec![0.0; round.chosen.len()] })
        .collect();
    let drawn: Vec<Drawn> = (0..).zip(rounds).filter_map(|(r, round)| Drawn::new(r, round)).collect();
    let mut loss = 0.0;
    for view in problem.views {
        let counts = LossCounts::of(view);
        let base = Projection::new(&splats, &view.pinhole);
        let draw = |projection: Projection| projection.render(&view.pinhole, BEHIND);
        let map_of = |projection: Projection| loss_map(&draw(projection).images, view, &problem.weights, &counts);
        let original = draw(base.clone());
        let reference = loss_map(&original.images, view, &problem.weights, &counts);
        loss += reference.total / problem.views.len() as f64;
        let mut changes: Vec<Vec<f32>> = Vec::with_capacity(2 * rounds.len());
        for round in drawn.iter().map(|drawn| &rounds[drawn.round]) {
            let copies = &to_physical(&round.copies);
            changes.push(change(map_of(base.without(&round.removed)), &reference));
            changes.push(change(map_of(base.with(copies, splats.len(), &view.pinhole)), &reference));
        }
        add_blended(&original, &changes, &drawn, &mut sums);
    }
    if loss > 0.0 {
        sums.iter_mut().flat_map(|s| s.prune.iter_mut().chain(&mut s.add)).for_each(|change| *change /= loss);
    }
    sums
}

/// Not sampled in a round.
const ABSENT: u32 = u32::MAX;

/// A round that samples something.
struct Drawn {
    /// Its place among the rounds.
    round: usize,
    /// `[num_lidar]` place of each primitive among the chosen, or [`ABSENT`].
    place_of: Vec<u32>,
}

impl Drawn {
    fn new(round: usize, of: &Round) -> Option<Self> {
        let mut place_of = vec![ABSENT; of.removed.len()];
        (0..).zip(&of.chosen).for_each(|(place, &i)| place_of[i as usize] = place);
        (!of.chosen.is_empty()).then_some(Self { round, place_of })
    }
}

/// Adds the changes (prune and add of each drawn round) under the weights of the chosen primitives.
fn add_blended(original: &RenderedWithState, changes: &[Vec<f32>], drawn: &[Drawn], sums: &mut [RoundFootprints]) {
    for (drawn, changes) in drawn.chunks(MAPS / 2).zip(changes.chunks(MAPS)) {
        let maps: Vec<&[f32]> = changes.iter().map(Vec::as_slice).collect();
        let blended = blended_sums::<MAPS>(original, &maps);
        for (i, of_visible) in original.visible().zip(&blended) {
            for (drawn, [prune, add]) in drawn.iter().zip(of_visible.as_chunks().0) {
                if let Some(&place) = drawn.place_of.get(i).filter(|&&place| place != ABSENT) {
                    let sums = &mut sums[drawn.round];
                    sums.prune[place as usize] += prune;
                    sums.add[place as usize] += add;
                }
            }
        }
    }
}

fn change(branch: LossMap, original: &LossMap) -> Vec<f32> {
    let mut values = branch.values;
    values.iter_mut().zip(&original.values).for_each(|(value, before)| *value -= before);
    values
}
