//! One frame of the data set itself, where it is: its images, calibrations, shutters and labels.

use std::path::{Path, PathBuf};

use glam::DVec3;
use lgs_formats::camera::{Distortion, Intrinsics, ReadoutDirection};
use lgs_formats::clip::{CameraRecord, Frame, TrackedBox};
use lgs_formats::importers;
use lgs_tests::compare::{absolute, close};
use lgs_tests::process::{binary, run};
use lgs_tests::{Needed, Outcome, case_if, places};
use libtest_mimic::Trial;

use super::drive::import;

/// Epoch of the frame's first shot, seconds.
const START: f64 = 1_553_735_853.462_203;

pub(super) fn cases() -> Vec<Trial> {
    let file: PathBuf = places::shared().join("foreign/waymo/one_frame_v1.tfrecord");
    let needed = Needed::path(&file, "the real foreign folders");
    let frame = file.clone();
    vec![
        case_if(&needed, "importers::waymo::the_real_frame", move || real_frame(&frame)),
        case_if(&needed, "importers::waymo::a_frame_without_returns", move || without_returns(&file)),
    ]
}

/// What a camera is, by the frame's own messages: name, height, `f_u`, `c_u`, `k1`, moment and middle of the readout in milliseconds after the frame's start.
type Seen = (&'static str, u32, f64, f64, f64, f64, f64);
const SEEN: [Seen; 5] = [
    ("FRONT", 1280, 2_044.508_358, 949.574_645, 0.040_358, 52.418, -2.192),
    ("FRONT_LEFT", 1280, 2_056.390_213, 954.419_603, 0.033_087, 42.418, -4.369),
    ("FRONT_RIGHT", 1280, 2_045.683_283, 960.085_665, 0.033_291, 62.418, 0.368),
    ("SIDE_LEFT", 886, 2_053.508_043, 967.945_089, 0.039_622, 22.418, 3.147),
    ("SIDE_RIGHT", 886, 2_064.416_811, 961.925_359, 0.037_505, 72.418, 2.983),
];

fn real_frame(file: &Path) -> Outcome {
    let dir = importers::open(file)?;
    let [frame] = dir.clip().frames.as_slice() else { return Err("not one frame".into()) };
    if frame.cameras.len() != SEEN.len() {
        return Err(format!("{} images", frame.cameras.len()).into());
    }
    // The pose of the frame is that of the front camera's image.
    close("moment", &[(frame.lidar.timestamp - START) * 1e3], &[52.418], absolute(1e-3))?;
    for (index, (record, (name, height, focal, centre, lens, moment, middle))) in
        frame.cameras.iter().zip(SEEN).enumerate()
    {
        let camera = &record.camera;
        let (Intrinsics { fx, fy, cx, .. }, Some(readout)) = (camera.intrinsics, camera.readout) else {
            return Err(format!("{name}: no readout").into());
        };
        let Some(Distortion::BrownConrady([k1, ..])) = camera.distortion else {
            return Err(format!("{name}: {:?}", camera.distortion).into());
        };
        close(name, &[fx, fy, cx, k1], &[focal, focal, centre, lens], absolute(1e-6))?;
        close(name, &[(camera.timestamp - START) * 1e3, readout.middle * 1e3], &[moment, middle], absolute(1e-2))?;
        let rolls = readout.direction == ReadoutDirection::LeftToRight && (0.0439..0.0443).contains(&readout.seconds);
        if (camera.name.as_str(), camera.width, camera.height, rolls) != (name, 1920, height, true) {
            return Err(format!("{camera:?}").into());
        }
        if dir.load_image(0, index, None)?.rgb.data.is_empty() {
            return Err(format!("{name}: no picture").into());
        }
    }
    labels(frame)
}

/// The real frame has no returns: what would make a scene or a clip of it says so.
fn without_returns(file: &Path) -> Outcome {
    let place = tempfile::tempdir()?;
    let said = ["frame_0000.lidar", "at least one return"];
    let flags = ["--weights", "none", "--image-size", "24x40", "--out", "out"];
    let file = file.display().to_string();
    run(&binary("lgs-infer")?, &[&[file.as_str()], flags.as_slice()].concat(), place.path())?.expect_refusal(&said)?;
    import(Path::new(&file), place.path(), &[])?.expect_refusal(&said)
}

fn labels(frame: &Frame) -> Outcome {
    let boxes = frame.boxes.as_deref().unwrap_or_default();
    let count = |category: &str| boxes.iter().filter(|tracked| tracked.category == category).count();
    let counts = ["vehicle", "pedestrian", "sign", "cyclist"].map(count);
    if counts != [37, 12, 25, 1] {
        return Err(format!("{counts:?}").into());
    }
    // What is labelled is within 80 m, between the road and the signs over it, and most of it is seen by a camera.
    let seen = |tracked: &&TrackedBox| {
        let centre = tracked.world_from_box.translation();
        frame.cameras.iter().any(|record| is_in(record, centre))
    };
    let near = |tracked: &&TrackedBox| {
        let own = frame.lidar.world_from_lidar.inverse().transform_point(tracked.world_from_box.translation());
        own.truncate().length() < 80.0 && (-5.0..5.0).contains(&own.z)
    };
    let (seen, near) = (boxes.iter().filter(seen).count(), boxes.iter().filter(near).count());
    if seen > 40 && near == boxes.len() { Ok(()) } else { Err(format!("{seen} seen, {near} near").into()) }
}

/// Whether a point falls into the image of a camera.
fn is_in(record: &CameraRecord, point: DVec3) -> bool {
    let camera = &record.camera;
    let [x, y, z] = camera.world_from_camera.inverse().transform_point(point).to_array();
    let Intrinsics { fx, fy, cx, cy } = camera.intrinsics;
    let (u, v) = (fx * x / z + cx, fy * y / z + cy);
    z > 0.0 && (0.0..f64::from(camera.width)).contains(&u) && (0.0..f64::from(camera.height)).contains(&v)
}
