use std::time::{Duration, Instant};

use proptest::prelude::*;

use super::*;

/// A truth with edges and flat parts, and a rendered image that differs from it.
struct Images {
    truth: Vec<f32>,
    rendered: Vec<f32>,
    width: usize,
    height: usize,
}

impl Images {
    fn new(width: usize, height: usize) -> Self {
        let value = |i: usize, speed: f32| {
            let (x, y, c) = ((i / 3 % width) as f32, (i / 3 / width) as f32, (i % 3) as f32);
            let wave = (speed * (x * 0.31 + c)).sin() * (y * 0.23 * speed).cos();
            if x + y < 9.0 { 0.95 } else { 0.5 + 0.45 * wave }
        };
        let truth = (0..3 * width * height).map(|i| value(i, 1.0)).collect();
        let rendered = (0..3 * width * height).map(|i| 0.8 * value(i, 1.0) + 0.15 * value(i, 2.7)).collect();
        Self { truth, rendered, width, height }
    }

    fn pair(&self) -> ImagePair<'_> {
        ImagePair { truth: &self.truth, rendered: &self.rendered, width: self.width, height: self.height }
    }
}

fn gradient_of(pair: &ImagePair, labels: Option<&[PixelLabel]>, weight: f32) -> (Option<f64>, Vec<f32>) {
    let mut gradient = vec![0.0; pair.truth.len()];
    let value = add_ssim_gradient(pair, labels, weight, &mut gradient);
    (value, gradient)
}

fn assert_close(got: &[f32], want: &[f64], tolerance: f64) {
    let scale = want.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    for (i, (g, w)) in got.iter().zip(want).enumerate() {
        assert!((f64::from(*g) - w).abs() <= tolerance * scale, "value {i}: got {g}, want {w}, scale {scale}");
    }
}

#[test]
fn the_twins_gradient_is_its_finite_difference() {
    let images = Images::new(14, 13);
    let (_, gradient) = reference::ssim(&images.pair(), |_, _| true);
    for i in (0..gradient.len()).step_by(7) {
        let moved = |by: f32| {
            let mut rendered = images.rendered.clone();
            rendered[i] += by;
            let value = reference::ssim(&ImagePair { rendered: &rendered, ..images.pair() }, |_, _| true).0;
            (value, f64::from(rendered[i]))
        };
        let (above, below) = (moved(1e-3), moved(-1e-3));
        let want = (above.0 - below.0) / (above.1 - below.1);
        assert!((gradient[i] - want).abs() < 1e-5, "value {i}: got {}, want {want}", gradient[i]);
    }
}

#[test]
fn value_and_gradient_equal_the_twin_at_every_small_size() {
    for (width, height) in [(11, 11), (11, 12), (12, 11), (13, 29), (31, 17), (40, 11)] {
        let images = Images::new(width, height);
        let (got, gradient) = gradient_of(&images.pair(), None, 1.0);
        let (want, want_gradient) = reference::ssim(&images.pair(), |_, _| true);
        assert!((got.unwrap() - want).abs() < 1e-6, "{width}x{height}: got {got:?}, want {want}");
        assert_close(&gradient, &want_gradient, 1e-4);
        let map = similarity_map(&images.pair()).unwrap();
        assert_eq!((map.width, map.height), (width - 10, height - 10));
        assert!((map.mean_where(|_| true).unwrap() - got.unwrap()).abs() < 1e-12);
    }
}

#[test]
fn ignored_centres_are_left_out_of_the_mean_and_of_the_gradient() {
    let images = Images::new(21, 19);
    let labels: Vec<PixelLabel> =
        (0..21 * 19).map(|i| if i % 21 < 8 && i / 21 > 6 { PixelLabel::Ignored } else { PixelLabel::Static }).collect();
    let (got, gradient) = gradient_of(&images.pair(), Some(&labels), 1.0);
    let keep = |row: usize, column: usize| labels[row * 21 + column] != PixelLabel::Ignored;
    let (want, want_gradient) = reference::ssim(&images.pair(), keep);
    assert!((got.unwrap() - want).abs() < 1e-6, "got {got:?}, want {want}");
    assert_close(&gradient, &want_gradient, 1e-4);
    let masked = similarity_map(&images.pair()).unwrap().mean_where(|pixel| keep(pixel / 21, pixel % 21));
    assert!((masked.unwrap() - want).abs() < 1e-6);
}

#[test]
fn undefined_means_none_and_an_untouched_gradient() {
    for (width, height) in [(10, 40), (40, 10), (0, 0), (1, 1)] {
        let images =
            Images { truth: vec![0.5; 3 * width * height], rendered: vec![0.25; 3 * width * height], width, height };
        assert_eq!(gradient_of(&images.pair(), None, 1.0), (None, vec![0.0; 3 * width * height]));
        assert_eq!(similarity_map(&images.pair()), None);
    }
    let images = Images::new(12, 12);
    let (value, gradient) = gradient_of(&images.pair(), Some(&[PixelLabel::Ignored; 144]), 1.0);
    assert_eq!(value, None);
    assert!(gradient.iter().all(|&g| g == 0.0));
    assert_eq!(similarity_map(&images.pair()).unwrap().mean_where(|_| false), None);
}

