//! A drive of five cameras and five `LiDARs`, written through the official messages: equal to its truth in both forms.
//!
//! Its points are those of the data set's own package to 0.03 mm (`tests/fixtures/waymo.py`).

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

use glam::DVec3;
use lgs_formats::camera::{Camera, Distortion, Intrinsics, ReadoutDirection};
use lgs_formats::clip::Frame;
use lgs_formats::clip_dir::ClipDir;
use lgs_formats::importers::{self, Layout, Selection};
use lgs_formats::pose::Pose;
use lgs_tests::compare::{absolute, close};
use lgs_tests::process::{Finished, binary, run};
use lgs_tests::sources::all_files;
use lgs_tests::{Outcome, case, places};
use libtest_mimic::{Failed, Trial};
use serde_json::Value;

/// Largest error of poses (metres, and entries of rotations), of times (seconds), of points (metres).
const POSE: f64 = 1e-6;
const TIME: f64 = 1e-6;
const POINT: f64 = 1e-3;
/// `LiDARs` in the order of their numbers.
const LIDARS: [&str; 5] = ["TOP", "FRONT", "SIDE_LEFT", "SIDE_RIGHT", "REAR"];

pub(super) fn cases() -> Vec<Trial> {
    let name = |what: &str| format!("importers::waymo::{what}");
    vec![
        case(name("records_are_the_drive"), || is_the_drive(&fixture("waymo_drive"))),
        case(name("components_are_the_drive"), || is_the_drive(&fixture("waymo_drive_v2"))),
        case(name("both_forms_give_the_same_clip"), same_clip),
        case(name("a_file_is_a_drive"), file_is_a_drive),
        case(name("lidars_can_be_chosen"), lidars_can_be_chosen),
        case(name("pandaset_has_two_lidars"), pandaset_has_two_lidars),
        case(name("one_of_several_drives"), one_of_several),
    ]
}

/// A folder of `tests/fixtures`.
pub(super) fn fixture(name: &str) -> PathBuf {
    places::repository().join("tests/fixtures").join(name)
}

/// What is in the drive, frame by frame.
fn truth() -> Result<Vec<Value>, Failed> {
    let mut text = String::new();
    let file = File::open(fixture("waymo_drive/truth.json.gz"))?;
    flate2::read::GzDecoder::new(file).read_to_string(&mut text)?;
    Ok(serde_json::from_str(&text)?)
}

fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(values) => values.iter().flat_map(numbers).collect(),
        other => other.as_f64().into_iter().collect(),
    }
}

fn rows(pose: &Pose) -> Vec<f64> {
    pose.rows().as_flattened().to_vec()
}

fn is_the_drive(path: &Path) -> Outcome {
    let (dir, truth) = (importers::open(path)?, truth()?);
    let frames = &dir.clip().frames;
    if frames.len() != truth.len() || frames.len() != 20 {
        return Err(format!("{} frames, want {}", frames.len(), truth.len()).into());
    }
    for (index, (frame, want)) in frames.iter().zip(&truth).enumerate() {
        is_swept(&dir, index, want)?;
        let cameras = want["cameras"].as_object().ok_or("no cameras")?;
        if frame.cameras.len() != cameras.len() {
            return Err(format!("frame {index}: {} images", frame.cameras.len()).into());
        }
        for record in &frame.cameras {
            is_seen(&record.camera, &cameras[&record.camera.name])?;
        }
        is_labelled(frame, &want["boxes"])?;
    }
    Ok(())
}

