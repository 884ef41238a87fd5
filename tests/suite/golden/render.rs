//! The rasteriser against gsplat's reference.

use std::path::PathBuf;

use lgs_engine::render::reference::{self, Gradient, Images};
use lgs_tests::compare::{absolute, close_l2, close_where, relative};
use lgs_tests::golden::render::{GoldenLoss, RenderGolden, load};
use lgs_tests::golden::tensors::TensorFile;
use lgs_tests::golden::{GoldenFile, files};
use lgs_tests::pictures::with_pictures;
use lgs_tests::scenes::weighted_sum;
use lgs_tests::{Outcome, case};
use libtest_mimic::Trial;

const BLACK: [f64; 3] = [0.0; 3];
/// The images were stored as f32.
const STORED: f64 = 1e-7;
const TWIN_GRADIENT: f64 = 1e-6;
/// Gradients whose terms cancel to nothing (one Gaussian alone does not change its expected depth by its shape) are
/// compared with this instead of with themselves.
const CANCELLED: f64 = 1e-6;

pub(crate) fn cases() -> Vec<Trial> {
    match files("render", "safetensors") {
        Ok(files) => files.iter().flat_map(cases_of).collect(),
        Err(error) => vec![case("golden::render::files", move || Err(error.into()))],
    }
}

fn cases_of(file: &GoldenFile) -> Vec<Trial> {
    let with = |what: &str, check: fn(&str, &RenderGolden) -> Outcome| {
        let (name, path): (String, PathBuf) = (format!("{}::{what}", file.name), file.path.clone());
        case(name.clone(), move || check(&name, &load(&TensorFile::open(&path)?)?))
    };
    vec![with("twin_images", twin_images), with("twin_losses", twin_losses), with("twin_gradients", twin_gradients)]
}

fn twin_images(name: &str, golden: &RenderGolden) -> Outcome {
    let got = reference::render(&golden.gaussians, &golden.camera, BLACK);
    let outcome = compare_images(golden, &got, relative(STORED, STORED).relative);
    with_pictures(outcome, name, golden.camera.width, &got.rgb, &golden.images.rgb)
}

fn compare_images(golden: &RenderGolden, got: &Images, tolerance: f64) -> Outcome {
    let want = &golden.images;
    let sound = |pixel: usize| !golden.fragile[pixel];
    let depth = relative(tolerance, tolerance);
    close_where("rgb", &got.rgb, &want.rgb, absolute(tolerance), |i| sound(i / 3))?;
    close_where("alpha", &got.alpha, &want.alpha, absolute(tolerance), sound)?;
    close_where("depth", &got.depth, &want.depth, depth, sound)?;
    close_where("expected_depth", &got.expected_depth, &want.expected_depth, depth, sound)
}

fn twin_losses(_name: &str, golden: &RenderGolden) -> Outcome {
    let got = reference::render(&golden.gaussians, &golden.camera, BLACK);
    for (name, loss) in [("main", &golden.main), ("expected depth", &golden.expected_depth)] {
        let value = weighted_sum(&got, &loss.weights);
        close_where(name, &[value], &[loss.value], relative(1e-9, 1e-9), |_| true)?;
    }
    Ok(())
}

fn twin_gradients(_name: &str, golden: &RenderGolden) -> Outcome {
    for (name, loss) in [("main", &golden.main), ("expected depth", &golden.expected_depth)] {
        let got = reference::backward(&golden.gaussians, &golden.camera, BLACK, &loss.weights);
        compare_gradients(name, &got, loss, TWIN_GRADIENT)?;
    }
    Ok(())
}

fn compare_gradients(name: &str, got: &[Gradient], loss: &GoldenLoss, tolerance: f64) -> Outcome {
    type Part = fn(&Gradient) -> Vec<f64>;
    let parts: [(&str, Part); 6] = [
        ("mean", |g| g.mean.to_vec()),
        ("quat", |g| g.quat.to_vec()),
        ("scale", |g| g.scale.to_vec()),
        ("opacity", |g| vec![g.opacity]),
        ("colour", |g| g.colour.to_vec()),
        ("velocity", |g| g.velocity.to_vec()),
    ];
    for (part, values) in parts {
        let got: Vec<f64> = got.iter().flat_map(values).collect();
        let want: Vec<f64> = loss.gradients.iter().flat_map(values).collect();
        close_l2(&format!("gradient of {name} by {part}"), &got, &want, tolerance, CANCELLED)?;
    }
    Ok(())
}
