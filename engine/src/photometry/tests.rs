//! Cameras of known responses before a wall.

use super::{Photometry, put_aside};
use crate::views::{
    DepthSample, PinholeView, Projected, Response, View,
    samples::{ahead, seen},
};

const WIDTH: usize = 96;
const HEIGHT: usize = 64;
/// Distance of the wall, metres.
const WALL: f32 = 10.0;

/// The colour of the wall at a place: smooth, so that a pixel is like its neighbours.
fn wall([x, y, _]: [f32; 3]) -> [f32; 3] {
    let wave = |speed: f32, shift: f32| 0.4 + 0.25 * (speed * x + shift).sin() * (0.5 * speed * y + shift).cos();
    [wave(0.6, 0.0), wave(0.4, 1.0), wave(0.5, 2.0)]
}

/// What a camera so far to the right sees of it through a response.
fn view(camera: &str, frame: usize, right: f32, response: Response) -> View {
    let mut pinhole = PinholeView { time: 0.1 * frame as f32, ..ahead(WIDTH, HEIGHT, 60.0) };
    pinhole.camera_from_clip[0][3] = -right;
    let at = |i: usize| Projected { u: (i % WIDTH) as f32 + 0.5, v: (i / WIDTH) as f32 + 0.5, depth: WALL };
    let mut data: Vec<f32> = (0..WIDTH * HEIGHT).flat_map(|i| wall(pinhole.unproject(at(i)))).collect();
    response.show(&mut data, &pinhole);
    let sample = |pixel: usize| DepthSample { pixel: u32::try_from(pixel).unwrap(), depth: WALL };
    let depth_samples = (0..WIDTH * HEIGHT).step_by(3).map(sample).collect();
    View { frame, camera: camera.to_owned(), depth_samples, ..seen(pinhole, data) }
}

fn rig(second: Response) -> Vec<View> {
    let frame_views = |frame: usize| {
        let moved = 0.8 * frame as f32;
        [view("a", frame, moved, Response::IDENTITY), view("b", frame, moved + 4.0, second)]
    };
    (0..3).flat_map(frame_views).collect()
}

#[test]
fn cameras_that_agree_and_one_alone_stay_as_they_are() {
    assert_eq!(Photometry::estimate(&rig(Response::IDENTITY), None), None);
    let dark = Response { gain: [0.5; 3], ..Response::IDENTITY };
    let alone: Vec<View> = rig(dark).into_iter().filter(|view| view.camera == "b").collect();
    assert_eq!(Photometry::estimate(&alone, None), None);
}

#[test]
fn a_response_is_found_again_and_undone() {
    let second = Response { gain: [0.6, 0.7, 0.8], tone: 0.9, vignetting: [0.3, 0.0], grey: false, shoulder: false };
    let mut views = rig(second);
    let taken = views.clone();
    let found = Photometry::estimate(&views, None).unwrap();
    assert_eq!((found.reference.as_str(), found.brightness), ("a", 1.0));
    for view in &mut views {
        view.make_common(found.response(&view.camera, view.pinhole.time));
    }
    let truth = rig(Response::IDENTITY);
    for ((common, taken), truth) in views.iter().zip(&taken).zip(&truth) {
        for (got, want) in common.image.data.iter().zip(&truth.image.data) {
            assert!((got - want).abs() < 0.03, "{}: got {got}, want {want}", common.camera);
        }
        for (got, want) in common.as_taken().image.data.iter().zip(&taken.image.data) {
            assert!((got - want).abs() < 1e-5, "back again: got {got}, want {want}");
        }
    }
}

