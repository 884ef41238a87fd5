//! The exact signal: what taking a primitive out does to the loss by itself, and what its halves could gain.

use lgs_engine::evidence::Evidence;
use lgs_engine::views::View;

use crate::branches::{Problem, Round};
use crate::delta::ActionDeltas;

/// Deltas of every primitive of the `LiDAR` branch; `None` for those that no pixel shows.
///
/// # Shapes
/// Both `[num_lidar]`.
///
/// # Formula
/// Of the pixels P of all views: `delta_prune = P removal / E`, the change of the mean loss over the views without the primitive in pixels of
/// average loss E; `delta_add = -gain / S`, by how much its halves' colours fit the squared errors better than its own does, in pixels of
/// average squared error S.
///
/// # Source
/// [`Evidence`].
pub fn exact(problem: &Problem<'_>) -> ActionDeltas {
    let views: Vec<&View> = problem.views.iter().collect();
    let evidence = Evidence::of(problem.set, &views, &problem.weights);
    let pixels: f64 = views.iter().map(|view| view.pinhole.num_pixels() as f64).sum();
    let per_loss = if evidence.loss > 0.0 { pixels / evidence.loss } else { 0.0 };
    let per_square = if evidence.squared_error > 0.0 { 1.0 / evidence.squared_error } else { 0.0 };
    let shown = evidence.effects.iter().zip(evidence.gains()).take(problem.set.num_lidar);
    let (prune, add) = shown
        .map(|(effect, gain)| {
            let known = |value: f64| Some(value).filter(|value| effect.shown > 0.0 && value.is_finite());
            (known(effect.removal * per_loss), known(-gain * per_square))
        })
        .unzip();
    ActionDeltas { prune, add }
}

/// The deltas of the primitives that each round chose.
pub fn of_rounds(exact: &ActionDeltas, rounds: &[Round]) -> Vec<ActionDeltas> {
    let at = |all: &[Option<f64>], round: &Round| round.chosen.iter().map(|&i| all[i as usize]).collect();
    rounds.iter().map(|round| ActionDeltas { prune: at(&exact.prune, round), add: at(&exact.add, round) }).collect()
}
