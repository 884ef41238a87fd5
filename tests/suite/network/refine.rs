//! What the refinement leaves out, and that the result is what it would be without leaving it out.

use std::sync::Arc;

use candle_core::Tensor;
use lgs_engine::gaussians::GaussianSet;
use lgs_engine::objective::objective;
use lgs_engine::ops::knn::nearest_other_time;
use lgs_engine::predict::{QuerySkipped, backbone, query};
use lgs_engine::refine::{LastStep, RefineSettings, RefineSummary, refine};
use lgs_engine::views::View;
use lgs_tests::compare::same_bits;
use lgs_tests::random::Random;
use lgs_tests::weights::{Heads, SMALL, Weights};
use lgs_tests::{Outcome, case};
use libtest_mimic::{Failed, Trial};

use super::scene::{scene, view};

/// Steps so small that they follow the slope and move nothing out of its voxel.
const SMALL_STEP: f32 = 2e-5;

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("network::refine::kept_pyramids_change_nothing", kept_pyramids_change_nothing),
        case("network::refine::pyramids_are_made_again_when_something_moved", pyramids_are_made_again),
        case("network::refine::what_no_view_shows_stays_and_matters_to_nobody", unseen_ones_stay),
        case("network::refine::a_step_that_does_not_help_is_taken_back_and_the_last", early_stop),
        case("network::refine::what_follows_gets_loss_and_gradient_of_the_result", kept_for_what_follows),
        case("network::refine::zero_heads_end_it_without_a_second_look", zero_heads),
        case("network::refine::nothing_to_do", nothing_to_do),
        case("network::refine::same_bits_for_any_number_of_threads", same_for_any_threads),
        case("network::query_of_a_single_timestamp_would_change_nothing", single_timestamp),
    ]
}

fn failed(error: impl std::fmt::Display) -> Failed {
    error.to_string().into()
}

/// A scene with a background of a few Gaussians, and its view.
fn start() -> (GaussianSet, View) {
    let mut random = Random::new(7);
    let mut set = scene(&mut random);
    set.num_lidar -= 30;
    (set, view(&mut random))
}

/// Two models, of which the first makes the scene better and the second worse. They leave velocities alone: at rest any
/// velocity costs the same, in either direction.
fn better_and_worse(spread: f32) -> Result<[Weights; 2], Failed> {
    let mut forward = Weights::seeded(SMALL, 5, Heads { residuals: spread, scores: 0.0 })?;
    for (name, tensor) in &mut forward.tensors {
        if name.contains("heads.velocity") {
            *tensor = tensor.zeros_like().map_err(failed)?;
        }
    }
    let backward = forward.backwards()?;
    let helps = |weights: &Weights| -> Result<bool, Failed> { Ok(!refined(weights, 1)?.1.stopped_early) };
    match (helps(&forward)?, helps(&backward)?) {
        (true, false) => Ok([forward, backward]),
        (false, true) => Ok([backward, forward]),
        both => Err(format!("expected that one direction helps and the other does not, found {both:?}").into()),
    }
}

fn refined(weights: &Weights, steps: usize) -> Result<(GaussianSet, RefineSummary), Failed> {
    let (mut set, view) = start();
    let summary = refine(&mut set, &[&view], &weights.model()?, steps, || ()).map_err(failed)?;
    Ok((set, summary))
}

fn same_sets(got: &GaussianSet, want: &GaussianSet) -> Outcome {
    same_bits("attributes", got.attributes.as_flattened(), want.attributes.as_flattened())?;
    same_bits("velocities", got.velocities.as_flattened(), want.velocities.as_flattened())?;
    same_bits("times", &got.times, &want.times)
}

fn expect(what: &str, holds: bool, summary: &RefineSummary) -> Outcome {
    if holds { Ok(()) } else { Err(format!("expected {what}, found {summary:?}").into()) }
}