fn is_swept(dir: &ClipDir, index: usize, want: &Value) -> Outcome {
    let record = &dir.clip().frames[index].lidar;
    close("timestamp", &[record.timestamp], &numbers(&want["timestamp"]), absolute(TIME))?;
    close("LiDAR", &rows(&record.world_from_lidar), &numbers(&want["world_from_lidar"]), absolute(POSE))?;
    let sensors = &record.returns.sensors.as_ref().ok_or("no sensors")?.lidar_from_sensor;
    for (sensor, name) in sensors.iter().zip(LIDARS) {
        let place = (record.world_from_lidar * *sensor).translation().to_array();
        close(name, &place, &numbers(&want["sensors"][name]), absolute(POSE))?;
    }
    let sweep = dir.load_sweep(index)?;
    let (indices, times) = (sweep.sensors.ok_or("no indices")?, sweep.times.ok_or("no times")?);
    for (sensor, name) in (0_u8..).zip(LIDARS) {
        let of_sensor: Vec<usize> = (0..indices.len()).filter(|&k| indices[k] == sensor).collect();
        let got: Vec<f64> = of_sensor
            .iter()
            .flat_map(|&k| {
                let point = DVec3::from(sweep.points[k].map(f64::from));
                let [x, y, z] = record.world_from_lidar.transform_point(point).to_array();
                [x, y, z, f64::from(sweep.intensities[k])]
            })
            .collect();
        let returns: Vec<Vec<f64>> = want["returns"][name].as_array().into_iter().flatten().map(numbers).collect();
        let points: Vec<f64> = returns.iter().flat_map(|row| row[..4].to_vec()).collect();
        close(name, &got, &points, absolute(POINT))?;
        let got: Vec<f64> = of_sensor.iter().map(|&k| f64::from(times[k])).collect();
        let moments: Vec<f64> = returns.iter().map(|row| row[4]).collect();
        close(name, &got, &moments, absolute(TIME))?;
    }
    Ok(())
}

fn is_seen(camera: &Camera, want: &Value) -> Outcome {
    close(&camera.name, &[camera.timestamp], &numbers(&want["timestamp"]), absolute(TIME))?;
    close(&camera.name, &rows(&camera.world_from_camera), &numbers(&want["world_from_camera"]), absolute(POSE))?;
    let Intrinsics { fx, fy, cx, cy } = camera.intrinsics;
    close(&camera.name, &[fx, fy, cx, cy], &numbers(&want["intrinsics"]), absolute(1e-12))?;
    let Some(Distortion::BrownConrady(lens)) = camera.distortion else {
        return Err(format!("{}: distortion {:?}", camera.name, camera.distortion).into());
    };
    close(&camera.name, &lens, &numbers(&want["distortion"]), absolute(1e-12))?;
    close("size", &[f64::from(camera.width), f64::from(camera.height)], &numbers(&want["size"]), absolute(0.0))?;
    let readout = camera.readout.ok_or("no readout")?;
    let times = [&want["seconds"], &want["middle"]].map(|value| value.as_f64().unwrap_or(f64::NAN));
    close("readout", &[readout.seconds, readout.middle], &times, absolute(TIME))?;
    let way = match want["direction"].as_str() {
        Some("left_to_right") => ReadoutDirection::LeftToRight,
        Some("right_to_left") => ReadoutDirection::RightToLeft,
        Some("bottom_to_top") => ReadoutDirection::BottomToTop,
        _ => ReadoutDirection::TopToBottom,
    };
    if readout.direction == way { Ok(()) } else { Err(format!("{}: {readout:?}", camera.name).into()) }
}

fn is_labelled(frame: &Frame, want: &Value) -> Outcome {
    let boxes = frame.boxes.as_ref().ok_or("no boxes")?;
    let want = want.as_object().ok_or("no boxes in the truth")?;
    if boxes.len() != want.len() {
        return Err(format!("{} boxes, want {}", boxes.len(), want.len()).into());
    }
    for tracked in boxes {
        let own = want.get(&tracked.track).ok_or_else(|| format!("no box {}", tracked.track))?;
        if own["category"].as_str() != Some(&tracked.category) {
            return Err(format!("{}: {}, want {}", tracked.track, tracked.category, own["category"]).into());
        }
        close(&tracked.track, &tracked.size, &numbers(&own["size"]), absolute(1e-12))?;
        close(&tracked.track, &rows(&tracked.world_from_box), &numbers(&own["world_from_box"]), absolute(POSE))?;
    }
    Ok(())
}

