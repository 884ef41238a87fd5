//! A small clip that is good, and what is said when one thing in it is not.

mod cameras;
mod returns;

use std::path::PathBuf;

use glam::{DMat3, DVec3};
use proptest::prelude::*;
use serde_json::{Value, json};

use super::*;
use crate::{
    camera::{Camera, Distortion, Intrinsics},
    clip::{DepthKind, DepthRecord, Frame, LidarRecord, TrackedBox},
    image::{PixelLabel, RgbImage, write_depth_metres, write_mask, write_png},
    pose::Pose,
    sweep::write_sweep,
};

const WIDTH: u32 = 8;
const HEIGHT: u32 = 6;

/// A clip of two frames with two cameras each, written to a fresh directory.
struct Fixture {
    dir: tempfile::TempDir,
    clip: Clip,
}

fn pose(angle: f64, x: f64) -> Pose {
    Pose::new(DMat3::from_rotation_y(angle) * DMat3::from_rotation_x(0.1), DVec3::new(x, 2.0 / 3.0, -1e-7))
}

fn camera(frame: usize, name: &str) -> CameraRecord {
    let intrinsics = Intrinsics { fx: 7.1, fy: 7.3, cx: 4.0, cy: 3.1 };
    CameraRecord {
        file: PathBuf::from(format!("images/{frame}_{name}.png")),
        mask: (name == "left").then(|| PathBuf::from("mask.png")),
        depth: (name == "right").then(|| DepthRecord { file: PathBuf::from("depth.npy"), kind: DepthKind::Metric }),
        camera: Camera {
            name: name.to_owned(),
            timestamp: 1.7e9 + 0.1 * frame as f64,
            width: WIDTH,
            height: HEIGHT,
            intrinsics,
            distortion: (name == "left").then_some(Distortion::BrownConrady([-0.1, 0.01, 1e-3, -1e-3, 0.0])),
            readout: None,
            world_from_camera: pose(0.3, 1.0),
        },
    }
}

fn frame(index: usize) -> Frame {
    let tracked = TrackedBox {
        track: "t1".to_owned(),
        category: "car".to_owned(),
        size: [4.0, 1.8, 1.5],
        world_from_box: pose(1.0, 9.0 + index as f64),
    };
    Frame {
        lidar: LidarRecord::new(PathBuf::from(format!("{index}.bin")), 1.7e9 + 0.1 * index as f64, pose(0.01, 0.1)),
        cameras: vec![camera(index, "left"), camera(index, "right")],
        boxes: (index == 0).then(|| vec![tracked]),
    }
}

impl Fixture {
    fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        let text = |s: &str| s.to_owned();
        let clip = Clip { name: text("n"), source: text("s"), licence: text("l"), frames: vec![frame(0), frame(1)] };
        std::fs::create_dir(dir.path().join("images")).unwrap();
        let data = (0..WIDTH * HEIGHT * 3).map(|v| v as f32 / 255.0).collect();
        let image = RgbImage { width: WIDTH as usize, height: HEIGHT as usize, data };
        for record in clip.frames.iter().flat_map(|f| &f.cameras) {
            write_png(&dir.path().join(&record.file), &image).unwrap();
        }
        let labels = vec![PixelLabel::Static; (WIDTH * HEIGHT) as usize];
        write_mask(&dir.path().join("mask.png"), image.width, image.height, &labels).unwrap();
        let depths: Vec<f32> = (1_u8..=48).map(f32::from).collect();
        write_depth_metres(&dir.path().join("depth.npy"), image.width, image.height, &depths).unwrap();
        for frame in &clip.frames {
            let sweep = Sweep { points: vec![[1.0, 2.0, 3.0]; 5], intensities: vec![0.5; 5], ..Sweep::default() };
            write_sweep(&dir.path().join(&frame.lidar.file), &sweep).unwrap();
        }
        write_clip(dir.path(), &clip).unwrap();
        Self { dir, clip }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// What opening says after `clip.json` was replaced.
    fn message_of_text(&self, text: &[u8]) -> String {
        std::fs::write(self.path(CLIP_FILE), text).unwrap();
        self.message()
    }