/// Three steps at once keep the voxel pyramids; three runs of one step make them every time.
fn kept_pyramids_change_nothing() -> Outcome {
    let [better, _] = better_and_worse(SMALL_STEP)?;
    let (kept, summary) = refined(&better, 3)?;
    expect("3 steps and 2 pyramids kept", summary.steps == 3 && summary.pyramids_kept == 2, &summary)?;
    let ((mut set, view), model) = (start(), better.model()?);
    for _ in 0..3 {
        let summary = refine(&mut set, &[&view], &model, 1, || ()).map_err(failed)?;
        expect("no pyramid kept", summary.pyramids_kept == 0, &summary)?;
    }
    same_sets(&kept, &set)
}

/// As above with steps that carry primitives into other voxels.
fn pyramids_are_made_again() -> Outcome {
    for spread in [0.1, 0.05, 0.02, 0.01] {
        let Ok([better, _]) = better_and_worse(spread) else { continue };
        let (twice, summary) = refined(&better, 2)?;
        if summary.steps < 2 || summary.pyramids_kept > 0 {
            continue;
        }
        let ((mut set, view), model) = (start(), better.model()?);
        for _ in 0..2 {
            refine(&mut set, &[&view], &model, 1, || ()).map_err(failed)?;
        }
        return same_sets(&twice, &set);
    }
    Err("no spread made two helpful steps out of the voxels".into())
}

/// Gaussians behind the camera, beside those of the scene and without them.
fn unseen_ones_stay() -> Outcome {
    const UNSEEN: usize = 40;
    let [better, _] = better_and_worse(SMALL_STEP)?;
    let (alone, summary) = refined(&better, 1)?;
    expect("all of them seen", summary.unseen == 0 && summary.steps == 1, &summary)?;
    let (mut set, view) = start();
    let mut behind = GaussianSet { num_lidar: UNSEEN, ..GaussianSet::default() };
    for i in 0..UNSEEN {
        let mut row = set.attributes[i];
        row[2] = -row[2];
        behind.attributes.push(row);
        behind.times.push(0.0);
        behind.frames.push(0);
        behind.velocities.push([0.0; 3]);
    }
    set.attributes.splice(0..0, behind.attributes.iter().copied());
    set.times.splice(0..0, behind.times.iter().copied());
    set.frames.splice(0..0, behind.frames.iter().copied());
    set.velocities.splice(0..0, behind.velocities.iter().copied());
    set.num_lidar += UNSEEN;
    let summary = refine(&mut set, &[&view], &better.model()?, 1, || ()).map_err(failed)?;
    expect("40 unseen", summary.unseen == UNSEEN && summary.steps == 1, &summary)?;
    let part = |range: std::ops::Range<usize>, num_lidar: usize| GaussianSet {
        attributes: set.attributes[range.clone()].to_vec(),
        times: set.times[range.clone()].to_vec(),
        frames: set.frames[range.clone()].to_vec(),
        velocities: set.velocities[range].to_vec(),
        num_lidar,
    };
    same_sets(&part(0..UNSEEN, UNSEEN), &behind)?;
    same_sets(&part(UNSEEN..set.len(), alone.num_lidar), &alone)
}

fn early_stop() -> Outcome {
    let [_, worse] = better_and_worse(SMALL_STEP)?;
    let (start, view) = start();
    let (stopped, summary) = refined(&worse, 3)?;
    let rose = summary.losses.len() == 2 && summary.losses[1] >= summary.losses[0];
    expect("an early stop after a rise", summary.stopped_early && summary.steps == 0 && rose, &summary)?;
    same_sets(&stopped, &start)?;
    let loss = objective(&stopped, &[&view], &lgs_engine::loss::LossWeights::default()).loss;
    expect("the loss of the result", loss == summary.losses[0], &summary)
}

