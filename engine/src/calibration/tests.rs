//! Cameras before a wall whose pattern is known.

use lgs_formats::image::RgbImage;

use super::alignment::{Change, Detail, FIXED, Fold, MOUNT, Pair, Seen, align, shown};
use super::correlation;
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
        pixel_side: 1.0,
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

/// How an image of a camera of its own that stands shows a place.
fn seen(view: usize, place: [f32; 3]) -> Seen {
    Seen { view, camera: view, place, rate: [0.0; 3] }
}

/// Places on the wall in the axes of two cameras.
fn pairs(shift: f32) -> Vec<Pair> {
    let along = |k: u16| -3.0 + 6.0 * f32::from(k) / 79.0;
    let all = (0..80).flat_map(|row| (0..80).map(move |column| [along(column), along(row)]));
    let pair = |(point, [x, y]): (usize, [f32; 2])| Pair {
        point,
        seen: [seen(0, [x, y, WALL]), seen(1, [x - shift, y, WALL])],
    };
    all.enumerate().map(pair).collect()
}

#[test]
fn a_turned_camera_is_found() {
    let truth: Change = [0.004, -0.006, 0.003, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let views = [view(0.0, &Change::default()), view(0.5, &truth)];
    let pairs = pairs(0.5);
    let details: Vec<Detail> = views.iter().map(|view| Detail::new(view, 1)).collect();
    let stated = [Change::default(); 2];
    let found = align(&pairs, &details, &stated, &[FIXED, MOUNT], Fold::All, 8);
    assert_eq!(found[0], Change::default(), "the other one stays");
    // On one wall a small turn and a small shift look the same: what they do to the middle of it together is told.
    let [dx, dy] = [
        found[1][1] - truth[1] + found[1][3] / f64::from(WALL),
        truth[0] - found[1][0] + found[1][4] / f64::from(WALL),
    ];
    assert!(dx.abs() < 3e-4 && dy.abs() < 3e-4 && (found[1][2] - truth[2]).abs() < 3e-4, "{found:?}");
    let share = |changes: &[Change]| 1.0 - correlation(shown(&pairs, &details, changes, Fold::All).into_iter()).powi(2);
    assert!(share(&found) < 0.2 * share(&stated), "{} {}", share(&found), share(&stated));
    // Halves agree, and nothing is found where nothing is wrong.
    let halves = [Fold::Even, Fold::Odd].map(|fold| align(&pairs, &details, &stated, &[FIXED, MOUNT], fold, 8)[1]);
    let apart = |k: usize| (halves[0][k] - halves[1][k]).abs();
    assert!((0..3).all(|k| apart(k) < 1e-3) && (3..6).all(|k| apart(k) < 5e-3), "{halves:?}");
    let exact = [view(0.0, &Change::default()), view(0.5, &Change::default())];
    let details: Vec<Detail> = exact.iter().map(|view| Detail::new(view, 1)).collect();
    let found = align(&pairs, &details, &stated, &[FIXED, MOUNT], Fold::All, 8);
    let least = |k: usize| if k < 3 { 5e-4 } else { 4e-3 };
    assert!(found[1][..6].iter().enumerate().all(|(k, change)| change.abs() < least(k)), "{found:?}");
}

#[test]
fn what_says_nothing_changes_nothing() {
    let mut dark = view(0.0, &Change::default());
    dark.image.data.fill(0.0);
    let details = [Detail::new(&dark, 1), Detail::new(&dark, 1)];
    let stated = [Change::default(); 2];
    assert_eq!(align(&pairs(0.5), &details, &stated, &[FIXED, MOUNT], Fold::All, 3), stated);
    assert_eq!(align(&[], &details, &stated, &[FIXED, MOUNT], Fold::All, 3), stated);
    let behind = Pair { point: 0, seen: [seen(0, [0.0, 0.0, -1.0]), seen(1, [f32::NAN, 0.0, 1.0])] };
    assert_eq!(align(&[behind], &details, &stated, &[MOUNT; 2], Fold::All, 3), stated);
}

/// The image of a camera that drives ahead and is read out from the top down, before a wall that leans away to the right.
fn rolling(z: f64, moments: [f64; 2]) -> View {
    let mut view = view(0.0, &Change::default());
    view.pinhole.camera_from_clip[2][3] = lgs_formats::casts::to_f32(-z);
    let at = |p: usize| (p as f64 + 0.5) / SIDE as f64 - 0.5;
    for (i, pixel) in view.image.data.chunks_exact_mut(3).enumerate() {
        let [x, y] = [at(i % SIDE), at(i / SIDE)].map(|share| share * SIDE as f64 / f64::from(FOCAL));
        let centre = z + SPEED * (moments[0] + moments[1] * at(i / SIDE));
        // Depth of the wall `z = WALL + x / 2` along the pixel's ray.
        let depth = (f64::from(WALL) - centre) / (1.0 - 0.5 * x);
        pixel.fill(pattern(x * depth, y * depth));
    }
    view
}

const SPEED: f64 = 10.0;

#[test]
fn a_shutter_that_nobody_states_is_told() {
    let places = [0.0, 1.5, 3.0];
    let views = |moments| places.map(|z| rolling(z, moments));
    let shown = |k: usize, [x, y, z]: [f32; 3]| Seen {
        view: k,
        camera: 0,
        place: [x, y, z - lgs_formats::casts::to_f32(places[k])],
        rate: [0.0, 0.0, -10.0],
    };
    let along = |k: u16| -2.0 + 4.0 * f32::from(k) / 59.0;
    let on_wall = (0..60).flat_map(|row| (0..60).map(move |column| [along(column), along(row)]));
    let pairs: Vec<Pair> = on_wall
        .enumerate()
        .flat_map(|(point, [x, y])| {
            let place = [x, y, WALL + 0.5 * x];
            [(0, 1), (0, 2), (1, 2)].map(|(a, b)| Pair { point, seen: [shown(a, place), shown(b, place)] })
        })
        .collect();
    let free = std::array::from_fn(|k| k == 6 || k == 8);
    let found = |moments| {
        let details: Vec<Detail> = views(moments).iter().map(|view| Detail::new(view, 1)).collect();
        align(&pairs, &details, &[Change::default()], &[free], Fold::All, 10)[0]
    };
    // An image from nearer has coarser detail, which shifts both alike.
    let (told, at_once) = (found([-0.01, 0.04]), found([0.0, 0.0]));
    let [middle, down] = [6, 8].map(|k| told[k] - at_once[k]);
    assert!((middle + 0.01).abs() < 4e-3 && (down - 0.04).abs() < 8e-3, "{told:?} {at_once:?}");
    assert!(at_once[8].abs() < 5e-3, "{at_once:?}");
}
