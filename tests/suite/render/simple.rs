//! Scenes whose images are known without a renderer: none, one, one behind another, behind the camera.

use lgs_engine::render::reference::{Camera, Gaussian, Images};
use lgs_tests::Outcome;
use lgs_tests::compare::{absolute, close, relative};
use lgs_tests::scenes::Scene;
use libtest_mimic::Trial;

use super::renderer::{BACKGROUND, Renderer, flat};

/// Looks along +z from the origin.
const CAMERA: Camera = Camera {
    width: 33,
    height: 17,
    fx: 40.0,
    fy: 50.0,
    cx: 16.5,
    cy: 8.5,
    camera_from_world: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
    time: 0.0,
};
const NUM_PIXELS: usize = CAMERA.width * CAMERA.height;

/// A sphere straight ahead.
const SPHERE: Gaussian = Gaussian {
    mean: [0.0, 0.0, 4.0],
    quat: [2.0, 0.0, 0.0, 0.0],
    scale: [0.25, 0.25, 0.25],
    opacity: 0.75,
    colour: [1.0, 0.5, 0.0],
    velocity: [0.0; 3],
    time: 0.0,
};

pub(crate) fn cases(renderer: Renderer) -> Vec<Trial> {
    vec![
        renderer.case("nothing_is_background", nothing_is_background),
        renderer.case("behind_the_camera_is_background", behind_the_camera_is_background),
        renderer.case("one_gaussian_is_its_formula", one_gaussian_is_its_formula),
        renderer.case("two_gaussians_composite_front_to_back", two_gaussians_composite_front_to_back),
        renderer.case("equal_depths_keep_their_order", equal_depths_keep_their_order),
        renderer.case("an_opaque_wall_ends_the_pixel", an_opaque_wall_ends_the_pixel),
    ]
}

fn scene(gaussians: Vec<Gaussian>) -> Scene {
    Scene { gaussians, camera: CAMERA }
}

fn expect_background(renderer: Renderer, gaussians: Vec<Gaussian>) -> Outcome {
    let scene = scene(gaussians);
    let images = renderer.images(&scene);
    close("rgb", &images.rgb, &BACKGROUND.repeat(NUM_PIXELS), absolute(0.0))?;
    for (name, plane) in [("alpha", images.alpha), ("depth", images.depth), ("expected", images.expected_depth)] {
        close(name, &plane, &[0.0; NUM_PIXELS], absolute(0.0))?;
    }
    let ones = Images { rgb: vec![1.0; 3 * NUM_PIXELS], ..Images::zeros(NUM_PIXELS) };
    let gradients = flat(&renderer.gradients(&scene, &ones));
    close("gradients", &gradients, &vec![0.0; 17 * scene.gaussians.len()], absolute(0.0))
}

fn nothing_is_background(renderer: Renderer) -> Outcome {
    expect_background(renderer, Vec::new())
}

fn behind_the_camera_is_background(renderer: Renderer) -> Outcome {
    let at = |z: f64| Gaussian { mean: [0.0, 0.0, z], ..SPHERE };
    expect_background(renderer, vec![at(-4.0), at(-0.01), at(0.0), at(0.009)])
}

/// The alpha that the formula gives the sphere at a pixel: an axis-aligned footprint, so two variances say all.
fn alpha_of(sphere: &Gaussian, pixel: usize) -> f64 {
    let z = sphere.mean[2];
    let variance = |focal: f64| (focal * sphere.scale[0] / z).powi(2) + 0.3;
    let dx = (pixel % CAMERA.width) as f64 + 0.5 - CAMERA.cx;
    let dy = (pixel / CAMERA.width) as f64 + 0.5 - CAMERA.cy;
    let sigma = 0.5 * (dx * dx / variance(CAMERA.fx) + dy * dy / variance(CAMERA.fy));
    let alpha = (sphere.opacity * (-sigma).exp()).min(0.999);
    if alpha < 1.0 / 255.0 { 0.0 } else { alpha }
}

