//! Gradients over twelve decades, none, one outlier; what guides a refinement; many steps.

use lgs_engine::gaussians::physical::{SplatGradient, to_raw_gradient};
use lgs_engine::gaussians::{GaussianSet, LOG_SCALE, LOGIT_COLOUR, LOGIT_OPACITY, MeanResiduals, QUAT, RawGradient};
use lgs_engine::loss::LossWeights;
use lgs_engine::network::guide::{Guide, refine_rows};
use lgs_engine::objective::{Wanted, objective_with};
use lgs_engine::refine::adam::{AdamRates, adam};
use lgs_engine::refine::{refine, zero_non_finite};
use lgs_engine::render::reference::{self, fragile_pixels};
use lgs_engine::render::{backward, render_for_gradient};
use lgs_tests::Outcome;
use lgs_tests::compare::{close_l2, same_bits};
use lgs_tests::random::Random;
use lgs_tests::scenes::{
    GRADIENT_PARTS, Look, Scene, flat_gradient, gradients_of, image_gradient, pinhole, random_scene, random_weights,
    splats,
};
use lgs_tests::weights::{Heads, SMALL, Weights};

use super::tiny::{noise, view_of};
use super::{Extreme, all_finite, ensure, failed};

pub(super) const CASES: &[Extreme] = &[
    Extreme::new("twelve_decades_of_size", "a scene scaled by 1e-2 to 1e9", "the f64 twin's gradients (relative L2 2e-3): projection and its derivative are f64", || {
        (-2..10).try_for_each(|decade| scaled(10.0_f64.powi(decade), 1.0))
    }),
    Extreme::new("twelve_decades_of_gaussian_size", "Gaussians of 1e-9 to 1e3 times their size in place", "the f64 twin's gradients (relative L2 2e-3)", || {
        (-9..4).try_for_each(|decade| scaled(1.0, 10.0_f64.powi(decade)))
    }),
    Extreme::new("opacities_down_to_the_threshold", "opacities of 1 down to 1e-12", "the f64 twin's gradients; none below 1/255", opacities),
    Extreme::new("saturated_logits", "logits of +-1 to +-1e12 with gradients of 1e30", "finite raw gradients, 0 where the sigmoid is flat", saturated),
    Extreme::new("zero_gradients_guide_nobody", "gradients of zero into the inputs of a step", "zeros, not 0/0", zero_guide),
    Extreme::new("one_outlier_of_1e30_as_gradient", "one Gaussian's gradient at 1e30 among those of 200", "the others' inputs as without it (1 %), all finite: one may not decide everything", || outlier(1e30))
        .mended("the mean magnitude, by which gradients are divided, was the outlier's alone and all others entered as 0: a value that exceeds all others together no longer counts"),
    Extreme::new("one_outlier_of_1e38_as_gradient", "the same at 1e38, near the end of f32", "the same: products are formed in f64", || outlier(1e38))
        .mended("as for 1e30"),
    Extreme::new("one_outlier_of_1e30_as_residual", "one Gaussian's mean residual at 1e30 among those of 200", "the others' inputs keep their bits, all finite", outlier_residual),
    Extreme::new("loss_times_1e_12_and_1e12", "gradients multiplied by 1e-12 and by 1e12", "the same inputs of a step (1e-4)", loss_scaled),
    Extreme::new("residuals_of_saturated_colours", "colour logits of +-200 under errors of 1", "finite inputs; no step where the sigmoid is flat", saturated_residuals),
    Extreme::new("residuals_of_the_hidden", "Gaussians behind an opaque wall", "mean residuals of zero weight are zero, not 0/0", hidden_residuals),
    Extreme::new("residuals_of_far_depths", "LiDAR depths of 1e6 m, and of pixels where nothing is drawn", "finite residuals: a wrong depth counts by its sign", far_depths),
    Extreme::new("spoilt_gradients_are_zero", "NaN and infinity in single gradients", "those rows are zero and counted, the others keep their bits", zeroed),
    Extreme::new("two_hundred_steps_of_adam", "200 steps from a noise scene", "finite and bounded values", || many_steps(&noise(120, 8).0)),
    Extreme::new("two_hundred_steps_of_adam_from_the_extremes", "200 steps from log-scales of +-80, logits of +-200, quaternions of 0 and 1e30", "finite and bounded values", || many_steps(&extreme_scene())),
    Extreme::new("two_hundred_learned_steps", "200 steps of a seeded network, gradient-guided", "finite values, a loss that never rises", || learned(SMALL)),
    Extreme::new("two_hundred_learned_steps_by_residuals", "200 steps of a seeded network, guided by residuals, with hidden heads", "finite values, a loss that never rises", || learned(&by_residuals())),
];