#[test]
fn one_camera_is_freed_from_its_vignetting_and_white_stays_white() {
    let lens = Response { vignetting: [0.5, 0.1], shoulder: true, ..Response::IDENTITY };
    let drive = |lens: Response| -> Vec<View> {
        let gain = |frame: usize| Response { gain: [0.95 + 0.05 * frame as f32; 3], ..lens };
        (0..3).map(|frame| view("a", frame, 2.0 * frame as f32, gain(frame))).collect()
    };
    let (mut views, taken) = (drive(lens), drive(lens));
    let found = Photometry::estimate(&views, None).unwrap();
    assert_eq!(found.brightness, 1.0);
    assert!(found.in_words().starts_with("freed from vignetting"), "{}", found.in_words());
    for view in &mut views {
        view.make_common(found.response(&view.camera, view.pinhole.time));
    }
    for (common, taken) in views.iter().zip(&taken) {
        let mut truth = view("a", common.frame, 2.0 * common.frame as f32, Response::IDENTITY);
        truth
            .image
            .data
            .iter_mut()
            .zip(&common.image.data)
            .for_each(|(truth, common)| *truth = (*truth - common).abs());
        let mean = truth.image.data.iter().sum::<f32>() / truth.image.data.len() as f32;
        assert!(mean < 0.015, "frame {}: {mean}", common.frame);
        for (got, want) in common.as_taken().image.data.iter().zip(&taken.image.data) {
            assert!((got - want).abs() < 1e-4, "back again: got {got}, want {want}");
        }
    }
    let response = Response { gain: [1.3; 3], ..found.images[0].response };
    let mut white = vec![1.0; 3 * WIDTH * HEIGHT];
    response.to_common(&mut white, &taken[0].pinhole);
    assert!(white.iter().all(|&value| value > 0.995));
    response.show(&mut white, &taken[0].pinhole);
    assert!(white.iter().all(|&value| value > 0.995));
}

#[test]
fn common_colours_hold_what_the_reference_clips() {
    let dark = Response { gain: [0.5; 3], ..Response::IDENTITY };
    let found = Photometry::estimate(&rig(dark), Some("b")).unwrap();
    assert_eq!(found.reference, "b");
    // What `a` shows as 0.65 is 0.33 in the colours of `b`: nothing is clipped.
    assert_eq!(found.brightness, 1.0);
    let bright = Response { gain: [1.5; 3], ..Response::IDENTITY };
    let found = Photometry::estimate(&rig(bright), Some("b")).unwrap();
    assert!(found.brightness <= 1.05, "{}", found.brightness);
    let found = Photometry::estimate(&rig(Response { gain: [0.6; 3], ..bright }), Some("b")).unwrap();
    let plain = found.plain();
    assert_eq!(plain.gain, [found.brightness; 3]);
}

#[test]
fn what_is_no_number_is_not_hidden() {
    let pinhole = ahead(2, 1, 10.0);
    for response in [Response::IDENTITY, Response { tone: 0.8, ..Response::IDENTITY }] {
        let mut rgb = [f32::NAN, 0.5, f32::INFINITY, 0.2, 2.0, -1.0];
        response.show(&mut rgb, &pinhole);
        assert!(rgb[0].is_nan() && rgb[2].is_infinite(), "{rgb:?}");
        assert_eq!(rgb[4..], [1.0, 0.0]);
    }
}

#[test]
fn a_held_out_moment_takes_what_lies_between() {
    let mut found = Photometry::estimate(&rig(Response { gain: [0.5; 3], ..Response::IDENTITY }), None).unwrap();
    let of_b: Vec<usize> = (0..found.images.len()).filter(|&i| found.images[i].camera == "b").collect();
    found.images[of_b[0]].response.gain = [0.4; 3];
    found.images[of_b[1]].response.gain = [0.9; 3];
    let between = found.response("b", 0.05).gain[0];
    assert!((between - 0.6).abs() < 1e-4, "{between}");
    assert_eq!(found.response("b", -1.0).gain, [0.4; 3]);
    assert_eq!(found.response("another", 0.0), found.plain());
}

#[test]
fn grey_cameras_step_aside_only_beside_colour() {
    let mut views = rig(Response::IDENTITY);
    for (view, other) in (0..3).map(|frame| (view("grey", frame, 0.8 * frame as f32, Response::GREY), frame)) {
        assert_eq!(view.frame, other);
        views.push(view);
    }
    let aside = put_aside(&mut views);
    assert_eq!((views.len(), aside.len()), (6, 3));
    assert!(aside.iter().all(|view| view.camera == "grey" && view.response == Some(Response::GREY)));
    let mut all_grey = aside.clone();
    assert!(put_aside(&mut all_grey).is_empty() && all_grey.len() == 3);
}
