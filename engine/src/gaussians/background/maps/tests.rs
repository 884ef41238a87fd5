use lgs_formats::image::DepthMap;

use super::*;
use crate::views::{
    DepthSample, PinholeView,
    samples::{ahead, seen},
};

const WIDTH: usize = 40;
const HEIGHT: usize = 24;

/// Depth of a pixel, metres: a floor that rises to a wall, sky in the highest rows.
fn depth(pixel: usize) -> f32 {
    match pixel / WIDTH {
        0..4 => f32::INFINITY,
        row @ 4..12 => 30.0 + row as f32 * 0.1 + (pixel % WIDTH) as f32 * 0.2,
        row => 60.0 / (row as f32 - 8.0),
    }
}

/// A view whose returns lie on every third pixel of what is not sky; every `wrong`-th return is of something else.
fn view(frame: usize, map: Option<DepthMap>, wrong: usize) -> View {
    let pinhole = PinholeView { time: 0.1 * frame as f32, ..ahead(WIDTH, HEIGHT, 30.0) };
    let sample = |pixel: u32| DepthSample {
        pixel,
        depth: if wrong > 0 && (pixel as usize).is_multiple_of(wrong) { 7.0 } else { depth(pixel as usize) },
    };
    View {
        frame,
        depth_map: map,
        depth_samples: (160..960).step_by(3).map(sample).collect(),
        ..seen(pinhole, vec![0.5; 3 * WIDTH * HEIGHT])
    }
}

fn map(kind: DepthKind, of_inverse: impl Fn(f32) -> f32) -> Option<DepthMap> {
    Some(DepthMap { kind, inverse: (0..WIDTH * HEIGHT).map(|pixel| of_inverse(1.0 / depth(pixel))).collect() })
}

#[test]
fn a_relative_map_is_brought_to_metres_whatever_its_scale() {
    for wrong in [0, 4] {
        let view = view(0, map(DepthKind::Relative, |w| 40_000.0 * w + 900.0), wrong);
        let aligned = sheets(&[&view], &cloud(), 1000.0);
        let fit = &aligned.fits[0];
        assert!(fit.used && fit.returns == 267, "{fit:?}");
        assert!((fit.scale * 40_000.0 - 1.0).abs() < 1e-4 && (fit.shift + 900.0 / 40_000.0).abs() < 1e-5, "{fit:?}");
        for (pixel, &w) in aligned.sheets[0].inverse_depths.iter().enumerate() {
            let want = (1.0 / depth(pixel)).max(slant(&view.pinhole, pixel) / 1000.0);
            assert!((w - want).abs() < 1e-5, "{pixel}: {w}, want {want}");
        }
    }
}

#[test]
fn a_metric_map_that_is_right_stays_as_it_is_and_one_that_is_not_is_mended() {
    let right = fit(&view(0, map(DepthKind::Metric, |w| w), 0)).unwrap();
    assert_eq!((right.scale, right.shift, right.used), (1.0, 0.0, true));
    assert!(right.error.unwrap() < 1e-6 && right.inliers.unwrap() > 0.999, "{right:?}");
    let wrong = fit(&view(0, map(DepthKind::Metric, |w| if w > 0.0 { 1.3 * w + 0.004 } else { w }), 0)).unwrap();
    assert!((wrong.scale - 1.0 / 1.3).abs() < 1e-4 && wrong.used, "{wrong:?}");
    let few = View { depth_samples: Vec::new(), ..view(0, map(DepthKind::Metric, |w| w), 0) };
    let few = fit(&few).unwrap();
    assert_eq!((few.scale, few.shift, few.used, few.error, few.returns), (1.0, 0.0, true, None, 0));
}

#[test]
fn maps_that_say_nothing_are_not_used() {
    for values in [|_: f32| 3.0, |w: f32| -w, |w: f32| ((w * 1e4).sin() + 2.0) * 1e3] {
        let fit = fit(&view(0, map(DepthKind::Relative, values), 0)).unwrap();
        assert!(!fit.used, "{fit:?}");
    }
    let few = View { depth_samples: Vec::new(), ..view(0, map(DepthKind::Relative, |w| w), 0) };
    assert!(!fit(&few).unwrap().used);
    assert_eq!(fit(&view(0, None, 0)), None);
    // The search takes over for such a view alone.
    let views = [view(0, map(DepthKind::Relative, |w| 2.0 * w), 0), view(1, None, 0)];
    let aligned = sheets(&[&views[0], &views[1]], &cloud(), 1000.0);
    assert_eq!((aligned.sheets.len(), aligned.fits.len(), aligned.fits[0].used), (2, 1, true));
    assert!((aligned.sheets[0].inverse_depths[500] - 1.0 / depth(500)).abs() < 1e-5);
}

#[test]
fn what_stays_near_while_the_camera_drives_is_the_own_vehicle() {
    // Both frames show a bonnet 2 m ahead at the lower edge, before a wall that comes 3 m nearer.
    let drive = |frame: usize| {
        let ahead = 3.0 * frame as f32;
        let depth = |pixel: usize| if pixel / WIDTH >= 21 { 2.0 } else { 40.0 - ahead };
        let inverse = (0..WIDTH * HEIGHT).map(|pixel| 1.0 / depth(pixel)).collect();
        let mut view = view(frame, Some(DepthMap { kind: DepthKind::Metric, inverse }), 0);
        view.pinhole.camera_from_clip[2][3] = -ahead;
        view.depth_samples = (0..600).map(|pixel| DepthSample { pixel, depth: 40.0 - ahead }).collect();
        view
    };
    let views = [drive(0), drive(1)];
    let aligned = sheets(&[&views[0], &views[1]], &cloud(), 1000.0);
    let trust = &aligned.sheets[1].trust;
    assert_eq!(trust[10 * WIDTH + 20], Trust::Confirmed);
    assert_eq!(trust[22 * WIDTH + 20], Trust::OwnVehicle);
}

fn cloud() -> PointCloud {
    PointCloud { positions: vec![[0.0, 0.0, 10.0]; 4], times: vec![0.0; 4], ..PointCloud::default() }
}