/// A model that is guided by residuals and whose heads read every Gaussian's own state.
pub(super) fn by_residuals() -> String {
    SMALL.replace("\"unet\"", "\"guidance\": \"residual\", \"head_width\": 8, \"unet\"")
}

/// Fast gradients against the twin's.
fn agree(scene: &Scene, what: &str) -> Outcome {
    let skip = fragile_pixels(&scene.gaussians, &scene.camera, 1e-3);
    let weights = random_weights(&scene.camera, &skip, 52);
    let want: Vec<_> = reference::backward(&scene.gaussians, &scene.camera, [0.0; 3], &weights);
    let (splats, view) = (splats(&scene.gaussians), pinhole(&scene.camera));
    let state = render_for_gradient(&splats, &view, [0.0; 3]);
    let got = gradients_of(&backward(&splats, &view, &state, &image_gradient(&weights)));
    for (part, range) in GRADIENT_PARTS {
        let column = |all: &[reference::Gradient]| -> Vec<f64> {
            all.iter().flat_map(|g| flat_gradient(g)[range.clone()].to_vec()).collect()
        };
        let want = column(&want);
        // What is a hundred thousandth of the largest gradient of its kind is rounding of larger numbers.
        let floor = want.iter().fold(0.0_f64, |m, v| m.max(v.abs())) * 1e-5 + 1e-30;
        close_l2(&format!("{what}: gradient by {part}"), &column(&got), &want, 2e-3, floor)?;
    }
    Ok(())
}

const LOOK: Look = Look { num: 40, width: 64, height: 40, opacities: [0.1, 0.9] };

/// Rounded to a value of f32, which both precisions can hold.
#[expect(clippy::cast_possible_truncation, reason = "rounding to f32 is the point")]
fn round(value: f64) -> f64 {
    f64::from(value as f32)
}

/// The world `size` times as large, with Gaussians that are `thickness` times as large in it.
fn scaled(size: f64, thickness: f64) -> Outcome {
    let mut scene = random_scene(LOOK, 71);
    for g in &mut scene.gaussians {
        g.mean = g.mean.map(|v| round(v * size));
        g.velocity = g.velocity.map(|v| round(v * size));
        g.scale = g.scale.map(|v| round(v * size * thickness));
    }
    scene.camera.camera_from_world.iter_mut().for_each(|row| row[3] = round(row[3] * size));
    agree(&scene, &format!("{size:e} x {thickness:e}"))
}

fn opacities() -> Outcome {
    let mut scene = random_scene(LOOK, 72);
    for (g, decade) in scene.gaussians.iter_mut().zip((0..13).cycle()) {
        g.opacity = f64::from(10.0_f32.powi(-decade));
    }
    agree(&scene, "opacities")
}

fn saturated() -> Outcome {
    let (mut set, _) = noise(26, 1);
    for (row, k) in set.attributes.iter_mut().zip(0_i32..) {
        let value = 10.0_f32.powi(k / 2) * if k % 2 == 0 { 1.0 } else { -1.0 };
        row[LOGIT_OPACITY] = value;
        row[LOGIT_COLOUR].fill(value);
        row[LOG_SCALE].fill(value);
    }
    let huge = SplatGradient {
        mean: [1e30; 3],
        quat: [1e30; 4],
        scale: [1e30; 3],
        opacity: 1e30,
        colour: [1e30; 3],
        velocity: [1e30; 3],
    };
    let (rows, velocities) = to_raw_gradient(&set, &vec![huge; 26]);
    all_finite("raw gradient", rows.as_flattened().iter().copied().chain(velocities.as_flattened().iter().copied()))?;
    ensure(rows[20][LOGIT_OPACITY] == 0.0 && rows[20][LOG_SCALE.start] == 0.0, || format!("{:?}", rows[20]))
}

fn random_gradient(count: usize, factor: f32) -> RawGradient {
    let mut random = Random::new(5);
    RawGradient {
        attributes: (0..count).map(|_| [(); 14].map(|()| factor * random.normal_single())).collect(),
        velocities: (0..count).map(|_| [(); 3].map(|()| factor * random.normal_single())).collect(),
    }
}

