//! Gradients against finite differences of the images, away from the thresholds.

use lgs_engine::render::reference::{Gaussian, Images, fragile_pixels};
use lgs_tests::Outcome;
use lgs_tests::compare::close_l2;
use lgs_tests::scenes::{GRADIENT_PARTS, Look, Scene, flat_gradient, random_scene, random_weights, weighted_sum};
use libtest_mimic::Trial;

use super::renderer::{Renderer, flat};

const LOOK: Look = Look { num: 24, width: 40, height: 28, opacities: [0.3, 0.95] };

pub(crate) fn cases(renderer: Renderer) -> Vec<Trial> {
    vec![renderer.case("gradients_are_finite_differences", gradients_are_finite_differences)]
}

fn gradients_are_finite_differences(renderer: Renderer) -> Outcome {
    for seed in 1..=3 {
        let scene = random_scene(LOOK, seed);
        let skip = fragile_pixels(&scene.gaussians, &scene.camera, renderer.step_margin());
        let weights = random_weights(&scene.camera, &skip, seed);
        let got = renderer.gradients(&scene, &weights);
        for (part, columns) in GRADIENT_PARTS {
            let got: Vec<f64> = got.iter().flat_map(|g| flat_gradient(g)[columns.clone()].to_vec()).collect();
            let numbers = scene.gaussians.len() * columns.len();
            let parameter = |k: usize| (k / columns.len(), columns.start + k % columns.len());
            let want: Vec<f64> =
                (0..numbers).map(|k| central_difference(renderer, &scene, &weights, parameter(k))).collect();
            let what = format!("seed {seed}, gradient by {part}");
            close_l2(&what, &got, &want, renderer.difference_tolerance(), 1e-3)?;
        }
        if flat(&got).iter().all(|&v| v == 0.0) {
            return Err("every gradient is zero: the scene shows nothing".into());
        }
    }
    Ok(())
}

fn central_difference(renderer: Renderer, scene: &Scene, weights: &Images, at: (usize, usize)) -> f64 {
    let step = renderer.step();
    let value = |sign: f64| {
        let mut moved = scene.clone();
        shift(&mut moved.gaussians[at.0], at.1, sign * step);
        weighted_sum(&renderer.images(&moved), weights)
    };
    (value(1.0) - value(-1.0)) / (2.0 * step)
}

/// Adds to one of the 17 numbers of a Gaussian that have a gradient.
fn shift(gaussian: &mut Gaussian, column: usize, by: f64) {
    match column {
        0..3 => gaussian.mean[column] += by,
        3..7 => gaussian.quat[column - 3] += by,
        7..10 => gaussian.scale[column - 7] += by,
        10 => gaussian.opacity += by,
        11..14 => gaussian.colour[column - 11] += by,
        _ => gaussian.velocity[column - 14] += by,
    }
}
