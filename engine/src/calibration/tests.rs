//! Cameras before a wall whose pattern is known.

use lgs_formats::image::RgbImage;

use super::alignment::{Change, Detail, Fold, Pair, align, unexplained};
use crate::views::{PinholeView, Role, View};

const SIDE: usize = 96;
const FOCAL: f32 = 110.0;
const WALL: f32 = 8.0;

/// Brightness of the wall at a place on it, metres.
fn pattern(x: f64, y: f64) -> f32 {
    let waves = (2.3 * x + 0.7 * y).sin() + (1.9 * y - 1.1 * x).sin() + (4.1 * x).sin() * (3.7 * y).cos();
    #[expect(clippy::cast_possible_truncation, reason = "a colour")]
    let value = (0.4 + 0.1 * waves) as f32;
    value
}

/// The image of a camera at `x`, turned by `turn` and moved by `shift` against what its pose says.
fn view(x: f32, change: &Change) -> View {
    let pinhole = PinholeView {
        width: SIDE,
        height: SIDE,
        fx: FOCAL,
        fy: FOCAL,
        cx: SIDE as f32 / 2.0,
        cy: SIDE as f32 / 2.0,
        camera_from_clip: [[1.0, 0.0, 0.0, -x], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
        time: 0.0,
        shutter: None,
    };
    let turn = glam::DQuat::from_scaled_axis(glam::DVec3::new(change[0], change[1], change[2]));
    let centre = glam::DVec3::new(f64::from(x) + change[3], change[4], change[5]);
    let pixel = |i: usize| {
        let at = |p: usize| (p as f64 + 0.5 - SIDE as f64 / 2.0) / f64::from(FOCAL);
        let ray = turn * glam::DVec3::new(at(i % SIDE), at(i / SIDE), 1.0);
        let place = centre + ray * ((f64::from(WALL) - centre.z) / ray.z);
        [pattern(place.x, place.y); 3]
    };
    View {
        frame: 0,
        camera: format!("at {x}"),
        role: Role::Input,
        pinhole,
        image: RgbImage { width: SIDE, height: SIDE, data: (0..SIDE * SIDE).flat_map(pixel).collect() },
        response: None,
        labels: None,
        depth_map: None,
        depth_samples: Vec::new(),
    }
}

/// Places on the wall in the axes of two cameras.
fn pairs(shift: f32) -> Vec<Pair> {
    let along = |k: u16| -3.0 + 6.0 * f32::from(k) / 79.0;
    let all = (0..80).flat_map(|row| (0..80).map(move |column| [along(column), along(row)]));
    let pair = |(point, [x, y]): (usize, [f32; 2])| Pair {
        point,
        views: [0, 1],
        cameras: [0, 1],
        places: [[x, y, WALL], [x - shift, y, WALL]],
    };
    all.enumerate().map(pair).collect()
}

#[test]
fn a_turned_camera_is_found() {
    let truth: Change = [0.004, -0.006, 0.003, 0.0, 0.0, 0.0];
    let views = [view(0.0, &Change::default()), view(0.5, &truth)];
    let pairs = pairs(0.5);
    let details: Vec<Detail> = views.iter().map(|view| Detail::new(view, 1)).collect();
    let stated = [Change::default(); 2];
    let found = align(&pairs, &details, &stated, &[false, true], Fold::All, 8);
    assert_eq!(found[0], Change::default(), "the other one stays");
    // On one wall a small turn and a small shift look the same: what they do to the middle of it together is told.
    let [dx, dy] = [
        found[1][1] - truth[1] + found[1][3] / f64::from(WALL),
        truth[0] - found[1][0] + found[1][4] / f64::from(WALL),
    ];
    assert!(dx.abs() < 3e-4 && dy.abs() < 3e-4 && (found[1][2] - truth[2]).abs() < 3e-4, "{found:?}");
    let share = |changes: &[Change]| unexplained(&pairs, &details, changes, Fold::All, &|_| true).0;
    assert!(share(&found) < 0.2 * share(&stated), "{} {}", share(&found), share(&stated));
    // Halves agree, and nothing is found where nothing is wrong.
    let halves = [Fold::Even, Fold::Odd].map(|fold| align(&pairs, &details, &stated, &[false, true], fold, 8)[1]);
    let apart = |k: usize| (halves[0][k] - halves[1][k]).abs();
    assert!((0..3).all(|k| apart(k) < 1e-3) && (3..6).all(|k| apart(k) < 5e-3), "{halves:?}");
    let exact = [view(0.0, &Change::default()), view(0.5, &Change::default())];
    let details: Vec<Detail> = exact.iter().map(|view| Detail::new(view, 1)).collect();
    let found = align(&pairs, &details, &stated, &[false, true], Fold::All, 8);
    let least = |k: usize| if k < 3 { 5e-4 } else { 4e-3 };
    assert!(found[1].iter().enumerate().all(|(k, change)| change.abs() < least(k)), "{found:?}");
}

#[test]
fn what_says_nothing_changes_nothing() {
    let mut dark = view(0.0, &Change::default());
    dark.image.data.fill(0.0);
    let details = [Detail::new(&dark, 1), Detail::new(&dark, 1)];
    let stated = [Change::default(); 2];
    assert_eq!(align(&pairs(0.5), &details, &stated, &[false, true], Fold::All, 3), stated);
    assert_eq!(align(&[], &details, &stated, &[false, true], Fold::All, 3), stated);
    let behind = Pair { point: 0, views: [0, 1], cameras: [0, 1], places: [[0.0, 0.0, -1.0], [f32::NAN, 0.0, 1.0]] };
    assert_eq!(align(&[behind], &details, &stated, &[true, true], Fold::All, 3), stated);
}
