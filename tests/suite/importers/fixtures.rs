//! One drive in six layouts: every importer finds the same world in it.

use lgs_formats::camera::Intrinsics;
use lgs_formats::clip::{Frame, TrackedBox};
use lgs_formats::clip_dir::ClipDir;
use lgs_formats::importers;
use lgs_tests::compare::{absolute, close, same_bits, widened};
use lgs_tests::layouts::{FOREIGN, Foreign};
use lgs_tests::process::{binary, run};
use lgs_tests::{Outcome, case};
use libtest_mimic::Trial;

/// Epoch of the first sweep, seconds; what is between sweeps; how much earlier images are.
const START: f64 = 1_600_000_000.0;
const STEP: f64 = 0.1;
const EARLY: f64 = 0.02;
/// Returns in the vehicle's frame, metres, and their intensities.
const POINTS: [[f64; 3]; 4] = [[5.0, 1.0, 0.5], [12.0, -2.0, 1.0], [20.0, 0.0, 2.0], [-6.0, 3.0, 0.25]];
const INTENSITIES: [f32; 4] = [10.0, 20.0, 30.0, 40.0];
/// What only `PandaSet`'s forward-looking `LiDAR` sees.
const AHEAD: ([f64; 3], f32) = ([30.0, 0.0, 0.0], 50.0);
/// The camera and the LiDAR in the vehicle's frame, metres.
const CAMERA: [f64; 3] = [1.5, 0.25, 1.5];
const LIDAR: [f64; 3] = [1.0, 0.0, 1.75];
const SIZE: [f64; 3] = [4.5, 1.9, 1.6];

pub(crate) fn cases() -> Vec<Trial> {
    let of_layout = |foreign: Foreign| {
        let name = |what: &str| format!("importers::fixtures::{}_{what}", foreign.folder);
        [
            case(name("is_the_drive"), move || is_the_drive(&importers::open(&foreign.path())?, foreign)),
            case(name("survives_the_way_to_a_clip"), move || survives(foreign)),
        ]
    };
    let mut cases: Vec<Trial> = FOREIGN.into_iter().flat_map(of_layout).collect();
    cases.push(case("importers::fixtures::frames_and_cameras_can_be_chosen", chosen));
    cases.push(case("importers::fixtures::lgs_infer_takes_a_foreign_folder", inferred));
    cases
}

/// A point of the vehicle's frame in the world, `time` seconds after the first sweep.
fn world([x, y, z]: [f64; 3], time: f64) -> [f64; 3] {
    let (sin, cos) = time.sin_cos();
    [1000.0 + 10.0 * time + cos * x - sin * y, 2000.0 + sin * x + cos * y, 10.0 + z]
}

fn is_the_drive(dir: &ClipDir, foreign: Foreign) -> Outcome {
    let clip = dir.clip();
    if clip.frames.len() != 3 {
        return Err(format!("{} frames, want 3", clip.frames.len()).into());
    }
    for (index, frame) in clip.frames.iter().enumerate() {
        let time = STEP * index as f64;
        is_swept(dir, index, foreign, time)?;
        is_seen(frame, foreign, time)?;
        let [tracked] = frame.boxes.as_deref().unwrap_or_default() else {
            return Err(format!("frame {index}: boxes {:?}, want one", frame.boxes).into());
        };
        is_the_car(tracked, foreign, time)?;
    }
    let image = dir.load_image(1, 0, None)?;
    // Undistorted, the middle stays where it is.
    let middle = (6 * 16 + 8) * 3;
    close(
        "colour",
        &widened(&image.rgb.data[middle..middle + 3]),
        &[120.0 / 255.0, 120.0 / 255.0, 90.0 / 255.0],
        absolute(0.09),
    )
}

fn is_swept(dir: &ClipDir, index: usize, foreign: Foreign, time: f64) -> Outcome {
    let record = &dir.clip().frames[index].lidar;
    close("lidar timestamp", &[record.timestamp], &[START + time], absolute(2e-6))?;
    let pose = record.world_from_lidar;
    close("lidar position", &pose.translation().to_array(), &world(LIDAR, time), absolute(2e-6))?;
    let sweep = dir.load_sweep(index)?;
    let got: Vec<f64> =
        sweep.points.iter().flat_map(|p| pose.transform_point(p.map(f64::from).into()).to_array()).collect();
    let (mut points, mut intensities) = (POINTS.to_vec(), INTENSITIES.to_vec());
    if foreign.layout == "pandaset" {
        points.push(AHEAD.0);
        intensities.push(AHEAD.1);
    }
    let want: Vec<f64> = points.iter().flat_map(|&point| world(point, time)).collect();
    // Waymo's poses of single pixels are of single precision: 2 km are told to 0.1 mm.
    let tolerance = if foreign.layout == "waymo" { 2e-4 } else { 1e-5 };
    close("points in the world", &got, &want, absolute(tolerance))?;
    same_bits("intensities", &sweep.intensities, &intensities)
}

