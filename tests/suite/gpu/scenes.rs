//! Random scenes: against the twin and the CPU, the same bits in every run, what does not fit, values that are no numbers.

use lgs_engine::gaussians::physical::{Splat, SplatGradient};
use lgs_engine::render::gpu::{Gradients, open_limited, render_and_backward};
use lgs_engine::render::reference::{self, fragile_pixels};
use lgs_engine::render::{Device, ImageGradient, backward, render, render_for_gradient};
use lgs_engine::views::{PinholeView, Shutter};
use lgs_formats::{camera_motion::CameraMotion, pose::Pose};
use lgs_tests::Outcome;
use lgs_tests::compare::{absolute, close_l2, close_where, relative, same_bits};
use lgs_tests::scenes::{
    GRADIENT_PARTS, Look, flat_gradient, gradients_of, image_gradient, images_of, pinhole, random_scene,
    random_weights, splats,
};
use proptest::test_runner::{Config, RngAlgorithm, TestCaseError, TestRng, TestRunner};

use super::{Case, adapter};
use crate::render::fast::{ahead, any_float, splat};

pub(super) const CASES: &[Case] = &[
    ("equals_the_twin", equals_the_twin),
    ("images_of_any_size_are_the_cpus", images_of_any_size_are_the_cpus),
    ("rolling_shutters_are_the_cpus", rolling_shutters_are_the_cpus),
    ("kilometres_from_the_origin_it_is_the_cpus", kilometres_from_the_origin_it_is_the_cpus),
    ("the_same_bits_in_every_run", the_same_bits_in_every_run),
    ("sums_are_taken_in_runs_of_tiles", sums_are_taken_in_runs_of_tiles),
    ("what_does_not_fit_is_drawn_by_the_cpu", what_does_not_fit_is_drawn_by_the_cpu),
    ("a_lost_gpu_leaves_the_work_to_the_cpu", a_lost_gpu_leaves_the_work_to_the_cpu),
    ("survives_any_floats", survives_any_floats),
];

const BACKGROUND: [f64; 3] = [0.25, 0.5, 0.125];
const SINGLE_BACKGROUND: [f32; 3] = [0.25, 0.5, 0.125];
const IMAGE: f64 = 1e-4;
const GRADIENT: f64 = 2e-3;

fn drawn(splats: &[Splat], view: &PinholeView, gradient: &ImageGradient) -> Result<Gradients, libtest_mimic::Failed> {
    let gpu = adapter::gpu().map_err(|needed| format!("{needed:?}"))?;
    Ok(render_and_backward(gpu, splats, view, SINGLE_BACKGROUND, gradient, [&[], &[]])?)
}

fn flat(gradients: &[SplatGradient]) -> Vec<f64> {
    gradients_of(gradients).iter().flat_map(flat_gradient).collect()
}

fn single(values: &[f64]) -> Vec<f32> {
    #[expect(clippy::cast_possible_truncation, reason = "they were f32")]
    values.iter().map(|&v| v as f32).collect()
}