/// `lgs-clip import waymo SOURCE --out PLACE/out` and some flags.
pub(super) fn import(source: &Path, place: &Path, flags: &[&str]) -> Result<Finished, String> {
    let head: [&OsStr; 5] = ["import".as_ref(), "waymo".as_ref(), source.as_os_str(), "--out".as_ref(), "out".as_ref()];
    let arguments: Vec<&OsStr> = head.into_iter().chain(flags.iter().map(OsStr::new)).collect();
    run(&binary("lgs-clip")?, &arguments, place)
}

/// The files of a folder and their bytes.
fn contents(folder: &Path) -> Result<BTreeMap<PathBuf, Vec<u8>>, Failed> {
    all_files(folder)?.into_iter().map(|file| Ok((file.clone(), fs::read(folder.join(file))?))).collect()
}

fn same_clip() -> Outcome {
    let (a, b) = (tempfile::tempdir()?, tempfile::tempdir()?);
    import(&fixture("waymo_drive"), a.path(), &[])?.expect_success()?;
    import(&fixture("waymo_drive_v2"), b.path(), &[])?.expect_success()?;
    let [a, b] = [contents(&a.path().join("out"))?, contents(&b.path().join("out"))?];
    if a.len() != 161 || a.keys().ne(b.keys()) {
        return Err(format!("{} and {} files", a.len(), b.len()).into());
    }
    match a.iter().find(|(file, bytes)| b.get(*file) != Some(bytes)) {
        None => Ok(()),
        Some((file, _)) => Err(format!("{} differs", file.display()).into()),
    }
}

fn file_is_a_drive() -> Outcome {
    let place = tempfile::tempdir()?;
    let file = place.path().join("segment without an ending");
    fs::copy(fixture("waymo/drive.tfrecord"), &file)?;
    let infer = |file: &Path| {
        let arguments: [&OsStr; 7] = [
            file.as_os_str(),
            "--out".as_ref(),
            "scene".as_ref(),
            "--frames".as_ref(),
            "0,2".as_ref(),
            "--views".as_ref(),
            "none".as_ref(),
        ];
        run(&binary("lgs-infer")?, &arguments, place.path())
    };
    infer(&file)?.expect_success()?;
    fs::write(&file, "anything")?;
    infer(&file)?.expect_refusal(&["segment without an ending", "layout", "a folder, or a file of Waymo's records"])
}

fn lidars_can_be_chosen() -> Outcome {
    let choose = |lidars: &[&str]| {
        let lidars = Some(lidars.iter().map(|&name| name.to_owned()).collect());
        importers::open_as(Layout::Waymo, &fixture("waymo_drive"), &Selection { lidars, ..Selection::default() })
    };
    let (all, truth) = (importers::open(&fixture("waymo_drive"))?, truth()?);
    for lidars in [&["TOP"][..], &["REAR"], &["SIDE_RIGHT", "FRONT"]] {
        let dir = choose(lidars)?;
        let record = &dir.clip().frames[3].lidar;
        let sweep = dir.load_sweep(3)?;
        let counts = |name: &&str| truth[3]["returns"][*name].as_array().map_or(0, Vec::len);
        let want: usize = lidars.iter().map(counts).sum();
        let several = lidars.len() > 1;
        if sweep.points.len() != want
            || sweep.sensors.is_some() != several
            || record.returns.sensors.is_some() != several
        {
            return Err(format!("{lidars:?}: {} points, want {want}", sweep.points.len()).into());
        }
        // Rays start where the sensor stands, whose place is that of the sweep where it is the first of those chosen.
        let first = LIDARS.iter().find(|name| lidars.contains(name)).ok_or("none")?;
        let place = record.world_from_lidar.translation().to_array();
        close(first, &place, &numbers(&truth[3]["sensors"][*first]), absolute(POSE))?;
    }
    if all.load_sweep(3)?.points.len() <= choose(&["TOP"])?.load_sweep(3)?.points.len() {
        return Err("the upper LiDAR alone has all points".into());
    }
    let place = tempfile::tempdir()?;
    let refused = import(&fixture("waymo_drive"), place.path(), &["--lidars", "BELOW"])?;
    refused.expect_refusal(&["--lidars", "TOP, FRONT, SIDE_LEFT, SIDE_RIGHT, REAR", "`BELOW`"])?;
    let kitti = Selection { lidars: Some(vec!["TOP".to_owned()]), ..Selection::default() };
    let message = importers::open_as(Layout::KittiRaw, &fixture("kitti"), &kitti).map_err(|e| e.to_string());
    match message {
        Err(message) if message.contains("lidars: expected none: a folder of kitti-raw has one LiDAR") => Ok(()),
        other => Err(format!("{other:?}").into()),
    }
}