fn is_seen(frame: &Frame, foreign: Foreign, time: f64) -> Outcome {
    let [record] = frame.cameras.as_slice() else {
        return Err(format!("{} images, want 1", frame.cameras.len()).into());
    };
    let camera = &record.camera;
    let time = time - EARLY;
    if camera.readout.is_some() != ["pandaset", "waymo"].contains(&foreign.layout) {
        return Err(format!("readout {:?}", camera.readout).into());
    }
    close("camera timestamp", &[camera.timestamp], &[START + time], absolute(2e-6))?;
    let pose = camera.world_from_camera;
    close("camera position", &pose.translation().to_array(), &world(CAMERA, time), absolute(2e-6))?;
    // One metre along each axis of the camera: right, down, forward.
    let [x, y, z] = CAMERA;
    let axes =
        [([1.0, 0.0, 0.0], [x, y - 1.0, z]), ([0.0, 1.0, 0.0], [x, y, z - 1.0]), ([0.0, 0.0, 1.0], [x + 1.0, y, z])];
    for (axis, at) in axes {
        let got = pose.transform_point(axis.into()).to_array();
        close("camera axis", &got, &world(at, time), absolute(2e-6))?;
    }
    let Intrinsics { fx, fy, cx, cy } = camera.intrinsics;
    close("intrinsics", &[fx, fy, cx, cy], &[20.0, 21.0, 8.5, 6.5], absolute(1e-9))?;
    let (name, size) = (camera.name.as_str(), (camera.width, camera.height));
    if (name, size) == (foreign.camera, (16, 12)) && camera.distortion.is_none() {
        return Ok(());
    }
    Err(format!("{name} of {size:?}, distortion {:?}", camera.distortion).into())
}

fn is_the_car(tracked: &TrackedBox, foreign: Foreign, time: f64) -> Outcome {
    close("size", &tracked.size, &SIZE, absolute(1e-9))?;
    let pose = tracked.world_from_box;
    close("centre", &pose.translation().to_array(), &[1010.0 + 10.0 * time, 2001.0, 11.0], absolute(2e-6))?;
    let front = pose.rotation().col(0).to_array();
    close("direction", &front, &[0.3_f64.cos(), 0.3_f64.sin(), 0.0], absolute(2e-6))?;
    // KITTI's tracklets have no names: they count.
    let track = if foreign.layout == "kitti-raw" { "0" } else { "7" };
    // Waymo has four classes of its own.
    let category = if foreign.layout == "waymo" { "vehicle" } else { "Car" };
    if (tracked.track.as_str(), tracked.category.as_str()) == (track, category) {
        return Ok(());
    }
    Err(format!("track {}, category {}", tracked.track, tracked.category).into())
}

fn survives(foreign: Foreign) -> Outcome {
    let place = tempfile::tempdir()?;
    let out = place.path().join("new/clip");
    import(foreign, &out, &[])?;
    is_the_drive(&ClipDir::open(&out)?, foreign)
}

fn import(foreign: Foreign, out: &std::path::Path, flags: &[&str]) -> Outcome {
    let source = foreign.path();
    let mut arguments: Vec<&std::ffi::OsStr> =
        vec!["import".as_ref(), foreign.layout.as_ref(), source.as_os_str(), "--out".as_ref(), out.as_os_str()];
    arguments.extend(flags.iter().map(|flag| flag.as_ref() as &std::ffi::OsStr));
    run(&binary("lgs-clip")?, &arguments, out.ancestors().last().unwrap_or(out))?.expect_success()
}

fn chosen() -> Outcome {
    let place = tempfile::tempdir()?;
    let out = place.path().join("clip");
    let [foreign, ..] = FOREIGN;
    import(foreign, &out, &["--frames", "1..2", "--cameras", "CAMERA_01"])?;
    let clip = ClipDir::open(&out)?.clip().clone();
    let times: Vec<f64> = clip.frames.iter().map(|frame| frame.lidar.timestamp).collect();
    close("timestamps", &times, &[START + STEP, START + 2.0 * STEP], absolute(2e-6))
}

fn inferred() -> Outcome {
    let place = tempfile::tempdir()?;
    for foreign in FOREIGN {
        let (source, out) = (foreign.path(), place.path().join(foreign.folder));
        let arguments = [source.as_os_str(), "--out".as_ref(), out.as_os_str(), "--views".as_ref(), "none".as_ref()];
        run(&binary("lgs-infer")?, &arguments, place.path())?.expect_success()?;
        if !out.join("scene.ply").is_file() {
            return Err(format!("{}: no scene", foreign.layout).into());
        }
    }
    Ok(())
}