/// Images within 1e-4 off the fragile pixels, gradients within 2e-3 relative L2, the Gaussians seen that the CPU sees.
fn equals_the_twin() -> Outcome {
    let looks = [
        Look { num: 400, width: 150, height: 90, opacities: [0.02, 0.6] },
        Look { num: 300, width: 97, height: 61, opacities: [0.5, 1.0] },
        Look { num: 60, width: 33, height: 129, opacities: [0.9, 1.0] },
        Look { num: 3000, width: 213, height: 120, opacities: [0.05, 1.0] },
        Look { num: 3, width: 1, height: 1, opacities: [0.5, 0.9] },
    ];
    for (seed, look) in (151..).zip(looks) {
        let scene = random_scene(look, seed);
        let skip = fragile_pixels(&scene.gaussians, &scene.camera, 1e-3);
        let want = reference::render(&scene.gaussians, &scene.camera, BACKGROUND);
        let (splats, view) = (splats(&scene.gaussians), pinhole(&scene.camera));
        let weights = random_weights(&scene.camera, &skip, 52);
        let found = drawn(&splats, &view, &image_gradient(&weights))?;
        let got = images_of(&found.images);
        let name = format!("seed {seed}");
        close_where(&format!("{name}: rgb"), &got.rgb, &want.rgb, absolute(IMAGE), |i| !skip[i / 3])?;
        for (plane, got, want) in
            [("alpha", &got.alpha, &want.alpha), ("expected depth", &got.expected_depth, &want.expected_depth)]
        {
            close_where(&format!("{name}: {plane}"), got, want, relative(IMAGE, IMAGE), |i| !skip[i])?;
        }
        let want: Vec<f64> = reference::backward(&scene.gaussians, &scene.camera, BACKGROUND, &weights)
            .iter()
            .flat_map(flat_gradient)
            .collect();
        let got = flat(&found.splats);
        for (part, range) in GRADIENT_PARTS {
            let column = |all: &[f64]| -> Vec<f64> { all.chunks(17).flat_map(|g| g[range.clone()].to_vec()).collect() };
            close_l2(&format!("{name}: gradient by {part}"), &column(&got), &column(&want), GRADIENT, 1e-3)?;
        }
        let mut seen = vec![false; splats.len()];
        render_for_gradient(&splats, &view, SINGLE_BACKGROUND).visible().for_each(|i| seen[i] = true);
        let others = seen.iter().zip(&found.seen).filter(|(a, b)| a != b).count();
        if others * 1000 > seen.len() {
            return Err(format!("{name}: {others} of {} Gaussians are seen by one alone", seen.len()).into());
        }
    }
    Ok(())
}

/// At sizes at which 128 threads share a tile on the way back, and 64; pixels near a threshold have no weight.
fn images_of_any_size_are_the_cpus() -> Outcome {
    for (seed, width, height) in [(181, 1040, 520), (182, 2080, 1040)] {
        let scene = random_scene(Look { num: 100, width, height, opacities: [0.05, 0.9] }, seed);
        let skip = fragile_pixels(&scene.gaussians, &scene.camera, 1e-3);
        let (splats, view) = (splats(&scene.gaussians), pinhole(&scene.camera));
        let gradient = image_gradient(&random_weights(&scene.camera, &skip, 53));
        let found = drawn(&splats, &view, &gradient)?;
        let state = render_for_gradient(&splats, &view, SINGLE_BACKGROUND);
        let want = flat(&backward(&splats, &view, &state, &gradient));
        super::near(&format!("{width}x{height}: rgb"), &found.images.rgb, &state.images.rgb, IMAGE)?;
        let got = flat(&found.splats);
        for (part, range) in GRADIENT_PARTS {
            let column = |all: &[f64]| -> Vec<f64> { all.chunks(17).flat_map(|g| g[range.clone()].to_vec()).collect() };
            let what = format!("{width}x{height}: gradient by {part}");
            close_l2(&what, &column(&got), &column(&want), GRADIENT, 1e-3)?;
        }
    }
    Ok(())
}

fn rolling_shutters_are_the_cpus() -> Outcome {
    let motion = CameraMotion { turn: glam::DVec3::new(0.05, 0.4, -0.1), velocity: glam::DVec3::new(0.8, 0.1, 15.0) };
    for (seed, moments) in (171..).zip([[-0.015, 0.0, 0.03], [0.015, -0.03, 0.0], [-0.012, 0.015, 0.009]]) {
        let scene = random_scene(Look { num: 400, width: 150, height: 90, opacities: [0.05, 0.9] }, seed);
        let (splats, plain) = (splats(&scene.gaussians), pinhole(&scene.camera));
        let shutter = Shutter::new(moments, [plain.width, plain.height], &motion, &Pose::IDENTITY);
        let view = PinholeView { shutter: Some(shutter), ..plain };
        let weights = image_gradient(&random_weights(&scene.camera, &vec![false; 150 * 90], seed));
        let state = render_for_gradient(&splats, &view, SINGLE_BACKGROUND);
        let want = flat(&backward(&splats, &view, &state, &weights));
        let found = drawn(&splats, &view, &weights)?;
        let off = |a: &[f32], b: &[f32]| a.iter().zip(b).filter(|(a, b)| (*a - *b).abs() > 1e-4).count();
        let (changed, far) = (
            off(&state.images.rgb, &render(&splats, &plain, SINGLE_BACKGROUND).rgb),
            off(&found.images.rgb, &state.images.rgb),
        );
        if far > 4 || changed < 10_000 {
            return Err(format!("{moments:?}: {far} values are off, and a shutter changes {changed}").into());
        }
        close_l2(&format!("{moments:?}: gradients"), &flat(&found.splats), &want, GRADIENT, 0.0)?;
    }
    Ok(())
}

