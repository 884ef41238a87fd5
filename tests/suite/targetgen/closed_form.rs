//! Scenes whose signs are known by reasoning.
//!
//! A response is a share of the largest gradient, so with few primitives the largest one is 1 by definition, before and after, and hides
//! everything. Every scene therefore has a holder: one primitive far from the others in space and in the image, out of reach of what is
//! done to them, whose gradients are the largest in every attribute. It keeps the maxima, so that the responses of all others rise and fall with
//! their gradients.

use lgs_engine::gaussians::NUM_ATTRIBUTES;
use lgs_engine::gaussians::physical::to_physical;
use lgs_engine::loss::LossWeights;
use lgs_engine::render::render;
use lgs_engine::views::View;
use lgs_formats::targets::Signal;
use lgs_targetgen::branches::{Problem, Round, branch_gradients};
use lgs_targetgen::delta::{ActionDeltas, NeighbourSets, footprint_deltas, response_deltas};
use lgs_targetgen::footprint::footprints;
use lgs_targetgen::reference;
use lgs_tests::{Outcome, case};
use libtest_mimic::Trial;

use super::problems::{HEIGHT, Made, WIDTH, camera, config, row, set_of, view};

const RED: [f32; 3] = [0.95, 0.05, 0.05];
const UPRIGHT: [f32; 4] = [1.0, 0.0, 0.0, 0.0];
/// Place of the primitive that is acted on.
const CENTRE: usize = 12;

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("targetgen::closed_form::half_transparent_surface", half_transparent_surface),
        case("targetgen::closed_form::wrong_colour", wrong_colour),
    ]
}

/// A patch of 5 x 5 primitives at the left of the image, nearer and farther in turns, and the holder at the right.
fn patch(opacity: f32, colour_of: impl Fn(usize) -> [f32; 3]) -> Vec<[f32; NUM_ATTRIBUTES]> {
    let member = |k: usize| {
        let (column, line) = ((k % 5) as f32, (k / 5) as f32);
        let mean = [-1.4 + 0.15 * column, -0.3 + 0.15 * line, 4.0 + 0.05 * ((3 * k) % 5) as f32];
        row(mean, UPRIGHT, [0.15; 3], opacity, colour_of(k))
    };
    let holder = row([1.2, 0.1, 4.0], [1.0, 0.3, 0.4, 0.5], [0.1, 0.25, 0.4], 0.5, [0.5; 3]);
    (0..25).map(member).chain([holder]).collect()
}

/// Views from the right, from where the patch is outside the image: the holder is too dark but in one quarter, where it is too bright.
fn holder_views() -> impl Iterator<Item = View> {
    let truth = |pixel: usize| if pixel % WIDTH > 20 && pixel / WIDTH > 21 { [0.0; 3] } else { [0.9, 0.8, 0.7] };
    (0..12).map(move |_| view(camera(2.0), (0..WIDTH * HEIGHT).flat_map(truth).collect(), Vec::new()))
}

