//! Resampling against sums worked out pixel by pixel, and undistortion against a picture drawn through the lens.

use proptest::prelude::*;

use super::*;
use crate::{
    camera::{Camera, Distortion, Intrinsics},
    pose::Pose,
};

fn source(width: usize, height: usize, rgb: &[u8]) -> Source<'_> {
    Source { width, height, rectified: [width, height], rgb, mask: None, lens: None }
}

fn size(height: usize, width: usize) -> ImageSize {
    ImageSize { height, width }
}

/// The mean over the area of an output pixel, by the share of each input pixel, in f64.
fn area_mean(source: &Source<'_>, to: ImageSize, x: usize, y: usize, channel: usize) -> f64 {
    let share = |i: usize, o: usize, scale: f64| {
        let (low, high) = (o as f64 * scale, (o + 1) as f64 * scale);
        (high.min(i as f64 + 1.0) - low.max(i as f64)).max(0.0) / scale
    };
    let (sx, sy) = (source.width as f64 / to.width as f64, source.height as f64 / to.height as f64);
    let pixels = (0..source.width * source.height).map(|k| (k % source.width, k / source.width));
    pixels
        .map(|(i, j)| share(i, x, sx) * share(j, y, sy) * f64::from(source.rgb[(j * source.width + i) * 3 + channel]))
        .sum::<f64>()
        / 255.0
}

proptest! {
    #[test]
    fn downward_is_the_mean_of_the_area(
        (w, h) in (1_usize..20, 1_usize..20),
        (ow, oh) in (1_usize..20, 1_usize..20),
        seed in prop::collection::vec(any::<u8>(), 20 * 20 * 3),
    ) {
        let to = size(oh.min(h), ow.min(w));
        let source = source(w, h, &seed[..w * h * 3]);
        let (image, labels) = source.resized(to);
        prop_assert_eq!(labels, None);
        for (k, &got) in image.data.iter().enumerate() {
            let want = area_mean(&source, to, k / 3 % to.width, k / 3 / to.width, k % 3);
            prop_assert!((f64::from(got) - want).abs() < 1e-6, "{} {} {}", k, got, want);
        }
    }

    #[test]
    fn any_size_keeps_a_constant_image_and_its_range((w, h) in (1_usize..30, 1_usize..30), (ow, oh) in (1_usize..60, 1_usize..60), v: u8) {
        let rgb = vec![v; w * h * 3];
        let (image, _) = source(w, h, &rgb).resized(size(oh, ow));
        prop_assert_eq!(image.data.len(), ow * oh * 3);
        let want = f32::from(v) / 255.0;
        prop_assert!(image.data.iter().all(|&got| (got - want).abs() < 1e-6));
    }

    #[test]
    fn a_pixel_is_ignored_if_any_of_its_area_is((w, h) in (1_usize..20, 1_usize..20), (ow, oh) in (1_usize..20, 1_usize..20), at in any::<prop::sample::Index>()) {
        let to = size(oh.min(h), ow.min(w));
        let rgb = vec![0; w * h * 3];
        let mut mask = vec![255; w * h];
        let hole = at.index(w * h);
        mask[hole] = 0;
        let (_, labels) = Source { mask: Some(mask), ..source(w, h, &rgb) }.resized(to);
        let overlaps = |i: usize, o: usize, input: usize, output: usize| i * output < (o + 1) * input && o * input < (i + 1) * output;
        for (k, label) in labels.unwrap().into_iter().enumerate() {
            let touched = overlaps(hole % w, k % to.width, w, to.width) && overlaps(hole / w, k / to.width, h, to.height);
            prop_assert_eq!(label, if touched { PixelLabel::Ignored } else { PixelLabel::Static });
        }
    }
}

#[test]
fn the_same_size_gives_the_same_bits() {
    let rgb: Vec<u8> = (0..7 * 5 * 3).map(|i| u8::try_from(i * 37 % 256).unwrap()).collect();
    let (image, _) = source(7, 5, &rgb).resized(size(5, 7));
    assert!(image.data.iter().zip(&rgb).all(|(&v, &b)| v.to_bits() == (f32::from(b) / 255.0).to_bits()));
}