fn zero_guide() -> Outcome {
    let (set, _) = noise(30, 2);
    let chosen: Vec<usize> = (0..30).collect();
    let rows = refine_rows(&set, Guide::Gradient(&random_gradient(30, 0.0)), &chosen, true);
    all_finite("inputs", rows.inputs)?;
    ensure(rows.point_inputs.iter().all(|v| *v == 0.0), || "a zero gradient says something".to_owned())
}

fn outlier(value: f32) -> Outcome {
    let (set, _) = noise(200, 3);
    let chosen: Vec<usize> = (0..200).collect();
    let plain = random_gradient(200, 1e-4);
    let mut spoilt = plain.clone();
    (spoilt.attributes[9], spoilt.velocities[9]) = ([value; 14], [value; 3]);
    let rows = |gradient: &RawGradient| refine_rows(&set, Guide::Gradient(gradient), &chosen, true);
    let (got, want) = (rows(&spoilt), rows(&plain));
    all_finite("inputs", got.inputs.iter().copied())?;
    let others = (0..200).filter(|&i| i != 9).flat_map(|i| 17 * i..17 * i + 17);
    let worst = others.map(|k| (got.point_inputs[k] - want.point_inputs[k]).abs()).fold(0.0, f32::max);
    ensure(worst < 0.05, || format!("an input of another Gaussian moved by {worst}"))
}

fn residuals_of(gradient: RawGradient) -> MeanResiduals {
    let count = gradient.attributes.len();
    MeanResiduals { gradient, weights: vec![3.0; count], errors: vec![0.1; count] }
}

fn outlier_residual() -> Outcome {
    let (set, _) = noise(200, 3);
    let chosen: Vec<usize> = (0..200).collect();
    let plain = residuals_of(random_gradient(200, 1e-4));
    let mut spoilt = plain.clone();
    (spoilt.gradient.attributes[9], spoilt.gradient.velocities[9]) = ([1e30; 14], [1e30; 3]);
    (spoilt.weights[9], spoilt.errors[9]) = (1e30, 1.0);
    let rows = |residuals: &MeanResiduals| refine_rows(&set, Guide::Residual(residuals), &chosen, true).inputs;
    let (mut got, mut want) = (rows(&spoilt), rows(&plain));
    all_finite("inputs", got.iter().copied())?;
    let width = got.len() / 200;
    [&mut got, &mut want].into_iter().for_each(|rows| drop(rows.drain(9 * width..10 * width)));
    same_bits("inputs of the others", &got, &want)
}

fn loss_scaled() -> Outcome {
    let (set, _) = noise(60, 3);
    let chosen: Vec<usize> = (0..60).collect();
    let rows =
        |factor: f32| refine_rows(&set, Guide::Gradient(&random_gradient(60, factor)), &chosen, true).point_inputs;
    let want = rows(1.0);
    for factor in [1e-12, 1e12] {
        let worst = rows(factor).iter().zip(&want).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        ensure(worst < 1e-4, || format!("factor {factor:e}: an input moved by {worst}"))?;
    }
    Ok(())
}

fn saturated_residuals() -> Outcome {
    let (mut set, _) = noise(30, 3);
    for (k, row) in set.attributes.iter_mut().enumerate() {
        row[LOGIT_COLOUR].fill([200.0, -200.0, 90.0, -90.0, 20.0][k % 5]);
    }
    let chosen: Vec<usize> = (0..30).collect();
    let rows = refine_rows(&set, Guide::Residual(&residuals_of(random_gradient(30, 1.0))), &chosen, true);
    all_finite("inputs", rows.inputs.iter().copied())?;
    let steps = |i: usize| &rows.inputs[(i + 1) * 40 - 3..(i + 1) * 40];
    ensure(rows.inputs.len() == 30 * 40 && steps(0) == [0.0; 3] && steps(1) == [0.0; 3], || format!("{:?}", steps(0)))
}

fn residuals(set: &GaussianSet, view: &lgs_engine::views::View) -> MeanResiduals {
    let wanted = Wanted { mean_residuals: true, ..Wanted::default() };
    objective_with(set, &[view], &LossWeights::default(), wanted).mean_residuals
}