/// Means and camera are far away, and near each other: what f32 holds of them is all that there is.
fn kilometres_from_the_origin_it_is_the_cpus() -> Outcome {
    let scene = random_scene(Look { num: 400, width: 150, height: 90, opacities: [0.05, 0.9] }, 191);
    let (mut splats, mut view) = (splats(&scene.gaussians), pinhole(&scene.camera));
    let away = [3000.0, -2000.0, 150.0];
    splats.iter_mut().for_each(|splat| splat.mean.iter_mut().zip(away).for_each(|(x, by)| *x += by));
    for row in &mut view.camera_from_clip {
        row[3] -= (0..3).map(|k| row[k] * away[k]).sum::<f32>();
    }
    let weights = image_gradient(&random_weights(&scene.camera, &vec![false; 150 * 90], 192));
    let state = render_for_gradient(&splats, &view, SINGLE_BACKGROUND);
    let found = drawn(&splats, &view, &weights)?;
    let far = state.images.rgb.iter().zip(&found.images.rgb).filter(|(a, b)| (*a - *b).abs() > 1e-4).count();
    if far > 4 {
        return Err(format!("{far} values are off").into());
    }
    close_l2("gradients", &flat(&found.splats), &flat(&backward(&splats, &view, &state, &weights)), GRADIENT, 0.0)
}

fn the_same_bits_in_every_run() -> Outcome {
    let scene = random_scene(Look { num: 3000, width: 213, height: 120, opacities: [0.05, 1.0] }, 161);
    let (splats, view) = (splats(&scene.gaussians), pinhole(&scene.camera));
    let weights = image_gradient(&random_weights(&scene.camera, &vec![false; 213 * 120], 62));
    let run = || -> Result<[Vec<f32>; 2], libtest_mimic::Failed> {
        let found = drawn(&splats, &view, &weights)?;
        let images = [&found.images.rgb[..], &found.images.alpha, &found.images.depth].concat();
        Ok([images, single(&flat(&found.splats))])
    };
    let first = run()?;
    for _ in 1..5 {
        let [images, gradients] = run()?;
        same_bits("images", &images, &first[0])?;
        same_bits("gradients", &gradients, &first[1])?;
    }
    Ok(())
}

/// Many Gaussians, each over most of six tiles.
fn crowded() -> (Vec<Splat>, PinholeView, ImageGradient) {
    let scene = random_scene(Look { num: 1100, width: 64, height: 48, opacities: [0.05, 0.3] }, 181);
    let mut splats = splats(&scene.gaussians);
    splats.iter_mut().for_each(|splat| splat.scale = splat.scale.map(|s| 8.0 * s));
    let weights = image_gradient(&random_weights(&scene.camera, &[false; 64 * 48], 182));
    (splats, pinhole(&scene.camera), weights)
}

fn sums_are_taken_in_runs_of_tiles() -> Outcome {
    let (splats, view, weights) = crowded();
    let whole = drawn(&splats, &view, &weights)?;
    let intersections = render_for_gradient(&splats, &view, SINGLE_BACKGROUND).num_intersections();
    let most = 110_000;
    if 48 * intersections <= most {
        return Err(format!("{intersections} intersections fit at once").into());
    }
    let index = adapter::gpu().map_err(|needed| format!("{needed:?}"))?.adapter().index;
    let small = open_limited(index, most as u64)?;
    let parted = render_and_backward(small, &splats, &view, SINGLE_BACKGROUND, &weights, [&[], &[]])?;
    same_bits("images", &parted.images.rgb, &whole.images.rgb)?;
    same_bits("gradients", &single(&flat(&parted.splats)), &single(&flat(&whole.splats)))
}

