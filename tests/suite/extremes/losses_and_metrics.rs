//! Losses and figures of images that leave nothing to compare, and of values that no image has.

use lgs_engine::evaluate::psnr::psnr;
use lgs_engine::evaluate::{ViewFigures, evaluate_view};
use lgs_engine::loss::{LossWeights, image_loss, residual_image};
use lgs_engine::render::Rendered;
use lgs_engine::report::{RoleMeans, ViewRecord};
use lgs_engine::views::{DepthSample, Role, View};
use lgs_formats::image::PixelLabel;
use lgs_tests::Outcome;

use super::tiny::{AHEAD, view_of};
use super::{Extreme, all_finite, ensure, failed};

pub(super) const CASES: &[Extreme] = &[
    Extreme::new(
        "constant_images",
        "the same grey everywhere, in both",
        "no loss, SSIM 1, no gradient, PSNR infinite",
        constant,
    ),
    Extreme::new(
        "constant_images_that_differ",
        "black where white is true",
        "the largest L1 and 0 dB, finite gradients: C1 and C2 keep the quotient",
        different,
    ),
    Extreme::new(
        "infinite_psnr_in_json",
        "the figures of identical images",
        "`\"inf\"` in JSON that parses, in the view and in the mean",
        infinite_in_json,
    ),
    Extreme::new(
        "image_of_one_pixel",
        "an image smaller than any window",
        "no SSIM, which is null; a PSNR; a finite loss",
        one_pixel,
    ),
    Extreme::new(
        "everything_ignored",
        "a mask that ignores every pixel",
        "no figure, no loss, no gradient, no residual",
        all_ignored,
    ),
    Extreme::new(
        "no_dynamic_pixel",
        "dynamic figures without a dynamic pixel, and without a static one",
        "those figures are absent, the others there",
        no_dynamic,
    ),
    Extreme::new(
        "colours_that_are_not_finite",
        "NaN and infinity in a rendered image",
        "an error that names frame and camera, never a figure",
        not_finite,
    ),
    Extreme::new(
        "colours_of_1e6",
        "rendered colours of 1e6",
        "a finite loss in f64 and finite gradients",
        huge_colours,
    ),
    Extreme::new(
        "depths_of_1e6_m",
        "LiDAR depths of 1e6 m over pixels where nothing is drawn",
        "a finite depth error and loss",
        huge_depths,
    ),
    Extreme::new(
        "differences_of_one_bit",
        "images that differ by one bit in one value",
        "a finite PSNR above 150 dB",
        one_bit,
    ),
    Extreme::new(
        "nothing_drawn",
        "an empty rendering",
        "finite figures: it is a black image of depth 0",
        nothing_drawn,
    ),
];

fn rendered(rgb: Vec<f32>) -> Rendered {
    let n = AHEAD.num_pixels();
    Rendered { width: AHEAD.width, height: AHEAD.height, rgb, alpha: vec![1.0; n], depth: vec![5.0; n] }
}

fn grey(value: f32) -> Vec<f32> {
    vec![value; 3 * AHEAD.num_pixels()]
}

fn figures(image: &Rendered, view: &View) -> Result<ViewFigures, libtest_mimic::Failed> {
    evaluate_view(image, view, None, None).map_err(failed)
}

fn constant() -> Outcome {
    let (image, view) = (rendered(grey(0.3)), view_of(grey(0.3)));
    let (terms, gradient) = image_loss(&image, &view, &LossWeights::default());
    let flat = gradient.rgb.iter().all(|g| g.abs() < 1e-7);
    let found = figures(&image, &view)?;
    let perfect = found.psnr == Some(f64::INFINITY) && found.ssim.is_some_and(|s| (s - 1.0).abs() < 1e-6);
    ensure(flat && perfect && terms.total.abs() < 1e-6, || format!("{terms:?} {found:?}"))
}

fn different() -> Outcome {
    let (image, view) = (rendered(grey(0.0)), view_of(grey(1.0)));
    let (terms, gradient) = image_loss(&image, &view, &LossWeights::default());
    all_finite("gradient", gradient.rgb)?;
    let found = figures(&image, &view)?;
    ensure(terms.l1 == 1.0 && found.psnr.is_some_and(|p| p.abs() < 1e-9), || format!("{terms:?} {found:?}"))
}