fn finite_residuals(found: &MeanResiduals) -> Outcome {
    let rows = found.gradient.attributes.as_flattened().iter().chain(found.gradient.velocities.as_flattened());
    all_finite("mean residuals", rows.chain(&found.weights).chain(&found.errors).copied())
}

fn hidden_residuals() -> Outcome {
    let (mut set, view) = noise(30, 3);
    for (k, row) in set.attributes.iter_mut().enumerate() {
        if k < 8 {
            row[..3].copy_from_slice(&[0.0, 0.0, 0.5]);
            row[LOGIT_OPACITY] = 200.0;
            row[LOG_SCALE].fill(0.0);
        }
    }
    let found = residuals(&set, &view);
    finite_residuals(&found)?;
    let hidden = (8..30).filter(|&i| found.weights[i] == 0.0 && found.gradient.attributes[i] == [0.0; 14]).count();
    ensure(hidden > 15, || format!("{hidden} of 22 hidden"))
}

fn far_depths() -> Outcome {
    let (mut set, mut view) = noise(30, 3);
    view.depth_samples.iter_mut().enumerate().for_each(|(k, s)| s.depth = if k % 2 == 0 { 1e6 } else { 1e-4 });
    finite_residuals(&residuals(&set, &view))?;
    set.attributes.iter_mut().for_each(|row| row[2] = -row[2]);
    let found = residuals(&set, &view);
    finite_residuals(&found)?;
    ensure(found.weights.iter().all(|w| *w == 0.0), || "weight behind the camera".to_owned())
}

fn zeroed() -> Outcome {
    let plain = random_gradient(20, 1.0);
    let mut spoilt = plain.clone();
    spoilt.attributes[3][13] = f32::NAN;
    spoilt.velocities[11][2] = f32::NEG_INFINITY;
    let count = zero_non_finite(&mut spoilt);
    let mut want = plain;
    for i in [3, 11] {
        (want.attributes[i], want.velocities[i]) = ([0.0; 14], [0.0; 3]);
    }
    ensure(count == 2 && spoilt == want, || format!("{count} zeroed"))
}

fn extreme_scene() -> GaussianSet {
    let (mut set, _) = noise(120, 9);
    for (k, row) in set.attributes.iter_mut().enumerate() {
        match k % 6 {
            0 => row[LOG_SCALE].fill(80.0),
            1 => row[LOG_SCALE].fill(-80.0),
            2 => row[LOGIT_OPACITY] = 200.0,
            3 => row[LOGIT_COLOUR].fill(-200.0),
            4 => row[QUAT].fill(0.0),
            _ => row[QUAT].fill(1e30),
        }
    }
    set
}

fn bounded(set: &GaussianSet, start: &GaussianSet) -> Outcome {
    set.check_finite().map_err(failed)?;
    let largest = |set: &GaussianSet| set.attributes.as_flattened().iter().fold(0.0_f32, |m, v| m.max(v.abs()));
    ensure(largest(set) <= 10.0 * largest(start), || format!("{} from {}", largest(set), largest(start)))
}

fn many_steps(start: &GaussianSet) -> Outcome {
    let (_, view) = noise(10, 9);
    let mut set = start.clone();
    let summary = adam(&mut set, &[&view], &AdamRates::default(), 200, |_| ());
    ensure(summary.losses.len() == 200 && summary.losses.iter().all(|l| l.is_finite()), || format!("{summary:?}"))?;
    bounded(&set, start)
}

fn learned(config: &str) -> Outcome {
    let (start, view) = noise(120, 12);
    for spread in [1e-5, 0.05] {
        let forward = Weights::seeded(config, 5, Heads { residuals: spread, scores: 0.0 })?.at_rest()?;
        for weights in [forward.backwards()?, forward] {
            let mut set = start.clone();
            let summary = refine(&mut set, &[&view], &weights.model()?, 200, || ()).map_err(failed)?;
            let kept = &summary.losses[..=summary.steps];
            ensure(kept.is_sorted_by(|a, b| a > b), || format!("{summary:?}"))?;
            bounded(&set, &start)?;
        }
    }
    // Black where the scene is grey: the errors are as large as they can be.
    let black = view_of(vec![0.0; view.image.data.len()]);
    let mut set = start.clone();
    let weights = Weights::seeded(config, 6, Heads { residuals: 0.05, scores: 0.0 })?;
    refine(&mut set, &[&black], &weights.model()?, 200, || ()).map_err(failed)?;
    bounded(&set, &start)
}