    fn message(&self) -> String {
        let message = ClipDir::open(self.dir.path()).unwrap_err().to_string();
        assert!(!message.contains('\n'), "{message}");
        message
    }

    /// What opening says after the value at `pointer` was replaced; `None` removes the key.
    fn message_with(&self, pointer: &str, value: Option<Value>) -> String {
        let mut json: Value = serde_json::from_slice(&std::fs::read(self.path(CLIP_FILE)).unwrap()).unwrap();
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        match (json.pointer_mut(parent).unwrap(), value) {
            (Value::Object(map), Some(value)) => drop(map.insert(key.to_owned(), value)),
            (Value::Object(map), None) => drop(map.remove(key)),
            (Value::Array(list), Some(value)) => list[key.parse::<usize>().unwrap()] = value,
            other => unreachable!("{other:?}"),
        }
        self.message_of_text(&serde_json::to_vec_pretty(&json).unwrap())
    }
}

#[test]
fn a_good_clip_comes_back_as_it_was_written() {
    let fixture = Fixture::new();
    let dir = ClipDir::open(fixture.dir.path()).unwrap();
    assert_eq!(dir.clip(), &fixture.clip);
    assert_eq!(dir.load_sweep(1).unwrap().points, vec![[1.0, 2.0, 3.0]; 5]);
    let image = dir.load_image(0, 1, None).unwrap();
    assert_eq!((image.rgb.width, image.rgb.height, image.labels), (8, 6, None));
    assert!(image.rgb.data.iter().enumerate().all(|(i, &v)| v == i as f32 / 255.0));
    let depth = dir.load_depth(0, 1, None).unwrap().unwrap();
    assert!(depth.inverse.iter().zip(1_u8..).all(|(&w, metres)| w == 1.0 / f32::from(metres)));
    assert_eq!(dir.load_depth(0, 0, None).unwrap(), None);
    let small = dir.load_image(0, 0, Some("3x4".parse().unwrap())).unwrap();
    assert_eq!((small.camera.width, small.camera.height, small.camera.distortion), (4, 3, None));
    assert_eq!(small.camera.intrinsics, Intrinsics { fx: 3.55, fy: 3.65, cx: 2.0, cy: 1.55 });
    assert_eq!(small.labels.unwrap().len(), 12);
}

#[test]
fn an_index_that_the_clip_does_not_have_is_an_error() {
    let fixture = Fixture::new();
    let dir = ClipDir::open(fixture.dir.path()).unwrap();
    let message = dir.load_sweep(2).unwrap_err().to_string();
    assert!(message.ends_with("clip.json: frames: expected an entry 2, found 2 entries"), "{message}");
    let message = dir.load_image(1, 2, None).unwrap_err().to_string();
    assert!(message.ends_with("frames[1].cameras: expected an entry 2, found 2 entries"), "{message}");
    let message = dir.load_image(0, 0, Some(ImageSize { height: 0, width: 4 })).unwrap_err().to_string();
    assert!(message.contains("0_left.png: size: ") && message.ends_with("found 0x4"), "{message}");
}