fn infinite_in_json() -> Outcome {
    let found = figures(&rendered(grey(0.3)), &view_of(grey(0.3)))?;
    let record = ViewRecord { frame: 0, camera: "a".to_owned(), role: Role::HeldOut, figures: found };
    let means = RoleMeans::of(&[record.clone(), record.clone()]);
    let text = serde_json::to_string(&(record, means))?;
    let page: serde_json::Value = serde_json::from_str(&text)?;
    ensure(page[0]["psnr"] == "inf" && page[1]["held_out"]["psnr"] == "inf", || text)
}

fn one_pixel() -> Outcome {
    let image = Rendered { width: 1, height: 1, rgb: vec![0.5; 3], alpha: vec![1.0], depth: vec![2.0] };
    let mut view = view_of(vec![0.25; 3]);
    (view.image.width, view.image.height, view.depth_samples) = (1, 1, Vec::new());
    let found = figures(&image, &view)?;
    let (terms, _) = image_loss(&image, &view, &LossWeights::default());
    let fine = found.ssim.is_none() && found.psnr.is_some_and(f64::is_finite) && terms.total.is_finite();
    ensure(fine && terms.ssim.is_none(), || format!("{terms:?} {found:?}"))
}

fn all_ignored() -> Outcome {
    let image = rendered(grey(0.9));
    let mut view = view_of(grey(0.1));
    view.labels = Some(vec![PixelLabel::Ignored; AHEAD.num_pixels()]);
    let (terms, gradient) = image_loss(&image, &view, &LossWeights::default());
    let residual = residual_image(&image, &view);
    let zeros = |values: &[f32]| values.iter().all(|v| *v == 0.0);
    let found = figures(&image, &view)?;
    let none = found == ViewFigures::default() && terms.total == 0.0 && zeros(&gradient.rgb);
    ensure(none && zeros(&residual.rgb) && zeros(&residual.expected_depth), || format!("{terms:?} {found:?}"))
}

fn no_dynamic() -> Outcome {
    let (image, view) = (rendered(grey(0.9)), view_of(grey(0.1)));
    for dynamic in [true, false] {
        let mask = vec![dynamic; AHEAD.num_pixels()];
        let found = evaluate_view(&image, &view, Some(&mask), None).map_err(failed)?;
        let there = [found.psnr_dynamic.is_some(), found.ssim_dynamic.is_some()];
        let others = [found.psnr_static.is_some(), found.ssim_static.is_some()];
        ensure(there == [dynamic; 2] && others == [!dynamic; 2] && found.psnr.is_some(), || format!("{found:?}"))?;
    }
    Ok(())
}

fn not_finite() -> Outcome {
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let mut image = rendered(grey(0.5));
        image.rgb[100] = value;
        let said = evaluate_view(&image, &view_of(grey(0.5)), None, None).map_err(|e| e.to_string()).err();
        let said = said.unwrap_or_default();
        ensure(said.contains("ahead") && said.contains("expected a finite value"), || format!("it said {said:?}"))?;
    }
    Ok(())
}

fn huge_colours() -> Outcome {
    let (terms, gradient) = image_loss(&rendered(grey(1e6)), &view_of(grey(0.5)), &LossWeights::default());
    all_finite("gradient", gradient.rgb)?;
    ensure(terms.l1.is_finite() && terms.total.is_finite(), || format!("{terms:?}"))
}

fn huge_depths() -> Outcome {
    let mut image = rendered(grey(0.5));
    (image.alpha, image.depth) = (vec![0.0; AHEAD.num_pixels()], vec![0.0; AHEAD.num_pixels()]);
    let mut view = view_of(grey(0.5));
    view.depth_samples = (0..561).map(|pixel| DepthSample { pixel, depth: 1e6 }).collect();
    let (terms, gradient) = image_loss(&image, &view, &LossWeights::default());
    all_finite("gradient", gradient.expected_depth)?;
    let found = figures(&image, &view)?;
    ensure(terms.depth == 1e6 && found.dmae == Some(1e6), || format!("{terms:?} {found:?}"))
}

fn one_bit() -> Outcome {
    let (a, mut b) = (grey(0.5), grey(0.5));
    b[7] = f32::from_bits(b[7].to_bits() + 1);
    let found = psnr(&a, &b);
    ensure(found.is_finite() && found > 150.0, || format!("{found} dB"))
}

fn nothing_drawn() -> Outcome {
    let image = lgs_engine::render::render(&[], &AHEAD, [0.0; 3]);
    let found = figures(&image, &view_of(grey(0.5)))?;
    let all = [found.psnr, found.ssim, found.dmae];
    ensure(all.iter().all(|f| f.is_some_and(f64::is_finite)) && found.dmae == Some(5.0), || format!("{found:?}"))
}