/// A last step that is kept anyhow is the same step where it helps; it is kept where it does not, and nobody draws the views for it.
fn kept_for_what_follows() -> Outcome {
    let [better, worse] = better_and_worse(SMALL_STEP)?;
    let run = |weights: &Weights, steps: usize, last: LastStep| -> Result<(GaussianSet, RefineSummary), Failed> {
        let (mut set, view) = start();
        let settings = RefineSettings { last, ..steps.into() };
        let summary = refine(&mut set, &[&view], &weights.model()?, settings, || ()).map_err(failed)?;
        Ok((set, summary))
    };
    for steps in [1, 2] {
        let ((set, summary), (checked, all)) =
            (run(&better, steps, LastStep::Kept)?, run(&better, steps, LastStep::Checked)?);
        same_sets(&set, &checked)?;
        expect("a loss before each step", summary.losses == all.losses[..steps], &summary)?;
    }
    let (kept, summary) = run(&worse, 1, LastStep::Kept)?;
    expect("a step", summary.steps == 1 && kept != start().0, &summary)?;
    expect("one loss", summary.losses.len() == 1, &summary)
}

fn zero_heads() -> Outcome {
    let weights = Weights::seeded(SMALL, 5, Heads::ZERO)?;
    let (set, summary) = refined(&weights, 3)?;
    let stopped = summary.stopped_early && summary.steps == 0 && summary.losses.len() == 1;
    expect("one loss and an early stop", stopped, &summary)?;
    same_sets(&set, &start().0)
}

fn nothing_to_do() -> Outcome {
    let [better, _] = better_and_worse(SMALL_STEP)?;
    let (model, (mut set, view)) = (better.model()?, start());
    let empty = &mut GaussianSet::default();
    for (set, views, steps) in [(&mut set, vec![&view], 0), (empty, vec![&view], 3)] {
        let before = set.clone();
        let summary = refine(set, &views, &model, steps, || ()).map_err(failed)?;
        expect("nothing done", summary == RefineSummary::default(), &summary)?;
        same_sets(set, &before)?;
    }
    let summary = refine(&mut set, &[], &model, 3, || ()).map_err(failed)?;
    expect("nothing done without views", summary == RefineSummary::default(), &summary)
}

fn same_for_any_threads() -> Outcome {
    let [better, _] = better_and_worse(SMALL_STEP)?;
    let run = |threads: usize| -> Result<(GaussianSet, RefineSummary), Failed> {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build()?.install(|| refined(&better, 3))
    };
    let (one, two) = (run(1)?, run(2)?);
    same_sets(&two.0, &one.0)?;
    expect("the same losses", two.1.losses == one.1.losses, &two.1)
}

/// With nobody to ask the query returns its input: leaving it out changes nothing.
fn single_timestamp() -> Outcome {
    let model = Weights::seeded(SMALL, 5, Heads { residuals: 0.3, scores: 0.0 })?.model()?;
    let mut set = start().0;
    set.times.fill(0.3);
    let mut features = backbone(&set, &model).map_err(failed)?;
    let before = features.copy().map_err(failed)?;
    let skipped = query(&mut features, &set, &model).map_err(failed)?;
    if skipped != Some(QuerySkipped::SingleTimestamp) {
        return Err(format!("expected a skipped query, found {skipped:?}").into());
    }
    let points: Vec<[f32; 3]> = set.attributes[..set.num_lidar].iter().map(|row| [row[0], row[1], row[2]]).collect();
    let k = model.config.query.as_ref().map_or(0, |query| query.neighbours);
    let neighbours = nearest_other_time(&points, &vec![0; points.len()], k).map_err(failed)?;
    let asked = model.query.as_ref().ok_or("the model has no query")?;
    let fused = asked.forward(before, &Arc::new(neighbours.indices), k).map_err(failed)?;
    let rows = |t: &Tensor| t.flatten_all().and_then(|t| t.to_vec1::<f32>()).map_err(failed);
    same_bits("features", &rows(&features)?, &rows(&fused)?)
}
