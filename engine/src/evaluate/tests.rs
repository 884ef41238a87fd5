use super::*;
use crate::views::{
    DepthSample, Role,
    samples::{ahead, seen},
};

const WIDTH: usize = 16;
const HEIGHT: usize = 14;
const PIXELS: usize = WIDTH * HEIGHT;

fn view(labels: Option<Vec<PixelLabel>>) -> View {
    let data = (0..PIXELS * 3).map(|i| 0.5 + 0.4 * (i as f32 * 0.3).sin()).collect();
    View {
        frame: 4,
        role: Role::HeldOut,
        labels,
        depth_samples: vec![DepthSample { pixel: 0, depth: 3.0 }, DepthSample { pixel: 20, depth: 9.0 }],
        ..seen(ahead(WIDTH, HEIGHT, 10.0), data)
    }
}

/// The truth, off by 0.1 in the right half, at 4 m.
fn rendered(view: &View) -> Rendered {
    let off = |i: usize| if i / 3 % WIDTH >= WIDTH / 2 { 0.1 } else { 0.0 };
    let rgb = view.image.data.iter().enumerate().map(|(i, v)| v + off(i)).collect();
    Rendered { width: WIDTH, height: HEIGHT, rgb, alpha: vec![1.0; PIXELS], depth: vec![4.0; PIXELS] }
}

fn right_half() -> Vec<bool> {
    (0..PIXELS).map(|i| i % WIDTH >= WIDTH / 2).collect()
}

fn assert_near(got: Option<f64>, want: f64) {
    assert!((got.unwrap() - want).abs() < 1e-4, "got {got:?}, want {want}");
}

#[test]
fn figures_by_motion_split_the_image() {
    let view = view(None);
    let figures = evaluate_view(&rendered(&view), &view, Some(&right_half()), None).unwrap();
    assert_near(figures.psnr, 10.0 * 200.0_f64.log10());
    assert_near(figures.psnr_dynamic, 20.0);
    assert_eq!(figures.psnr_static, Some(f64::INFINITY));
    assert_near(figures.dmae, (1.0 + 5.0) / 2.0);
    assert_eq!(figures.lpips, None);
    let [full, moving, standing] = [figures.ssim, figures.ssim_dynamic, figures.ssim_static].map(Option::unwrap);
    assert!((full - (moving + standing) / 2.0).abs() < 1e-9, "as many centres on either side");
    assert!(moving < standing && standing < 1.0, "{moving} {standing}");
}

#[test]
fn what_is_not_defined_is_none() {
    let mut view = view(None);
    view.depth_samples.clear();
    let rendered = rendered(&view);
    let figures = evaluate_view(&rendered, &view, None, None).unwrap();
    assert_eq!((figures.psnr_dynamic, figures.ssim_dynamic), (None, None));
    assert_eq!((figures.psnr_static, figures.ssim_static, figures.dmae), (None, None, None));
    let figures = evaluate_view(&rendered, &view, Some(&[false; PIXELS]), None).unwrap();
    assert_eq!((figures.psnr_dynamic, figures.ssim_dynamic), (None, None));
    assert_eq!((figures.psnr_static, figures.ssim_static), (figures.psnr, figures.ssim));
}

#[test]
fn ignored_pixels_are_in_no_figure() {
    let ignored = |i: usize| i % WIDTH >= WIDTH / 2;
    let labels = (0..PIXELS).map(|i| if ignored(i) { PixelLabel::Ignored } else { PixelLabel::Static }).collect();
    let mut view = view(Some(labels));
    view.depth_samples[1].pixel = 8;
    let figures = evaluate_view(&rendered(&view), &view, Some(&right_half()), None).unwrap();
    assert_eq!((figures.psnr, figures.ssim), (Some(f64::INFINITY), Some(1.0)));
    assert_eq!((figures.psnr_dynamic, figures.ssim_dynamic), (None, None));
    assert_eq!(figures.dmae, Some(1.0));
    view.labels = Some(vec![PixelLabel::Ignored; PIXELS]);
    assert_eq!(evaluate_view(&rendered(&view), &view, None, None).unwrap(), ViewFigures::default());
}

#[test]
fn values_that_are_not_finite_are_an_error_that_names_them() {
    let view = view(None);
    let mut spoiled = rendered(&view);
    spoiled.rgb[5] = f32::NAN;
    let message = evaluate_view(&spoiled, &view, None, None).unwrap_err().to_string();
    assert_eq!(message, "rendered colour 5 of frame 4 front: expected a finite value, found NaN");
    let mut spoiled = rendered(&view);
    spoiled.depth[7] = f32::INFINITY;
    let message = evaluate_view(&spoiled, &view, None, None).unwrap_err().to_string();
    assert_eq!(message, "rendered depth 7 of frame 4 front: expected a finite value, found inf");
}

#[test]
fn an_image_below_the_window_has_a_psnr_only() {
    let mut view = view(None);
    view.image = RgbImage { width: 2, height: 2, data: vec![0.5; 12] };
    view.depth_samples.clear();
    let rendered = Rendered { width: 2, height: 2, rgb: vec![0.25; 12], alpha: vec![1.0; 4], depth: vec![1.0; 4] };
    let figures = evaluate_view(&rendered, &view, Some(&[true, false, false, true]), None).unwrap();
    let psnr = Some(-10.0 * 0.0625_f64.log10());
    let want = ViewFigures { psnr, psnr_dynamic: psnr, psnr_static: psnr, ..ViewFigures::default() };
    assert_eq!(figures, want);
}