#[test]
fn every_bad_value_is_named_by_its_field() {
    let rows = |first: Value| json!([first, [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]);
    let c = "/frames/1/cameras/0";
    let cases: Vec<(String, Value, &str)> = vec![
        ("/format".into(), json!("lgs-clip/2"), "format: expected `lgs-clip/1`, found `lgs-clip/2`"),
        ("/frames".into(), json!([]), "frames: expected at least one frame, found an empty list"),
        ("/frames/0/lidar/timestamp".into(), json!(1e300), "frames[0].lidar.timestamp: expected finite seconds"),
        ("/frames/0/lidar/timestamp".into(), json!(1.7e18), "frames[0].lidar.timestamp: expected finite seconds"),
        ("/frames/0/lidar/timestamp".into(), Value::Null, "frames[0].lidar.timestamp (line"),
        (format!("{c}/timestamp"), json!(1.0), "frames[1].cameras[0].timestamp: expected at most 3600 s from"),
        (format!("{c}/width"), json!(0), "frames[1].cameras[0].width: expected 1 to 16384 pixels, found 0"),
        (format!("{c}/height"), json!(16385), "frames[1].cameras[0].height: expected 1 to 16384 pixels, found 16385"),
        (format!("{c}/width"), json!(-3), "frames[1].cameras[0].width (line"),
        (format!("{c}/intrinsics/fx"), json!(0), "frames[1].cameras[0].intrinsics.fx: expected a focal length"),
        (format!("{c}/intrinsics/fy"), json!(-7.0), "intrinsics.fy: expected a focal length of 0.001 to"),
        (format!("{c}/intrinsics/cy"), json!(1e30), "intrinsics.cy: expected a principal point"),
        (format!("{c}/distortion"), json!([0.1, 0.2]), "frames[1].cameras[0].distortion"),
        (format!("{c}/name"), json!("right"), "frames[1].cameras[1].name: expected a name that occurs once"),
        (format!("{c}/name"), json!("../../up"), "frames[1].cameras[0].name: expected 1 to 100 bytes"),
        (format!("{c}/name"), json!(""), "frames[1].cameras[0].name: expected 1 to 100 bytes"),
        (format!("{c}/file"), json!("/etc/passwd"), "frames[1].cameras[0].file: expected a relative path"),
        (format!("{c}/mask"), json!("../mask.png"), "frames[1].cameras[0].mask: expected a relative path"),
        ("/frames/0/lidar/file".into(), json!("images/../../0.bin"), "frames[0].lidar.file: expected a relative path"),
        ("/frames/0/lidar/file".into(), json!(""), "frames[0].lidar.file: expected a relative path"),
        (
            "/frames/0/lidar/file".into(),
            json!("2.bin"),
            "frames[0].lidar.file: expected a file that exists, found `2.bin`: No",
        ),
        (
            format!("{c}/mask"),
            json!("m.png"),
            "frames[1].cameras[0].mask: expected a file that exists, found `m.png`: No",
        ),
        ("/frames/0/cameras/1/depth/kind".into(), json!("inverse"), "frames[0].cameras[1].depth.kind (line"),
        (
            "/frames/0/cameras/1/depth/file".into(),
            json!("/d.npy"),
            "frames[0].cameras[1].depth.file: expected a relative path",
        ),
        ("/frames/0/cameras/1/depth/file".into(), json!("d.npy"), "frames[0].cameras[1].depth.file: expected a file"),
        (
            format!("{c}/world_from_camera/0"),
            json!([1, 0, 0, 1e12]),
            "frames[1].cameras[0].world_from_camera: expected a rigid",
        ),
        (
            "/frames/0/lidar/world_from_lidar".into(),
            rows(json!([1, 0, 0, 1e12])),
            "world_from_lidar[0][3]: expected a translation",
        ),
        (
            "/frames/0/lidar/world_from_lidar".into(),
            rows(json!([2, 0, 0, 0])),
            "world_from_lidar: expected a rigid 4x4 pose",
        ),
        ("/frames/0/lidar/world_from_lidar".into(), rows(json!([-1, 0, 0, 0])), "det R = -1"),
        (
            "/frames/0/lidar/world_from_lidar".into(),
            rows(json!([1, 0, 0, null])),
            "frames[0].lidar.world_from_lidar[0][3] (line",
        ),
        (
            "/frames/0/lidar/world_from_lidar".into(),
            rows(json!([1, 0, 0])),
            "frames[0].lidar.world_from_lidar[0] (line",
        ),
        ("/frames/0/lidar/world_from_lidar/3".into(), json!([0, 0, 0, 2]), "expected a rigid 4x4 pose, found last row"),
        ("/frames/0/boxes/0/size/1".into(), json!(0), "frames[0].boxes[0].size[1]: expected a positive length"),
        ("/frames/0/boxes/0/size".into(), json!([1, 2]), "frames[0].boxes[0].size"),
    ];
    for (pointer, value, expected) in cases {
        let message = Fixture::new().message_with(&pointer, Some(value));
        assert!(message.contains("clip.json: ") && message.contains(expected), "{pointer}: {message}\nwant {expected}");
    }
}

#[test]
fn unknown_and_missing_keys_are_named_with_their_place() {
    let places = [
        ("/more", "more (line", "unknown field `more`"),
        ("/frames/1/more", "frames[1].more (line", "unknown field `more`"),
        ("/frames/1/cameras/0/intrinsics/fz", "frames[1].cameras[0].intrinsics.fz (line", "unknown field `fz`"),
        ("/frames/1/cameras/1/depth/unit", "frames[1].cameras[1].depth.unit (line", "unknown field `unit`"),
        ("/frames/0/boxes/0/more", "frames[0].boxes[0].more (line", "unknown field `more`"),
    ];
    for (pointer, place, what) in places {
        let message = Fixture::new().message_with(pointer, Some(json!(1)));
        assert!(message.contains(place) && message.contains(what), "{message}");
    }
    let missing = ["/name", "/frames/0/lidar/timestamp", "/frames/1/cameras/1/world_from_camera", "/frames/0/cameras"];
    for pointer in missing {
        let message = Fixture::new().message_with(pointer, None);
        let (_, key) = pointer.rsplit_once('/').unwrap();
        assert!(message.contains(&format!("missing field `{key}`")), "{message}");
    }
    let other_format = Fixture::new().message_of_text(br#"{"format": "lgs-clip/9", "other": 1}"#);
    assert!(other_format.ends_with("format: expected `lgs-clip/1`, found `lgs-clip/9`"), "{other_format}");
}

#[test]
fn a_number_that_json_does_not_have_is_named_by_field_and_line() {
    let fixture = Fixture::new();
    let good = String::from_utf8(std::fs::read(fixture.path(CLIP_FILE)).unwrap()).unwrap();
    for literal in ["NaN", "Infinity", "-Infinity", "1e999"] {
        let bad = good.replacen("1700000000.1", literal, 1);
        assert_ne!(bad, good);
        let line = bad.lines().position(|l| l.contains(literal)).unwrap() + 1;
        let message = fixture.message_of_text(bad.as_bytes());
        let expected = format!("clip.json: frames[1].lidar.timestamp (line {line}): ");
        assert!(message.contains(&expected), "{message}\nwant {expected}");
        assert!(
            literal == "1e999" || message.ends_with(&format!("found `{}`", literal.trim_start_matches('-'))),
            "{message}"
        );
    }
}

#[test]
fn files_that_are_not_as_declared_are_named() {
    type Damage = fn(&Fixture);
    let cases: [(Damage, &str); 9] = [
        (|f| std::fs::remove_file(f.path(CLIP_FILE)).unwrap(), "clip.json: read: No such file"),
        (|f| std::fs::write(f.path("1.bin"), []).unwrap(), "1.bin: file size: expected at least one return"),
        (|f| std::fs::write(f.path("1.bin"), [0; 31]).unwrap(), "1.bin: file size: expected a multiple of 16 bytes"),
        (|f| std::fs::write(f.path("images/1_left.png"), b"GIF89a").unwrap(), "1_left.png: image format: expected PNG"),
        (|f| std::fs::write(f.path("images/1_left.png"), []).unwrap(), "1_left.png: image format: expected PNG"),
        (
            |f| write_mask(&f.path("mask.png"), 2, 1, &[PixelLabel::Static; 2]).unwrap(),
            "mask.png: image size: expected width 8",
        ),
        (
            |f| write_depth_metres(&f.path("depth.npy"), 6, 8, &[1.0; 48]).unwrap(),
            "depth.npy: depth map: expected shape [6, 8] as declared, found [8, 6]",
        ),
        (
            |f| {
                write_png(&f.path("images/0_right.png"), &RgbImage { width: 1, height: 2, data: vec![0.0; 6] }).unwrap()
            },
            "0_right.png: image size: expected width 8 and height 6 as declared, found width 1 and height 2",
        ),
        (
            |f| {
                std::fs::remove_file(f.path("0.bin")).unwrap();
                std::fs::create_dir(f.path("0.bin")).unwrap();
            },
            "0.bin: file type: expected a regular file, found a directory",
        ),
    ];
    for (damage, expected) in cases {
        let fixture = Fixture::new();
        damage(&fixture);
        let message = fixture.message();
        assert!(message.contains(expected), "{message}\nwant {expected}");
    }
}

#[test]
fn a_clip_that_could_not_be_read_back_is_not_written() {
    let fixture = Fixture::new();
    let before = std::fs::read(fixture.path(CLIP_FILE)).unwrap();
    let mut bad = fixture.clip.clone();
    bad.frames[1].lidar.timestamp = f64::NAN;
    let message = write_clip(fixture.dir.path(), &bad).unwrap_err().to_string();
    assert!(message.contains("frames[1].lidar.timestamp: expected finite seconds"), "{message}");
    assert!(message.ends_with("found NaN"), "{message}");
    assert_eq!(std::fs::read(fixture.path(CLIP_FILE)).unwrap(), before);
}

#[test]
fn a_truncated_clip_json_is_an_error_wherever_it_ends() {
    let fixture = Fixture::new();
    let good = std::fs::read(fixture.path(CLIP_FILE)).unwrap();
    for end in (0..good.len() - 2).step_by(7) {
        assert!(fixture.message_of_text(&good[..end]).contains("clip.json: "));
    }
    let twice = [good.as_slice(), b"{}"].concat();
    assert!(fixture.message_of_text(&twice).contains("trailing characters"));
}

proptest! {
    #[test]
    fn numbers_are_read_back_to_the_same_bits(
        timestamp in -1e11_f64..1e11,
        offset in -3599.0_f64..3599.0,
        (fx, cx) in (1e-3_f64..1e7, -1e7_f64..1e7),
        distortion in prop::array::uniform5(prop::num::f64::NORMAL | prop::num::f64::SUBNORMAL | prop::num::f64::ZERO),
        (angle, x) in (-3.0_f64..3.0, -1e9_f64..1e9),
    ) {
        let mut record = camera(0, "c");
        record.camera.timestamp = timestamp + offset;
        record.camera.intrinsics.fx = fx;
        record.camera.intrinsics.cx = cx;
        record.camera.distortion = Some(Distortion::BrownConrady(distortion));
        let mut first = frame(0);
        first.lidar = LidarRecord { timestamp, world_from_lidar: pose(angle, x), ..first.lidar };
        first.cameras = vec![record];
        let clip = Clip { name: "\u{1f697} \"\n".to_owned(), source: String::new(), licence: String::new(), frames: vec![first] };
        prop_assume!((timestamp + offset).abs() <= 1e11 && offset.abs() < 3599.0);
        let file = Path::new("clip.json");
        let back = clip_json::parse(file, &clip_json::to_text(file, &clip).unwrap()).unwrap();
        prop_assert_eq!(back, clip);
    }

    #[test]
    fn damaged_text_never_panics(place in 0_usize..4000, byte: u8) {
        let file = Path::new("clip.json");
        let clip = Clip { name: String::new(), source: String::new(), licence: String::new(), frames: vec![frame(0)] };
        let mut text = clip_json::to_text(file, &clip).unwrap();
        let place = place % text.len();
        text[place] = byte;
        if let Err(error) = clip_json::parse(file, &text) {
            prop_assert!(error.to_string().starts_with("clip.json: "));
        }
    }
}