fn what_does_not_fit_is_drawn_by_the_cpu() -> Outcome {
    let (splats, view, _) = crowded();
    let index = adapter::gpu().map_err(|needed| format!("{needed:?}"))?.adapter().index;
    let device = Device::Gpu(open_limited(index, 20_000)?);
    let rendered = device.render(&splats, &view, SINGLE_BACKGROUND);
    same_bits("colours", &rendered.rgb, &render(&splats, &view, SINGLE_BACKGROUND).rgb)?;
    let refused = device.drawn_on().refused;
    match refused.as_slice() {
        [reason] if reason.contains("MB where the GPU holds at most") => Ok(()),
        _ => Err(format!("reasons: {refused:?}").into()),
    }
}

fn a_lost_gpu_leaves_the_work_to_the_cpu() -> Outcome {
    let (splats, view, _) = crowded();
    let index = adapter::gpu().map_err(|needed| format!("{needed:?}"))?.adapter().index;
    let gpu = open_limited(index, u64::MAX)?;
    let device = Device::Gpu(gpu);
    let before = device.render(&splats, &view, SINGLE_BACKGROUND);
    if !device.drawn_on().refused.is_empty() {
        return Err(format!("refused: {:?}", device.drawn_on().refused).into());
    }
    gpu.stop();
    let after = device.render(&splats, &view, SINGLE_BACKGROUND);
    same_bits("colours", &after.rgb, &render(&splats, &view, SINGLE_BACKGROUND).rgb)?;
    let apart = before.rgb.iter().zip(&after.rgb).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    let refused = device.drawn_on().refused;
    match refused.as_slice() {
        [reason] if reason.starts_with("the GPU stopped") && apart < 1e-3 => Ok(()),
        _ => Err(format!("{apart} apart; reasons: {refused:?}").into()),
    }
}

/// Floats as they come from a broken file or an exploded network.
/// A Gaussian with a number that is not finite neither shows nor spoils the others, and images are finite.
fn survives_any_floats() -> Outcome {
    let strategy = proptest::collection::vec(proptest::collection::vec(any_float(), 18), 1..6);
    let config = Config { cases: 200, failure_persistence: None, ..Config::default() };
    let rng = TestRng::deterministic_rng(RngAlgorithm::ChaCha);
    let outcome = TestRunner::new_with_rng(config, rng).run(&strategy, |rows| {
        let sound: Vec<bool> = rows.iter().map(|row| row.iter().all(|v| v.is_finite())).collect();
        let all: Vec<Splat> = rows.iter().map(|row| splat(row)).collect();
        let only_sound: Vec<Splat> = (0..all.len()).filter(|&i| sound[i]).map(|i| all[i]).collect();
        let fail = |text: &str| TestCaseError::fail(text.to_owned());
        let run =
            |splats: &[Splat]| drawn(splats, &ahead(), &ones()).map_err(|e| fail(e.message().unwrap_or_default()));
        let (got, want) = (run(&all)?, run(&only_sound)?);
        if got.images.rgb.iter().chain(&got.images.depth).any(|v| !v.is_finite()) {
            return Err(fail("an image holds a value that is not finite"));
        }
        let kept: Vec<SplatGradient> = (0..all.len()).filter(|&i| sound[i]).map(|i| got.splats[i]).collect();
        let bits = |gradients: &[SplatGradient]| flat(gradients).iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        if got.images != want.images || bits(&kept) != bits(&want.splats) {
            return Err(fail("a Gaussian that is not finite changes the others"));
        }
        if (0..all.len()).any(|i| !sound[i] && got.splats[i] != SplatGradient::default()) {
            return Err(fail("a Gaussian that is not finite has a gradient"));
        }
        Ok(())
    });
    outcome.map_err(|e| e.to_string().into())
}

fn ones() -> ImageGradient {
    ImageGradient { rgb: vec![1.0; 3 * 40 * 24], alpha: vec![1.0; 40 * 24], ..ImageGradient::default() }
}
