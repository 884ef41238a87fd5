//! What must not matter: the order of the Gaussians, and where the world's origin is.

use lgs_engine::render::reference::{Camera, Gaussian, Images, fragile_pixels};
use lgs_tests::Outcome;
use lgs_tests::compare::{absolute, close, close_l2, close_where};
use lgs_tests::random::Random;
use lgs_tests::scenes::{Look, Scene, random_scene, random_weights, rotation_of};
use libtest_mimic::Trial;

use super::renderer::{Renderer, flat};

const LOOK: Look = Look { num: 150, width: 72, height: 50, opacities: [0.05, 1.0] };

pub(crate) fn cases(renderer: Renderer) -> Vec<Trial> {
    vec![
        renderer.case("order_does_not_matter", order_does_not_matter),
        renderer.case("rigid_motion_does_not_matter", rigid_motion_does_not_matter),
        renderer.case("velocity_is_a_shift_of_the_mean", velocity_is_a_shift_of_the_mean),
    ]
}

fn order_does_not_matter(renderer: Renderer) -> Outcome {
    let scene = random_scene(LOOK, 11);
    let order = Random::new(12).order(scene.gaussians.len());
    let shuffled = Scene { gaussians: order.iter().map(|&i| scene.gaussians[i]).collect(), ..scene };
    let (want, got) = (renderer.images(&scene), renderer.images(&shuffled));
    close("rgb", &got.rgb, &want.rgb, absolute(0.0))?;
    close("depth", &got.depth, &want.depth, absolute(0.0))?;
    let weights = random_weights(&scene.camera, &vec![false; got.alpha.len()], 13);
    let gradients = renderer.gradients(&scene, &weights);
    let want: Vec<_> = order.iter().map(|&i| gradients[i]).collect();
    let got = renderer.gradients(&shuffled, &weights);
    close_l2("gradients", &flat(&got), &flat(&want), renderer.rounding(), 0.0)
}

fn rigid_motion_does_not_matter(renderer: Renderer) -> Outcome {
    let scene = random_scene(LOOK, 21);
    let quat = [0.6, -0.3, 0.5, 0.2];
    let (rotation, shift) = (rotation_of(quat), [1.5, -0.75, 2.25]);
    let moved = Scene {
        gaussians: scene.gaussians.iter().map(|g| moved_gaussian(g, quat, shift)).collect(),
        camera: moved_camera(&scene.camera, &rotation, shift),
    };
    let skip = fragile_pixels(&scene.gaussians, &scene.camera, 1e5 * renderer.rounding().min(1e-8));
    let (want, got) = (renderer.images(&scene), renderer.images(&moved));
    close_where("rgb", &got.rgb, &want.rgb, absolute(100.0 * renderer.rounding()), |i| !skip[i / 3])?;
    let weights = random_weights(&scene.camera, &skip, 22);
    let want: Vec<f64> = renderer.gradients(&scene, &weights).iter().flat_map(|g| turn(&rotation, g.mean)).collect();
    let got: Vec<f64> = renderer.gradients(&moved, &weights).iter().flat_map(|g| g.mean).collect();
    close_l2("gradient by the mean", &got, &want, 1000.0 * renderer.rounding(), 0.0)
}

fn moved_gaussian(g: &Gaussian, quat: [f64; 4], shift: [f64; 3]) -> Gaussian {
    let rotation = rotation_of(quat);
    let turned = turn(&rotation, g.mean);
    Gaussian {
        mean: std::array::from_fn(|k| turned[k] + shift[k]),
        quat: quaternion_product(quat, g.quat),
        velocity: turn(&rotation, g.velocity),
        ..*g
    }
}

/// The camera after the world was turned and shifted: `camera_from_world * inverse(motion)`.
fn moved_camera(camera: &Camera, rotation: &[[f64; 3]; 3], shift: [f64; 3]) -> Camera {
    let row = |r: &[f64; 4]| -> [f64; 4] {
        let turned = turn(rotation, [r[0], r[1], r[2]]);
        let offset: f64 = (0..3).map(|k| turned[k] * shift[k]).sum();
        [turned[0], turned[1], turned[2], r[3] - offset]
    };
    let rows = &camera.camera_from_world;
    Camera { camera_from_world: [row(&rows[0]), row(&rows[1]), row(&rows[2])], ..*camera }
}

fn turn(rotation: &[[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    rotation.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

fn quaternion_product(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]
}

fn velocity_is_a_shift_of_the_mean(renderer: Renderer) -> Outcome {
    let scene = random_scene(LOOK, 31);
    let still = |g: &Gaussian| {
        let elapsed = scene.camera.time - g.time;
        Gaussian { mean: std::array::from_fn(|k| g.mean[k] + g.velocity[k] * elapsed), velocity: [0.0; 3], ..*g }
    };
    let stopped = Scene { gaussians: scene.gaussians.iter().map(still).collect(), ..scene };
    let skip = fragile_pixels(&scene.gaussians, &scene.camera, 1e5 * renderer.rounding().min(1e-8));
    let (want, got): (Images, Images) = (renderer.images(&stopped), renderer.images(&scene));
    close_where("rgb", &got.rgb, &want.rgb, absolute(100.0 * renderer.rounding()), |i| !skip[i / 3])?;
    let weights = random_weights(&scene.camera, &skip, 32);
    let gradients = renderer.gradients(&scene, &weights);
    let elapsed = |i: usize| scene.camera.time - scene.gaussians[i].time;
    let want: Vec<f64> = (0..gradients.len()).flat_map(|i| gradients[i].mean.map(|v| v * elapsed(i))).collect();
    let got: Vec<f64> = gradients.iter().flat_map(|g| g.velocity).collect();
    close_l2("gradient by the velocity", &got, &want, renderer.rounding(), 0.0)
}
