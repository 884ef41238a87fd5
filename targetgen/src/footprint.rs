//! The footprint signal: how the loss changes under a primitive's own blending weights.

use lgs_engine::gaussians::physical::to_physical;
use lgs_engine::loss::{LossCounts, LossMap, loss_map};
use lgs_engine::render::{Projection, blended_sums};

use crate::branches::{BEHIND, Problem, Round, extended};

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
        for round in rounds.iter().filter(|round| !round.chosen.is_empty()) {
            let copies = &extended(&[], &round.copies);
            changes.push(change(map_of(base.without(&round.removed)), &reference));
            changes.push(change(map_of(base.with(copies, splats.len(), &view.pinhole)), &reference));
        }
        let maps: Vec<&[f32]> = changes.iter().map(Vec::as_slice).collect();
        let blended = blended_sums(&original, &maps, splats.len());
        let drawn = rounds.iter().zip(&mut sums).filter(|(round, _)| !round.chosen.is_empty());
        for ((round, sums), blended) in drawn.zip(blended.chunks_exact(2)) {
            for (k, &i) in round.chosen.iter().enumerate() {
                sums.prune[k] += blended[0][i as usize];
                sums.add[k] += blended[1][i as usize];
            }
        }
    }
    if loss > 0.0 {
        sums.iter_mut().flat_map(|s| s.prune.iter_mut().chain(&mut s.add)).for_each(|change| *change /= loss);
    }
    sums
}

fn change(branch: LossMap, original: &LossMap) -> Vec<f32> {
    let mut values = branch.values;
    values.iter_mut().zip(&original.values).for_each(|(value, before)| *value -= before);
    values
}
