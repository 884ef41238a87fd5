//! The fast path against its twin, its repeatability, and values that are no numbers.

use lgs_engine::gaussians::physical::Splat;
use lgs_engine::render::reference::{self, fragile_pixels};
use lgs_engine::render::{ImageGradient, backward, render_for_gradient};
use lgs_engine::views::PinholeView;
use lgs_tests::compare::{absolute, close_l2, close_where, relative, same_bits};
use lgs_tests::pictures::with_pictures;
use lgs_tests::scenes::{
    GRADIENT_PARTS, Look, Scene, flat_gradient, gradients_of, image_gradient, images_of, pinhole, random_scene,
    random_weights, splats,
};
use lgs_tests::{Outcome, case};
use libtest_mimic::Trial;
use proptest::prelude::{Just, Strategy, any, prop_oneof};
use proptest::test_runner::{Config, TestCaseError, TestRunner};

use super::renderer::{BACKGROUND, SINGLE_BACKGROUND, flat};

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("render::fast::equals_the_twin", equals_the_twin),
        case("render::fast::equals_the_twin_on_any_size", equals_the_twin_on_any_size),
        case("render::fast::same_bits_for_any_number_of_threads", same_bits_for_any_number_of_threads),
        case("render::fast::survives_any_floats", survives_any_floats),
    ]
}

fn equals_the_twin() -> Outcome {
    let looks = [
        Look { num: 400, width: 150, height: 90, opacities: [0.02, 0.6] },
        Look { num: 300, width: 97, height: 61, opacities: [0.5, 1.0] },
        Look { num: 60, width: 33, height: 129, opacities: [0.9, 1.0] },
    ];
    for (seed, look) in (51..).zip(looks) {
        agree(&random_scene(look, seed), &format!("seed {seed}"))?;
    }
    Ok(())
}

fn equals_the_twin_on_any_size() -> Outcome {
    let strategy = (0..80_usize, 1..70_usize, 1..70_usize, any::<u64>());
    let config = Config { cases: 48, failure_persistence: None, ..Config::default() };
    let mut runner = TestRunner::new_with_rng(config, deterministic());
    let outcome = runner.run(&strategy, |(num, width, height, seed)| {
        let look = Look { num, width, height, opacities: [0.02, 1.0] };
        agree(&random_scene(look, seed), "a random scene")
            .map_err(|e| TestCaseError::fail(e.message().unwrap_or_default().to_owned()))
    });
    outcome.map_err(|e| e.to_string().into())
}

fn deterministic() -> proptest::test_runner::TestRng {
    proptest::test_runner::TestRng::deterministic_rng(proptest::test_runner::RngAlgorithm::ChaCha)
}

/// Images within 5e-5 off the fragile pixels, gradients within 1e-3 relative L2.
fn agree(scene: &Scene, name: &str) -> Outcome {
    let skip = fragile_pixels(&scene.gaussians, &scene.camera, 1e-3);
    let want = reference::render(&scene.gaussians, &scene.camera, BACKGROUND);
    let (splats, view) = (splats(&scene.gaussians), pinhole(&scene.camera));
    let state = render_for_gradient(&splats, &view, SINGLE_BACKGROUND);
    let got = images_of(&state.images);
    let rgb = close_where(&format!("{name}: rgb"), &got.rgb, &want.rgb, absolute(5e-5), |i| !skip[i / 3]);
    with_pictures(rgb, "render-fast-twin", view.width, &got.rgb, &want.rgb)?;
    for (plane, got, want) in [
        ("alpha", &got.alpha, &want.alpha),
        ("depth", &got.depth, &want.depth),
        ("expected depth", &got.expected_depth, &want.expected_depth),
    ] {
        close_where(&format!("{name}: {plane}"), got, want, relative(5e-5, 5e-5), |i| !skip[i])?;
    }
    let weights = random_weights(&scene.camera, &skip, 52);
    let want = flat(&reference::backward(&scene.gaussians, &scene.camera, BACKGROUND, &weights));
    let got = flat(&gradients_of(&backward(&splats, &view, &state, &image_gradient(&weights))));
    for (part, range) in GRADIENT_PARTS {
        let column = |all: &[f64]| -> Vec<f64> { all.chunks(17).flat_map(|g| g[range.clone()].to_vec()).collect() };
        close_l2(&format!("{name}: gradient by {part}"), &column(&got), &column(&want), 1e-3, 1e-3)?;
    }
    Ok(())
}