#[test]
fn upward_is_linear_between_centres() {
    let rgb = [0, 0, 0, 100, 100, 100, 200, 200, 200];
    let (image, _) = source(3, 1, &rgb).resized(size(1, 6));
    let want = [0.0, 25.0, 75.0, 125.0, 175.0, 200.0]; // centres at 0.25, 0.75, .. of pixels with centres 0.5, 1.5, 2.5
    for (k, want) in want.into_iter().enumerate() {
        assert!((image.data[3 * k] * 255.0 - want).abs() < 1e-4, "{k}: {} {want}", image.data[3 * k] * 255.0);
    }
}

#[test]
fn the_label_of_more_than_half_wins() {
    let rgb = [0; 4 * 3];
    let with = |mask: [u8; 4]| {
        let (_, labels) = Source { mask: Some(mask.to_vec()), ..source(2, 2, &rgb) }.resized(size(1, 1));
        labels.unwrap()[0]
    };
    assert_eq!(with([255, 255, 255, 255]), PixelLabel::Static);
    assert_eq!(with([1, 254, 255, 255]), PixelLabel::Static);
    assert_eq!(with([1, 254, 7, 255]), PixelLabel::Dynamic);
    assert_eq!(with([1, 254, 7, 0]), PixelLabel::Ignored);
}

const WIDTH: usize = 160;
const HEIGHT: usize = 120;

fn camera(distortion: [f64; 5]) -> Camera {
    Camera {
        name: "c".to_owned(),
        timestamp: 0.0,
        width: u32::try_from(WIDTH).unwrap(),
        height: u32::try_from(HEIGHT).unwrap(),
        intrinsics: Intrinsics { fx: 100.0, fy: 105.0, cx: 79.0, cy: 62.0 },
        distortion: Some(Distortion::BrownConrady(distortion)),
        readout: None,
        world_from_camera: Pose::IDENTITY,
    }
}

/// A smooth picture of the rays `(x, y, 1)`.
fn picture(x: f64, y: f64) -> [f64; 3] {
    [0.5 + 0.4 * (6.0 * x).sin(), 0.5 + 0.4 * (6.0 * y).cos(), 0.5 + 0.4 * (4.0 * (x + y)).sin()]
}

/// The nearest byte of a value in 0..=1.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the picture's values lie in 0.1..=0.9")]
fn byte(value: f64) -> u8 {
    (value * 255.0).round() as u8
}

/// What a camera with this lens shows of the picture: each pixel's ray by fixed-point iteration of the forward model.
fn photograph(distortion: [f64; 5]) -> Vec<u8> {
    let k = camera(distortion).intrinsics;
    let [k1, k2, p1, p2, k3] = distortion;
    let mut rgb = Vec::new();
    for index in 0..WIDTH * HEIGHT {
        let (u, v) = ((index % WIDTH) as f64 + 0.5, (index / WIDTH) as f64 + 0.5);
        let (xd, yd) = ((u - k.cx) / k.fx, (v - k.cy) / k.fy);
        let (mut x, mut y) = (xd, yd);
        for _ in 0..50 {
            let r2 = x * x + y * y;
            let radial = 1.0 + k1 * r2 + k2 * r2 * r2 + k3 * r2 * r2 * r2;
            let next_x = (xd - 2.0 * p1 * x * y - p2 * (r2 + 2.0 * x * x)) / radial;
            y = (yd - p1 * (r2 + 2.0 * y * y) - 2.0 * p2 * x * y) / radial;
            x = next_x;
        }
        rgb.extend(picture(x, y).map(byte));
    }
    rgb
}