fn one_gaussian_is_its_formula(renderer: Renderer) -> Outcome {
    let images = renderer.images(&scene(vec![SPHERE]));
    let alphas: Vec<f64> = (0..NUM_PIXELS).map(|p| alpha_of(&SPHERE, p)).collect();
    let rgb: Vec<f64> = (0..3 * NUM_PIXELS)
        .map(|i| alphas[i / 3] * SPHERE.colour[i % 3] + (1.0 - alphas[i / 3]) * BACKGROUND[i % 3])
        .collect();
    let depth: Vec<f64> = alphas.iter().map(|a| a * 4.0).collect();
    let expected: Vec<f64> = alphas.iter().map(|&a| if a > 0.0 { 4.0 } else { 0.0 }).collect();
    let tolerance = absolute(10.0 * renderer.rounding());
    close("alpha", &images.alpha, &alphas, tolerance)?;
    close("rgb", &images.rgb, &rgb, tolerance)?;
    close("depth", &images.depth, &depth, tolerance)?;
    close("expected depth", &images.expected_depth, &expected, relative(100.0 * renderer.rounding(), 0.0))
}

fn two_gaussians_composite_front_to_back(renderer: Renderer) -> Outcome {
    let far = Gaussian { mean: [0.0, 0.0, 8.0], opacity: 0.9, colour: [0.0, 0.25, 1.0], ..SPHERE };
    let images = renderer.images(&scene(vec![far, SPHERE]));
    let pixel = NUM_PIXELS / 2;
    let (near_alpha, far_alpha) = (alpha_of(&SPHERE, pixel), alpha_of(&far, pixel));
    let far_weight = (1.0 - near_alpha) * far_alpha;
    let behind = (1.0 - near_alpha) * (1.0 - far_alpha);
    let rgb: Vec<f64> =
        (0..3).map(|k| near_alpha * SPHERE.colour[k] + far_weight * far.colour[k] + behind * BACKGROUND[k]).collect();
    let tolerance = absolute(10.0 * renderer.rounding());
    close("rgb of the middle pixel", &images.rgb[3 * pixel..][..3], &rgb, tolerance)?;
    close("its depth", &images.depth[pixel..=pixel], &[near_alpha * 4.0 + far_weight * 8.0], tolerance)
}

fn equal_depths_keep_their_order(renderer: Renderer) -> Outcome {
    let other = Gaussian { colour: [0.0, 0.0, 1.0], ..SPHERE };
    let pixel = NUM_PIXELS / 2;
    let alpha = alpha_of(&SPHERE, pixel);
    for pair in [[SPHERE, other], [other, SPHERE]] {
        let rgb: Vec<f64> = (0..3)
            .map(|k| {
                let second = alpha * pair[1].colour[k] + (1.0 - alpha) * BACKGROUND[k];
                alpha * pair[0].colour[k] + (1.0 - alpha) * second
            })
            .collect();
        let images = renderer.images(&scene(pair.to_vec()));
        let got = &images.rgb[3 * pixel..][..3];
        close("rgb of the middle pixel", got, &rgb, absolute(10.0 * renderer.rounding()))?;
    }
    Ok(())
}

/// Two walls of alpha 0.95 leave a transmittance of 0.0025; the third would leave 2.5e-6, so it is left out.
fn an_opaque_wall_ends_the_pixel(renderer: Renderer) -> Outcome {
    let wall = |z: f64, opacity: f64| Gaussian { mean: [0.0, 0.0, z], opacity, scale: [4.0; 3], ..SPHERE };
    let scene = scene(vec![wall(4.0, 0.95), wall(5.0, 0.95), wall(6.0, 0.999), wall(7.0, 0.5)]);
    let images = renderer.images(&scene);
    let pixel = NUM_PIXELS / 2;
    let tolerance = absolute(10.0 * renderer.rounding());
    close("alpha of the middle pixel", &images.alpha[pixel..=pixel], &[1.0 - 0.05 * 0.05], tolerance)?;
    let ones = Images { rgb: vec![1.0; 3 * NUM_PIXELS], ..Images::zeros(NUM_PIXELS) };
    let mut only_middle = Images::zeros(NUM_PIXELS);
    only_middle.rgb[3 * pixel..][..3].copy_from_slice(&ones.rgb[..3]);
    let gradients = renderer.gradients(&scene, &only_middle);
    close("gradients behind the end", &flat(&gradients[2..]), &[0.0; 34], absolute(0.0))
}
