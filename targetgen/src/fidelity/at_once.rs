//! The effect of single actions as soon as they are taken.

use lgs_engine::gaussians::physical::to_physical;
use lgs_engine::loss::{LossCounts, patch_change};
use lgs_engine::render::{Patch, Redraw, render_for_gradient};
use rayon::prelude::*;

use super::{Effects, Sample};
use crate::branches::{BEHIND, Problem};

/// By how much the mean loss over the views changes when one primitive is taken out, and when it alone has a copy. Only the tiles that it
/// touches are rendered.
pub fn at_once(problem: &Problem<'_>, sample: &Sample) -> Effects {
    let splats = to_physical(problem.set);
    let copies = to_physical(&sample.copies);
    let share = 1.0 / problem.views.len().max(1) as f64;
    let size = sample.chosen.len();
    let mut effects = Effects { prune: vec![0.0; size], add: vec![0.0; size] };
    for view in problem.views {
        let counts = LossCounts::of(view);
        let state = render_for_gradient(&splats, &view.pinhole, BEHIND);
        let redraw = Redraw::new(&state, &view.pinhole, splats.len());
        let change = |patch: Option<Patch>| {
            patch.map_or(0.0, |patch| patch_change(&state.images, &patch, view, &problem.weights, &counts))
        };
        let changes: Vec<[f64; 2]> = (0..size)
            .into_par_iter()
            .map(|k| [change(redraw.without(sample.chosen[k])), change(redraw.with(&copies[k]))])
            .collect();
        for (k, [prune, add]) in changes.into_iter().enumerate() {
            effects.prune[k] += share * prune;
            effects.add[k] += share * add;
        }
    }
    effects
}