/// Deltas of both signals of the centre alone: fast path, after it was compared with the twin.
fn centre_deltas(made: &Made) -> Result<[ActionDeltas; 2], String> {
    // Without similarity: its windows would mix a pixel's own error with its neighbourhood's contrast.
    let weights = LossWeights { l1: 1.0, ssim: 0.0, depth: 0.0, velocity: 0.0, psnr: 0.0 };
    let problem: Problem<'_> = made.problem(weights);
    let config = config(Signal::Response);
    let mut round = Round::new(&made.set, &lgs_formats::targets::TargetsConfig { rho: 1.0, ..config.clone() }, 5, 0);
    let keep = |k: usize| k == CENTRE;
    round.copies.attributes = vec![round.copies.attributes[CENTRE]];
    round.copies.times.truncate(1);
    round.copies.frames.truncate(1);
    round.copies.velocities.truncate(1);
    round.copies.num_lidar = 1;
    round.chosen = vec![12];
    (0..round.removed.len()).for_each(|k| round.removed[k] = keep(k));
    let rounds = [round];
    let neighbours = NeighbourSets::new(&made.set, &rounds, config.neighbours).map_err(|e| e.to_string())?;
    let gradients = branch_gradients(&problem, &rounds);
    let held = gradients.original.maxima;
    for branch in [&gradients.rounds[0].prune, &gradients.rounds[0].add] {
        let moved = held.0.iter().zip(&branch.maxima.0).any(|(a, b)| (a - b).abs() > 1e-3 * a);
        if moved || held.0.contains(&0.0) {
            return Err(format!("the holder does not hold the maxima: {held:?} {:?}", branch.maxima));
        }
    }
    let response = response_deltas(&gradients, &rounds, &neighbours, &config).remove(0);
    let footprint = footprint_deltas(footprints(&problem, &rounds)).remove(0);
    for (signal, got) in [(Signal::Response, &response), (Signal::Footprint, &footprint)] {
        let config = lgs_formats::targets::TargetsConfig { signal, ..config.clone() };
        let twin = reference::deltas(&problem, &rounds, &config).remove(0);
        for (got, want) in [(&got.prune, &twin.prune), (&got.add, &twin.add)] {
            match (got[0], want[0]) {
                (Some(g), Some(w)) if (g - w).abs() < 1e-5 * (1.0 + w.abs()) => {}
                other => return Err(format!("{signal:?}: fast path and twin are {other:?}")),
            }
        }
    }
    Ok([response, footprint])
}

fn expect_signs(deltas: &[ActionDeltas; 2], prune: f64, add: Option<f64>) -> Outcome {
    for (name, found) in ["response", "footprint"].iter().zip(deltas) {
        let fits = |delta: Option<f64>, sign: f64| delta.is_some_and(|delta| delta * sign > 1e-6);
        if !fits(found.prune[0], prune) || !add.is_none_or(|sign| fits(found.add[0], sign)) {
            return Err(format!("{name}: {found:?}, want signs {prune} and {add:?}").into());
        }
    }
    Ok(())
}

/// The truth is red; the surface is red too but lets half of a blue background through. Everywhere the picture is not red enough, so every
/// gradient of a surface primitive says "cover more" and is as large as the contrast to what it still lets through. A copy of the
/// centre covers some of the blue: its neighbours have less left to gain, their responses fall, and the loss with them. Without
/// the centre more blue shows: responses and loss rise.
fn half_transparent_surface() -> Outcome {
    let mut rows = patch(0.5, |_| RED);
    let num_lidar = rows.len();
    rows.push(row([-1.1, 0.0, 6.0], UPRIGHT, [0.9, 0.9, 0.1], 0.99, [0.05, 0.05, 0.95]));
    let truth = (0..WIDTH * HEIGHT).flat_map(|_| RED).collect();
    let made = Made {
        set: set_of(rows, num_lidar),
        views: std::iter::once(view(camera(0.0), truth, Vec::new())).chain(holder_views()).collect(),
    };
    expect_signs(&centre_deltas(&made)?, 1.0, Some(-1.0))
}

/// The truth is what is drawn when the centre is not there; the centre is green where all others are red. It alone is what is wrong in the
/// patch: without it nothing pulls at its neighbours any more, their responses fall to nothing, and so does the loss below it.
fn wrong_colour() -> Outcome {
    let rows = patch(0.7, |k| if k == CENTRE { [0.05, 0.95, 0.05] } else { RED });
    let num_lidar = rows.len();
    let mut right = rows.clone();
    right.remove(CENTRE);
    let truth = render(&to_physical(&set_of(right, num_lidar - 1)), &camera(0.0), [0.0; 3]).rgb;
    let made = Made {
        set: set_of(rows, num_lidar),
        views: std::iter::once(view(camera(0.0), truth, Vec::new())).chain(holder_views()).collect(),
    };
    expect_signs(&centre_deltas(&made)?, -1.0, None)
}
