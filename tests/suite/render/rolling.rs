//! Rolling shutters: the fast path, which draws each Gaussian at one moment, against the twin, which draws each pixel at its own.

use lgs_engine::render::reference::{self, Camera, Images};
use lgs_engine::render::{backward, render_for_gradient};
use lgs_engine::views::{PinholeView, Shutter};
use lgs_formats::{camera_motion::CameraMotion, pose::Pose};
use lgs_tests::compare::same_bits;
use lgs_tests::scenes::{
    Look, Scene, gradients_of, image_gradient, images_of, pinhole, random_scene, random_weights, rotation_of, splats,
};
use lgs_tests::{Outcome, case};
use libtest_mimic::Trial;

use super::renderer::{BACKGROUND, SINGLE_BACKGROUND, flat};

const LOOK: Look = Look { num: 160, width: 72, height: 50, opacities: [0.05, 1.0] };
/// Seconds from the first line to the last.
const READOUT: f64 = 0.03;

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("render::rolling::draws_what_the_twin_draws", draws_what_the_twin_draws),
        case("render::rolling::a_camera_that_stands_changes_no_bit", a_camera_that_stands_changes_no_bit),
    ]
}

/// A camera that drives ahead at 15 m/s, sways and turns; moments by rows down, by columns to the left, across.
const MOTION: CameraMotion =
    CameraMotion { turn: glam::DVec3::new(0.05, 0.4, -0.1), velocity: glam::DVec3::new(0.8, 0.1, 15.0) };
const MOMENTS: [[f64; 3]; 3] =
    [[-0.5 * READOUT, 0.0, READOUT], [0.5 * READOUT, -READOUT, 0.0], [-0.4 * READOUT, 0.5 * READOUT, 0.3 * READOUT]];

fn world_from_camera(camera: &Camera) -> Pose {
    let [a, b, c] = camera.camera_from_world;
    let rows = [a, b, c].map(|row| glam::DVec3::new(row[0], row[1], row[2]));
    Pose::new(glam::DMat3::from_cols(rows[0], rows[1], rows[2]), glam::DVec3::ZERO)
}

fn rolling(camera: &Camera, moments: [f64; 3], motion: &CameraMotion) -> PinholeView {
    let shutter = Shutter::new(moments, [camera.width, camera.height], motion, &world_from_camera(camera));
    PinholeView { shutter: Some(shutter), ..pinhole(camera) }
}

/// The camera at a place of the image, worked out by itself.
fn exposing(camera: &Camera, [a, b, c]: [f64; 3], motion: &CameraMotion, at: [f64; 2]) -> Camera {
    let seconds = a + b * at[0] / camera.width as f64 + c * at[1] / camera.height as f64;
    let angle = motion.turn.length() * seconds;
    let axis = -motion.turn / motion.turn.length().max(1e-300) * (0.5 * angle).sin();
    let turn = rotation_of([(0.5 * angle).cos(), axis.x, axis.y, axis.z]);
    let old = camera.camera_from_world;
    let shifted = old.map(|row| {
        let way: f64 = (0..3).map(|k| row[k] * motion.velocity[k]).sum();
        [row[0], row[1], row[2], row[3] - way * seconds]
    });
    let row = |r: usize| std::array::from_fn(|c| (0..3).map(|k| turn[r][k] * shifted[k][c]).sum());
    Camera { camera_from_world: [row(0), row(1), row(2)], time: camera.time + seconds, ..*camera }
}

fn draws_what_the_twin_draws() -> Outcome {
    for (seed, moments) in (71..).zip(MOMENTS) {
        // Nothing nearer than 4 m: at 15 m/s, what is nearer moves over a twentieth of the lines meanwhile.
        let mut scene = random_scene(LOOK, seed);
        scene.gaussians.retain(|g| depth(&scene.camera, g.mean) > 4.0);
        let at = |place| exposing(&scene.camera, moments, &MOTION, place);
        let want = reference::render_rolling(&scene.gaussians, &scene.camera, at, BACKGROUND);
        let view = rolling(&scene.camera, moments, &MOTION);
        let drawn = splats(&scene.gaussians);
        let state = render_for_gradient(&drawn, &view, SINGLE_BACKGROUND);
        let got = images_of(&state.images);
        let at_once = reference::render(&scene.gaussians, &scene.camera, BACKGROUND);
        let (apart, without) = (distance(&got, &want), distance(&at_once, &want));
        if !(apart < 2e-3 && apart < 0.05 * without) {
            return Err(format!("{moments:?}: {apart:.5} from the twin, {without:.5} without a shutter").into());
        }
        gradients_agree(&scene, moments, &view, seed)?;
    }
    Ok(())
}

/// Gradients within 12 % of the twin's: alphas near their floor and terms of second order in the motion are not the same.
fn gradients_agree(scene: &Scene, moments: [f64; 3], view: &PinholeView, seed: u64) -> Outcome {
    let at = |place| exposing(&scene.camera, moments, &MOTION, place);
    let skip = vec![false; view.num_pixels()];
    let weights = random_weights(&scene.camera, &skip, seed);
    let want = flat(&reference::backward_rolling(&scene.gaussians, &scene.camera, at, BACKGROUND, &weights));
    let drawn = splats(&scene.gaussians);
    let state = render_for_gradient(&drawn, view, SINGLE_BACKGROUND);
    let got = flat(&gradients_of(&backward(&drawn, view, &state, &image_gradient(&weights))));
    let plain = flat(&reference::backward(&scene.gaussians, &scene.camera, BACKGROUND, &weights));
    let norm = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    let off = |v: &[f64]| norm(&v.iter().zip(&want).map(|(a, b)| a - b).collect::<Vec<_>>()) / norm(&want);
    let (apart, without) = (off(&got), off(&plain));
    if !(apart < 0.12 && apart < 0.25 * without) {
        return Err(format!("{moments:?}: gradients {apart:.4} from the twin, {without:.4} without a shutter").into());
    }
    Ok(())
}

fn depth(camera: &Camera, mean: [f64; 3]) -> f64 {
    let row = camera.camera_from_world[2];
    row[0] * mean[0] + row[1] * mean[1] + row[2] * mean[2] + row[3]
}

/// Root of the mean squared difference of colours.
fn distance(a: &Images, b: &Images) -> f64 {
    let sum: f64 = a.rgb.iter().zip(&b.rgb).map(|(a, b)| (a - b) * (a - b)).sum();
    (sum / a.rgb.len() as f64).sqrt()
}

fn a_camera_that_stands_changes_no_bit() -> Outcome {
    let mut scene = random_scene(LOOK, 81);
    scene.gaussians.iter_mut().for_each(|g| g.velocity = [0.0; 3]);
    let drawn = splats(&scene.gaussians);
    let weights = image_gradient(&random_weights(&scene.camera, &vec![false; LOOK.width * LOOK.height], 82));
    let run = |view: &PinholeView| {
        let state = render_for_gradient(&drawn, view, SINGLE_BACKGROUND);
        let means: Vec<f32> = backward(&drawn, view, &state, &weights).iter().flat_map(|g| g.mean).collect();
        (state.images.rgb, means)
    };
    let (plain, means) = run(&pinhole(&scene.camera));
    for moments in MOMENTS {
        let (rgb, other) = run(&rolling(&scene.camera, moments, &CameraMotion::default()));
        same_bits("colours", &rgb, &plain)?;
        same_bits("gradients by the means", &other, &means)?;
    }
    Ok(())
}