fn same_bits_for_any_number_of_threads() -> Outcome {
    let scene = random_scene(Look { num: 3000, width: 213, height: 120, opacities: [0.05, 1.0] }, 61);
    let (splats, view) = (splats(&scene.gaussians), pinhole(&scene.camera));
    let gradient = image_gradient(&random_weights(&scene.camera, &vec![false; 213 * 120], 62));
    let run = |threads: usize| -> Result<(Vec<f32>, Vec<f32>), libtest_mimic::Failed> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
        Ok(pool.install(|| {
            let state = render_for_gradient(&splats, &view, SINGLE_BACKGROUND);
            let gradients = backward(&splats, &view, &state, &gradient);
            let images = state.images;
            (
                [images.rgb, images.alpha, images.depth].concat(),
                gradients
                    .iter()
                    .flat_map(|g| [&g.mean[..], &g.quat, &g.scale, &[g.opacity], &g.colour, &g.velocity].concat())
                    .collect(),
            )
        }))
    };
    let (images, gradients) = run(1)?;
    for threads in [2, 3] {
        let (other_images, other_gradients) = run(threads)?;
        same_bits(&format!("images of {threads} threads"), &other_images, &images)?;
        same_bits(&format!("gradients of {threads} threads"), &other_gradients, &gradients)?;
    }
    Ok(())
}

/// Floats as they come from a broken file or an exploded network.
/// Numbers of any size, and what is none.
pub(crate) fn any_float() -> impl Strategy<Value = f32> {
    prop_oneof![
        4 => -3.0_f32..3.0,
        1 => any::<f32>(),
        1 => prop_oneof![
            Just(f32::NAN),
            Just(f32::INFINITY),
            Just(f32::NEG_INFINITY),
            Just(0.0_f32),
            Just(f32::MAX),
            Just(f32::MIN_POSITIVE),
            Just(1e-45_f32),
            Just(1e19_f32),
        ],
    ]
}

/// Any floats are drawn without a panic; a Gaussian with a number that is not finite neither shows nor spoils the others.
fn survives_any_floats() -> Outcome {
    let strategy = proptest::collection::vec(proptest::collection::vec(any_float(), 18), 1..6);
    let config = Config { cases: 400, failure_persistence: None, ..Config::default() };
    let outcome = TestRunner::new_with_rng(config, deterministic()).run(&strategy, |rows| {
        let sound: Vec<bool> = rows.iter().map(|row| row.iter().all(|v| v.is_finite())).collect();
        let all: Vec<Splat> = rows.iter().map(|row| splat(row)).collect();
        let only_sound: Vec<Splat> = (0..all.len()).filter(|&i| sound[i]).map(|i| all[i]).collect();
        let (images, gradients) = images_and_gradients(&all);
        let (want_images, want_gradients) = images_and_gradients(&only_sound);
        if let Some(value) = images.iter().find(|v| !v.is_finite()) {
            return Err(TestCaseError::fail(format!("the images hold {value}")));
        }
        let got: Vec<[f64; 17]> = (0..all.len()).filter(|&i| sound[i]).map(|i| gradients[i]).collect();
        let bits = |rows: &[[f64; 17]]| -> Vec<u64> { rows.iter().flatten().map(|v| v.to_bits()).collect() };
        if images != want_images || bits(&got) != bits(&want_gradients) {
            return Err(TestCaseError::fail("a Gaussian that is not finite changes the others"));
        }
        if (0..all.len()).any(|i| !sound[i] && gradients[i] != [0.0; 17]) {
            return Err(TestCaseError::fail("a Gaussian that is not finite has a gradient"));
        }
        Ok(())
    });
    outcome.map_err(|e| e.to_string().into())
}

fn images_and_gradients(splats: &[Splat]) -> (Vec<f32>, Vec<[f64; 17]>) {
    let view = ahead();
    let state = render_for_gradient(splats, &view, SINGLE_BACKGROUND);
    let ones = ImageGradient {
        rgb: vec![1.0; 3 * view.width * view.height],
        alpha: vec![1.0; view.width * view.height],
        ..ImageGradient::default()
    };
    let gradients = gradients_of(&backward(splats, &view, &state, &ones)).iter().map(flat_gradient).collect();
    ([&state.images.rgb[..], &state.images.alpha, &state.images.depth].concat(), gradients)
}

/// A Gaussian of 18 numbers, before the camera [`ahead`].
pub(crate) fn splat(row: &[f32]) -> Splat {
    Splat {
        mean: [row[0], row[1], row[2] + 2.0],
        quat: std::array::from_fn(|k| row[3 + k]),
        scale: std::array::from_fn(|k| row[7 + k].abs()),
        opacity: if row[10].is_finite() { row[10].abs().min(1.0) } else { row[10] },
        colour: std::array::from_fn(|k| row[11 + k]),
        velocity: std::array::from_fn(|k| row[14 + k]),
        time: row[17],
    }
}

/// A small camera that looks along z.
pub(crate) fn ahead() -> PinholeView {
    PinholeView {
        width: 40,
        height: 24,
        fx: 30.0,
        fy: 30.0,
        cx: 20.0,
        cy: 12.0,
        camera_from_clip: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
        time: 0.5,
        shutter: None,
        pixel_side: 1.0,
    }
}