#[test]
fn the_gradient_is_added_with_its_weight() {
    let images = Images::new(16, 16);
    let (_, once) = gradient_of(&images.pair(), None, 1.0);
    let mut gradient = vec![2.0; once.len()];
    add_ssim_gradient(&images.pair(), None, -0.5, &mut gradient);
    for (g, o) in gradient.iter().zip(&once) {
        assert!((g - (2.0 - 0.5 * o)).abs() < 1e-6);
    }
}

#[test]
fn flat_images_keep_their_precision() {
    for i in 0..=400 {
        let (a, b) = ((i % 21) as f32 / 20.0, (i / 21) as f32 / 20.0);
        let images = Images { truth: vec![a; 3 * 400], rendered: vec![b; 3 * 400], width: 20, height: 20 };
        let (a, b) = (f64::from(a), f64::from(b));
        let want = (2.0 * a * b + 1e-4) / (a * a + b * b + 1e-4);
        let got = gradient_of(&images.pair(), None, 1.0).0.unwrap();
        assert!((got - want).abs() < 1e-5, "{a} {b}: got {got}, want {want}");
    }
}

#[test]
fn bits_do_not_depend_on_the_number_of_threads() {
    let images = Images::new(95, 77);
    let labels: Vec<PixelLabel> =
        (0..95 * 77).map(|i| if i % 11 == 0 { PixelLabel::Ignored } else { PixelLabel::Static }).collect();
    let with_threads = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| (gradient_of(&images.pair(), Some(&labels), 1.0), similarity_map(&images.pair())))
    };
    let one = with_threads(1);
    assert_eq!(one, with_threads(2));
    assert_eq!(one, with_threads(5));
}

#[test]
fn values_that_are_not_finite_do_not_panic_and_show_in_the_mean() {
    let mut images = Images::new(24, 24);
    images.rendered[24 * 3 * 12 + 36] = f32::NAN;
    let (value, gradient) = gradient_of(&images.pair(), None, 1.0);
    assert!(value.unwrap().is_nan());
    assert!(gradient[0].is_finite(), "a pixel that shares no window with the bad one keeps its gradient");
}

/// Shortest of a few runs.
fn shortest(runs: usize, mut action: impl FnMut()) -> Duration {
    (0..runs)
        .map(|_| {
            let start = Instant::now();
            action();
            start.elapsed()
        })
        .min()
        .unwrap()
}

#[test]
fn a_real_size_equals_the_twin_in_a_small_part_of_its_time() {
    let images = Images::new(121, 76);
    let (mut fast, mut slow) = (None, None);
    let fast_time = shortest(5, || fast = Some(gradient_of(&images.pair(), None, 1.0)));
    let slow_time = shortest(1, || slow = Some(reference::ssim(&images.pair(), |_, _| true)));
    let ((value, gradient), (want, want_gradient)) = (fast.unwrap(), slow.unwrap());
    assert!((value.unwrap() - want).abs() < 1e-6);
    assert_close(&gradient, &want_gradient, 1e-4);
    assert!(fast_time * 5 < slow_time, "fast {fast_time:?}, twin {slow_time:?}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    #[test]
    fn equals_the_twin_on_noise(
        width in 11_usize..20,
        height in 11_usize..20,
        noise in prop::collection::vec((0.0_f32..1.0, 0.0_f32..1.0), 20 * 20 * 3),
    ) {
        let (truth, rendered) = noise.into_iter().take(width * height * 3).unzip();
        let images = Images { truth, rendered, width, height };
        let (value, gradient) = gradient_of(&images.pair(), None, 1.0);
        let (want, want_gradient) = reference::ssim(&images.pair(), |_, _| true);
        // One window of f32 moments: a variance of 0.1 is 1e-7 off, and what it is divided by is not much larger.
        prop_assert!((value.unwrap() - want).abs() < 3e-6, "{value:?}, want {want}");
        assert_close(&gradient, &want_gradient, 1e-4);
    }

    #[test]
    fn the_similarity_of_an_image_with_itself_is_one_without_slope(
        image in prop::collection::vec(0.0_f32..1.0, 15 * 12 * 3),
    ) {
        let pair = ImagePair { truth: &image, rendered: &image, width: 15, height: 12 };
        let (value, gradient) = gradient_of(&pair, None, 1.0);
        prop_assert_eq!(value, Some(1.0));
        prop_assert!(gradient.iter().all(|g| g.abs() < 1e-9));
    }
}
