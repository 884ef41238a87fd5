use lgs_formats::image::RgbImage;

use super::*;
use crate::views::{
    DepthSample,
    samples::{ahead, seen},
};

const WIDTH: usize = 15;
const HEIGHT: usize = 13;

fn colours(phase: f32) -> Vec<f32> {
    (0..WIDTH * HEIGHT * 3).map(|i| 0.5 + 0.4 * (i as f32 * 0.17 + phase).sin()).collect()
}

fn rendered() -> Rendered {
    let pixels = WIDTH * HEIGHT;
    let alpha: Vec<f32> = (0..pixels).map(|i| 0.25 + 0.003 * i as f32).collect();
    let depth = alpha.iter().enumerate().map(|(i, a)| a * (5.0 + i as f32 * 0.1)).collect();
    Rendered { width: WIDTH, height: HEIGHT, rgb: colours(0.4), alpha, depth }
}

fn view(labels: Option<Vec<PixelLabel>>) -> View {
    View {
        labels,
        depth_samples: vec![DepthSample { pixel: 3, depth: 9.0 }, DepthSample { pixel: 100, depth: 4.0 }],
        ..seen(ahead(WIDTH, HEIGHT, 10.0), colours(0.0))
    }
}

fn labels() -> Vec<PixelLabel> {
    let ignored = |i: usize| i % WIDTH > 10 && i / WIDTH < 9;
    (0..WIDTH * HEIGHT).map(|i| if ignored(i) { PixelLabel::Ignored } else { PixelLabel::Static }).collect()
}

/// Compares the gradient by the colours with central differences of the total.
fn check_colour_gradient(view: &View) {
    let weights = LossWeights { l1: 0.3, ssim: 0.7, ..LossWeights::default() };
    let rendered = rendered();
    let (_, gradient) = image_loss(&rendered, view, &weights);
    let step = 2e-3;
    let smooth = |i: &usize| (rendered.rgb[*i] - view.image.data[*i]).abs() > step;
    for i in (0..gradient.rgb.len()).step_by(5).filter(smooth) {
        let moved = |by: f32| {
            let mut rendered = rendered.clone();
            rendered.rgb[i] += by;
            image_loss(&rendered, view, &weights).0.total
        };
        let want = (moved(step) - moved(-step)) / f64::from(2.0 * step);
        let got = f64::from(gradient.rgb[i]);
        assert!((got - want).abs() < 2e-5 + 5e-3 * want.abs(), "value {i}: got {got}, want {want}");
    }
}

#[test]
fn colour_gradient_is_the_finite_difference_of_the_total() {
    check_colour_gradient(&view(None));
}

#[test]
fn colour_gradient_is_the_finite_difference_with_ignored_pixels() {
    check_colour_gradient(&view(Some(labels())));
}

#[test]
fn terms_add_up_with_the_papers_weights() {
    let (terms, gradient) = image_loss(&rendered(), &view(None), &LossWeights::default());
    let ssim = terms.ssim.unwrap();
    assert!((terms.total - (0.8 * terms.l1 + 0.2 * (1.0 - ssim) + 0.01 * terms.depth)).abs() < 1e-7);
    assert!((terms.depth - ((9.0 - 5.3) + (15.0 - 4.0)) / 2.0).abs() < 1e-5, "{}", terms.depth);
    assert_eq!(gradient.expected_depth[3], -0.005);
    assert_eq!(gradient.expected_depth[100], 0.005);
    assert!(gradient.alpha.is_empty() && gradient.depth.is_empty());
}

#[test]
fn what_was_rendered_at_ignored_pixels_does_not_matter() {
    let view = view(Some(labels()));
    let plain = image_loss(&rendered(), &view, &LossWeights::default());
    let mut spoiled = rendered();
    for (i, label) in labels().iter().enumerate() {
        if *label == PixelLabel::Ignored {
            spoiled.rgb[3 * i..3 * i + 3].fill(f32::NAN);
            spoiled.depth[i] = f32::NAN;
        }
    }
    let spoiled = image_loss(&spoiled, &view, &LossWeights::default());
    assert_eq!(plain, spoiled);
    assert_eq!(plain.1.expected_depth.iter().filter(|&&g| g != 0.0).count(), 2);
    assert!(labels().iter().zip(plain.1.rgb.chunks(3)).all(|(l, g)| *l == PixelLabel::Static || g == [0.0; 3]));
}

#[test]
fn a_view_that_is_ignored_everywhere_costs_nothing() {
    let view = view(Some(vec![PixelLabel::Ignored; WIDTH * HEIGHT]));
    let (terms, gradient) = image_loss(&rendered(), &view, &LossWeights::default());
    assert_eq!(terms, LossTerms { l1: 0.0, ssim: None, depth: 0.0, total: 0.0 });
    assert!(gradient.rgb.iter().all(|&g| g == 0.0) && gradient.expected_depth.is_empty());
}

#[test]
fn labels_without_an_ignored_pixel_change_nothing() {
    let weights = LossWeights::default();
    let dynamic = view(Some(vec![PixelLabel::Dynamic; WIDTH * HEIGHT]));
    assert_eq!(image_loss(&rendered(), &view(None), &weights), image_loss(&rendered(), &dynamic, &weights));
}

#[test]
fn an_image_smaller_than_the_window_has_no_similarity_term() {
    let rendered = Rendered { width: 2, height: 1, rgb: vec![0.5; 6], alpha: vec![0.0; 2], depth: vec![0.0; 2] };
    let mut view = view(None);
    view.image = RgbImage { width: 2, height: 1, data: vec![0.25; 6] };
    view.depth_samples.clear();
    let (terms, gradient) = image_loss(&rendered, &view, &LossWeights::default());
    assert_eq!((terms.ssim, terms.l1, terms.depth), (None, 0.25, 0.0));
    assert!((terms.total - 0.2).abs() < 1e-8);
    assert_eq!(gradient.rgb, [0.8 / 6.0; 6]);
}

#[test]
fn the_loss_alone_is_that_with_its_gradient_to_the_bit() {
    for labels in [None, Some(labels()), Some(vec![PixelLabel::Ignored; WIDTH * HEIGHT])] {
        for weights in [LossWeights::default(), LossWeights { psnr: 0.1, ..LossWeights::default() }] {
            let (rendered, view) = (rendered(), view(labels.clone()));
            let bits = |terms: LossTerms| {
                let LossTerms { l1, ssim, depth, total } = terms;
                ([l1, depth, total].map(f64::to_bits), ssim.map(f64::to_bits))
            };
            let [with, alone] =
                [image_loss(&rendered, &view, &weights).0, image_loss_terms(&rendered, &view, &weights)].map(bits);
            assert_eq!(with, alone);
        }
    }
}