#[test]
fn a_rectified_photograph_is_the_picture() {
    for distortion in [[-0.15, 0.02, 0.002, -0.003, 0.001], [0.1, 0.01, -0.002, 0.001, 0.0]] {
        let rgb = photograph(distortion);
        let lens = Lens::new(&camera(distortion)).unwrap();
        let (image, labels) =
            Source { lens: Some(lens.clone()), ..source(WIDTH, HEIGHT, &rgb) }.resized(size(HEIGHT, WIDTH));
        let k = camera(distortion).intrinsics;
        let mut valid = 0;
        for (index, pixel) in image.data.chunks_exact(3).enumerate() {
            if labels.as_ref().is_some_and(|labels| labels[index] == PixelLabel::Ignored) {
                continue;
            }
            valid += 1;
            let (u, v) = ((index % WIDTH) as f64 + 0.5, (index / WIDTH) as f64 + 0.5);
            let want = picture((u - k.cx) / k.fx, (v - k.cy) / k.fy);
            let [u_source, v_source] = lens.source_of(u, v).unwrap();
            let centres = |side: usize| 0.5..=side as f64 - 0.5; // outside, the edge is repeated
            let on_edge = !centres(WIDTH).contains(&u_source) || !centres(HEIGHT).contains(&v_source);
            for (got, want) in pixel.iter().zip(want) {
                let tolerance = if on_edge { 0.03 } else { 0.005 };
                assert!((f64::from(*got) - want).abs() < tolerance, "{distortion:?} ({u}, {v}): {got} {want}");
            }
        }
        assert!(valid > WIDTH * HEIGHT * 3 / 4, "{valid}");
        // A pincushion lens shows less than the pinhole asks for, a barrel lens more.
        assert_eq!(labels.is_some(), distortion[0] > 0.0);
    }
}

#[test]
fn what_folds_over_is_ignored_and_what_does_not_is_kept() {
    // r (1 - r2) grows up to r = 0.577, which lies inside the image; its corners would repeat the middle.
    let distortion = [-1.0, 0.0, 0.0, 0.0, 0.0];
    let rgb = vec![200; WIDTH * HEIGHT * 3];
    let lens = Lens::new(&camera(distortion));
    let (_, labels) = Source { lens, ..source(WIDTH, HEIGHT, &rgb) }.resized(size(HEIGHT, WIDTH));
    let k = camera(distortion).intrinsics;
    for (index, label) in labels.unwrap().into_iter().enumerate() {
        let x = ((index % WIDTH) as f64 + 0.5 - k.cx) / k.fx;
        let y = ((index / WIDTH) as f64 + 0.5 - k.cy) / k.fy;
        let inside = x * x + y * y < 1.0 / 3.0;
        assert_eq!(label, if inside { PixelLabel::Static } else { PixelLabel::Ignored }, "({x}, {y})");
    }
}

#[test]
fn the_mask_goes_through_the_lens_with_the_image() {
    let distortion = [-0.15, 0.02, 0.0, 0.0, 0.0];
    let rgb = vec![0; WIDTH * HEIGHT * 3];
    let bright = |index: usize| index % WIDTH >= 100;
    let mask: Vec<u8> = (0..WIDTH * HEIGHT).map(|i| if bright(i) { 100 } else { 255 }).collect();
    let lens = Lens::new(&camera(distortion)).unwrap();
    let source = Source { lens: Some(lens.clone()), mask: Some(mask), ..source(WIDTH, HEIGHT, &rgb) };
    let (_, labels) = source.resized(size(HEIGHT, WIDTH));
    for (index, label) in labels.unwrap().into_iter().enumerate() {
        let [u, _] = lens.source_of((index % WIDTH) as f64 + 0.5, (index / WIDTH) as f64 + 0.5).unwrap();
        assert_eq!(label, if u > 100.0 { PixelLabel::Dynamic } else { PixelLabel::Static }, "{index} {u}");
    }
}

#[test]
fn white_stays_white_however_many_pixels_are_one() {
    let camera = |[width, height]: [u32; 2], distortion| Camera {
        name: "c".to_owned(),
        timestamp: 0.0,
        width,
        height,
        intrinsics: Intrinsics { fx: 900.0, fy: 900.0, cx: 400.0, cy: 300.0 },
        distortion,
        readout: None,
        world_from_camera: Pose::IDENTITY,
    };
    let bent = Distortion::BrownConrady([-0.2, 0.05, 1e-3, -1e-3, 0.0]);
    for (sides, distortion) in [([16, 41_003], None), ([30_011, 3], None), ([800, 600], Some(bent))] {
        let [width, height] = sides.map(|side| side as usize);
        let rgb = vec![255; width * height * 3];
        let source = Source { lens: Lens::new(&camera(sides, distortion)), ..source(width, height, &rgb) };
        for size in [size(8, 12), size(7, 301)] {
            let (image, _) = source.resized(size);
            assert!(image.data.iter().all(|v| (0.0..=1.0).contains(v)), "{width}x{height} to {size}");
            assert!(image.data.iter().any(|&v| v > 0.999), "{width}x{height} to {size}");
        }
    }
}
