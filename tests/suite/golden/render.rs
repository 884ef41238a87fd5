//! The rasteriser against gsplat's reference.

use std::path::PathBuf;

use lgs_engine::render::reference::{self, Gradient, Images};
use lgs_engine::render::{backward, gpu, render, render_for_gradient};
use lgs_tests::compare::{absolute, close_l2, close_where, l2, relative};
use lgs_tests::golden::render::{GoldenLoss, RenderGolden, load};
use lgs_tests::golden::tensors::TensorFile;
use lgs_tests::golden::{GoldenFile, files};
use lgs_tests::pictures::with_pictures;
use lgs_tests::scenes::{
    GRADIENT_PARTS, flat_gradient, gradients_of, image_gradient, images_of, pinhole, splats, weighted_sum,
};
use lgs_tests::{Outcome, case, case_if};
use libtest_mimic::Trial;

use crate::gpu::adapter;

const BLACK: [f64; 3] = [0.0; 3];
/// The images were stored as f32.
const STORED: f64 = 1e-7;
const TWIN_GRADIENT: f64 = 1e-6;
const FAST_IMAGE: f64 = 5e-5;
const FAST_GRADIENT: f64 = 1e-3;
const GPU_IMAGE: f64 = 1e-4;
const GPU_GRADIENT: f64 = 2e-3;
/// A gradient of the expected depth that is smaller than this part of the main one is the rounding noise of terms that cancel
/// (one Gaussian alone does not change its expected depth by its shape): then the main one is its measure.
const CANCELLED: f64 = 1e-9;

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
    let on_gpu = |what: &str, check: fn(&str, &RenderGolden) -> Outcome| {
        let (name, path): (String, PathBuf) = (format!("{}::{what}", file.name), file.path.clone());
        case_if(&adapter::needed(), name.clone(), move || check(&name, &load(&TensorFile::open(&path)?)?))
    };
    vec![
        on_gpu("gpu_images", gpu_images),
        on_gpu("gpu_gradients", gpu_gradients),
        with("twin_images", twin_images),
        with("twin_losses", twin_losses),
        with("twin_gradients", twin_gradients),
        with("fast_images", fast_images),
        with("fast_gradients", fast_gradients),
    ]
}

fn twin_images(name: &str, golden: &RenderGolden) -> Outcome {
    let got = reference::render(&golden.gaussians, &golden.camera, BLACK);
    let outcome = compare_images(golden, &got, STORED);
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
        compare_gradients(name, &got, loss, golden, TWIN_GRADIENT)?;
    }
    Ok(())
}

fn fast_images(name: &str, golden: &RenderGolden) -> Outcome {
    let rendered = render(&splats(&golden.gaussians), &pinhole(&golden.camera), [0.0; 3]);
    let got = images_of(&rendered);
    let outcome = compare_images(golden, &got, FAST_IMAGE);
    with_pictures(outcome, name, golden.camera.width, &got.rgb, &golden.images.rgb)
}

fn fast_gradients(_name: &str, golden: &RenderGolden) -> Outcome {
    let (splats, view) = (splats(&golden.gaussians), pinhole(&golden.camera));
    let state = render_for_gradient(&splats, &view, [0.0; 3]);
    for (name, loss) in [("main", &golden.main), ("expected depth", &golden.expected_depth)] {
        let got = gradients_of(&backward(&splats, &view, &state, &image_gradient(&loss.weights)));
        compare_gradients(name, &got, loss, golden, FAST_GRADIENT)?;
    }
    Ok(())
}

fn gpu_images(name: &str, golden: &RenderGolden) -> Outcome {
    let gpu = adapter::gpu().map_err(|needed| format!("{needed:?}"))?;
    let rendered = gpu::render(gpu, &splats(&golden.gaussians), &pinhole(&golden.camera), [0.0; 3])?;
    let got = images_of(&rendered);
    let outcome = compare_images(golden, &got, GPU_IMAGE);
    with_pictures(outcome, name, golden.camera.width, &got.rgb, &golden.images.rgb)
}

fn gpu_gradients(_name: &str, golden: &RenderGolden) -> Outcome {
    let gpu = adapter::gpu().map_err(|needed| format!("{needed:?}"))?;
    let (splats, view) = (splats(&golden.gaussians), pinhole(&golden.camera));
    for (name, loss) in [("main", &golden.main), ("expected depth", &golden.expected_depth)] {
        let gradient = image_gradient(&loss.weights);
        let drawn = gpu::render_and_backward(gpu, &splats, &view, [0.0; 3], &gradient, [&[], &[]])?;
        compare_gradients(name, &gradients_of(&drawn.splats), loss, golden, GPU_GRADIENT)?;
    }
    Ok(())
}

fn compare_gradients(
    name: &str,
    got: &[Gradient],
    loss: &GoldenLoss,
    golden: &RenderGolden,
    tolerance: f64,
) -> Outcome {
    for (part, columns) in GRADIENT_PARTS {
        let values = |gradients: &[Gradient]| -> Vec<f64> {
            gradients.iter().flat_map(|g| flat_gradient(g)[columns.clone()].to_vec()).collect()
        };
        let (got, want, main) = (values(got), values(&loss.gradients), values(&golden.main.gradients));
        let floor = if l2(&want) < CANCELLED * l2(&main) { l2(&main) } else { 0.0 };
        close_l2(&format!("gradient of {name} by {part}"), &got, &want, tolerance, floor)?;
    }
    Ok(())
}