fn pandaset_has_two_lidars() -> Outcome {
    let choose = |lidars: Option<&str>| {
        let lidars = lidars.map(|names| names.split(',').map(str::to_owned).collect());
        importers::open_as(Layout::PandaSet, &fixture("pandaset"), &Selection { lidars, ..Selection::default() })
    };
    let mounts = |dir: &ClipDir| {
        let sensors = dir.clip().frames[1].lidar.returns.sensors.as_ref();
        sensors.map_or_else(Vec::new, |sensors| sensors.lidar_from_sensor.clone())
    };
    let both = choose(None)?;
    let [main, front] = mounts(&both).try_into().map_err(|other| format!("mounts {other:?}"))?;
    if both.load_sweep(1)?.sensors != Some(vec![0, 0, 0, 0, 1]) {
        return Err(format!("{:?}", both.load_sweep(1)?.sensors).into());
    }
    // The forward-looking one stands 0.6 m ahead of the turning one and 0.3 m lower; ahead is y.
    let apart = (front.translation() - main.translation()).to_array();
    close("apart", &apart, &[-0.02, 0.61, -0.29], absolute(0.01))?;
    close("height", &[main.translation().z], &[1.84], absolute(0.01))?;
    for (name, count, mount) in [("main_pandar64", 4, main), ("front_gt", 1, front)] {
        let one = choose(Some(name))?;
        let sweep = one.load_sweep(1)?;
        if sweep.points.len() != count || mounts(&one) != [mount] {
            return Err(format!("{name}: {} returns, {:?}", sweep.points.len(), mounts(&one)).into());
        }
        // Rays start at the sensor, but for the car's way since.
        let origins = sweep.origins.ok_or("no origins")?;
        let far = DVec3::from(origins[0].map(f64::from)).distance(mount.translation());
        if far > 0.05 {
            return Err(format!("{name}: a ray that starts {far} m from it").into());
        }
    }
    Ok(())
}

fn one_of_several() -> Outcome {
    let place = tempfile::tempdir()?;
    let source = place.path().join("source");
    fs::create_dir(&source)?;
    for name in ["a.tfrecord", "b.tfrecord"] {
        fs::copy(fixture("waymo/drive.tfrecord"), source.join(name))?;
    }
    import(&source, place.path(), &[])?.expect_refusal(&["--scene", "2 drives: a, b"])?;
    import(&source, place.path(), &["--scene", "c"])?.expect_refusal(&["--scene", "`c`", "a, b"])?;
    import(&source, place.path(), &["--scene", "b"])?.expect_success()?;
    let file = source.join("a.tfrecord");
    fs::remove_dir_all(place.path().join("out"))?;
    import(&file, place.path(), &["--scene", "a"])?.expect_refusal(&["--scene", "a file holds one drive"])
}
