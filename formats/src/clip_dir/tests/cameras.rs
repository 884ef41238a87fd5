//! Fisheyes, the pinholes that are cut out of them, and shutters.

use super::*;
use crate::camera::{Fisheye, Readout, ReadoutDirection};

/// The left camera as a fisheye, its image cut into a pinhole that looks 40 degrees to the right.
fn with_fisheye() -> Fixture {
    let mut fixture = Fixture::new();
    for frame in &mut fixture.clip.frames {
        let camera = &mut frame.cameras[0].camera;
        let lens = Fisheye {
            coefficients: [0.05, -0.01, 0.002, 0.0],
            width: WIDTH,
            height: HEIGHT,
            intrinsics: camera.intrinsics,
            world_from_fisheye: camera.world_from_camera,
            fisheye_from_pinhole: DMat3::from_rotation_y(40.0_f64.to_radians()),
        };
        camera.distortion = Some(Distortion::Fisheye(lens));
        (camera.width, camera.height) = (6, 4);
        camera.intrinsics = Intrinsics { fx: 6.0, fy: 6.0, cx: 3.0, cy: 2.0 };
        camera.world_from_camera = lens.world_from_fisheye * Pose::new(lens.fisheye_from_pinhole, DVec3::ZERO);
        camera.readout = Some(Readout { seconds: 0.03, direction: ReadoutDirection::LeftToRight, middle: -0.01 });
    }
    write_clip(fixture.dir.path(), &fixture.clip).unwrap();
    fixture
}

#[test]
fn a_pinhole_of_a_fisheye_comes_back_as_it_was_written() {
    let fixture = with_fisheye();
    let dir = ClipDir::open(fixture.dir.path()).unwrap();
    assert_eq!(dir.clip(), &fixture.clip);
    let own = &dir.clip().frames[0].cameras[0].camera;
    assert_eq!((own.file_size(), [own.width, own.height]), ([WIDTH, HEIGHT], [6, 4]));
    let image = dir.load_image(0, 0, None).unwrap();
    assert_eq!((image.rgb.width, image.rgb.height, image.camera.distortion), (6, 4, None));
    assert_eq!(image.camera.world_from_camera, own.world_from_camera);
    // What the pinhole has on its left is exposed before what it has on its right, all of it after the middle of the file.
    let [first, across, _] = image.moments.unwrap();
    assert!(across > 0.0 && first + 0.5 * across > -0.01, "{first} {across}");
    assert_eq!(dir.load_image(0, 1, None).unwrap().moments, None);
    // A fisheye stays one, whatever is thought of lenses.
    assert_eq!(dir.clone().without_distortion().clip(), dir.clip());
}

#[test]
fn a_fisheye_without_a_pinhole_keeps_its_intrinsics() {
    let fixture = Fixture::new();
    let mut json: Value = serde_json::from_slice(&std::fs::read(fixture.path(CLIP_FILE)).unwrap()).unwrap();
    let camera = &mut json["frames"][0]["cameras"][1];
    camera["fisheye"] = json!([0.0, 0.0, 0.0, 0.0]);
    std::fs::write(fixture.path(CLIP_FILE), json.to_string()).unwrap();
    let dir = ClipDir::open(fixture.dir.path()).unwrap();
    let [was, is] = [&fixture.clip, dir.clip()].map(|clip| &clip.frames[0].cameras[1].camera);
    assert_eq!(Camera { distortion: None, ..is.clone() }, *was);
    write_clip(fixture.dir.path(), dir.clip()).unwrap();
    assert_eq!(ClipDir::open(fixture.dir.path()).unwrap().clip(), dir.clip());
    // The middle of the image is where it was, its corner further in.
    let image = dir.load_image(0, 1, None).unwrap();
    assert_eq!((image.rgb.width, image.rgb.height), (8, 6));
    let depth = dir.load_depth(0, 1, None).unwrap().unwrap();
    assert_eq!(depth.inverse.len(), 48);
}

#[test]
fn depths_of_a_turned_pinhole_are_along_its_own_axis() {
    let mut fixture = with_fisheye();
    // A wall 4 m ahead of the fisheye.
    write_depth_metres(&fixture.path("depth.npy"), WIDTH as usize, HEIGHT as usize, &[4.0; 48]).unwrap();
    let depth = DepthRecord { file: PathBuf::from("depth.npy"), kind: DepthKind::Metric };
    fixture.clip.frames[0].cameras[0].depth = Some(depth);
    write_clip(fixture.dir.path(), &fixture.clip).unwrap();
    let map = ClipDir::open(fixture.dir.path()).unwrap().load_depth(0, 0, None).unwrap().unwrap();
    let turn = 40.0_f64.to_radians();
    for (pixel, &inverse) in map.inverse.iter().enumerate().filter(|(_, inverse)| !inverse.is_nan()) {
        let x = ((pixel % 6) as f64 + 0.5 - 3.0) / 6.0;
        let along = turn.cos() - x * turn.sin(); // of the fisheye's axis, a metre along the pinhole's
        assert!((f64::from(inverse) - along / 4.0).abs() < 1e-6, "{pixel}: {inverse}");
    }
    assert!(map.inverse.iter().any(|inverse| !inverse.is_nan()));
}

#[test]
fn every_bad_lens_and_shutter_is_named_by_its_field() {
    let pinhole = |more: Value| {
        let intrinsics = json!({"fx": 5.0, "fy": 5.0, "cx": 4.0, "cy": 3.0});
        let mut pinhole = json!({"width": 8, "height": 6, "intrinsics": intrinsics});
        pinhole.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        pinhole
    };
    let readout = |seconds: f64, direction: &str| json!({"seconds": seconds, "direction": direction});
    let turned = json!({"fisheye_from_pinhole": [[2, 0, 0], [0, 1, 0], [0, 0, 1]]});
    let cases: Vec<(&str, Value, &str)> = vec![
        ("fisheye", json!([0.1, 0.2]), "fisheye"),
        ("distortion", json!([0.1, 0.0, 0.0, 0.0, 0.0]), "fisheye: expected no `distortion` beside it, found both"),
        ("fisheye", Value::Null, "pinhole: expected `fisheye` beside it, found none"),
        ("pinhole", pinhole(json!({"width": 0})), "pinhole.width: expected 1 to 16384 pixels, found 0"),
        ("pinhole", pinhole(json!({"name": "l"})), "pinhole.name (line"),
        ("pinhole", pinhole(turned), "pinhole.fisheye_from_pinhole: expected the rows of a rotation, found not rigid"),
        ("width", json!(6), "image size: expected width 6 and height 6 as declared, found width 8 and height 6"),
        ("depth", json!({"file": "depth.npy", "kind": "relative"}), "depth.kind: expected `metric` beside a turned"),
        ("readout", json!({"seconds": 0.02}), "readout (line"),
        ("readout", readout(0.02, "down"), "readout.direction (line"),
        ("readout", readout(30.0, "top_to_bottom"), "readout.seconds: expected 0 to 1 seconds from the first line"),
        ("readout", readout(-0.1, "top_to_bottom"), "readout.seconds: expected 0 to 1 seconds from the first line"),
        (
            "readout",
            json!({"seconds": 0.02, "direction": "top_to_bottom", "middle": 10}),
            "readout.middle: expected seconds within 1 of the timestamp, found 10",
        ),
    ];
    for (key, value, expected) in cases {
        let message = with_fisheye().message_with(&format!("/frames/1/cameras/0/{key}"), Some(value));
        assert!(message.contains(expected), "{key}: {message}\nwant {expected}");
    }
}
