//! Times of single returns in foreign folders, and what the car's motion does to sweeps that are not compensated for it.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use lgs_engine::points::aggregate;
use lgs_engine::views::ClipFrame;
use lgs_formats::clip_dir::ClipDir;
use lgs_formats::importers::{self, Layout, Selection};
use lgs_formats::sweep::read_sweep;
use lgs_tests::compare::{absolute, close};
use lgs_tests::layouts::foreign;
use lgs_tests::process::{binary, run};
use lgs_tests::{Needed, Outcome, case, case_if, clips, places};
use libtest_mimic::{Failed, Trial};
use serde_json::{Value, json};

pub(crate) fn cases() -> Vec<Trial> {
    let needed = |name: &str| {
        let folder = places::shared().join("foreign").join(name);
        (Needed::path(&folder, "the real foreign folders"), folder)
    };
    let (panda, panda_folder) = needed("pandaset_part");
    let (kitti, kitti_folder) = needed("kitti_raw_mini");
    let (av2, av2_folder) = needed("av2_log");
    vec![
        case("returns::foreign::layouts_that_have_times_keep_them", layouts_keep_times),
        case("returns::foreign::kitti_is_brought_to_one_moment", kitti_fixture),
        case("returns::foreign::an_inspection_says_what_is_known_of_returns", inspected),
        case_if(&panda, "returns::foreign::pandaset_part", move || pandaset(&panda_folder.join("002"))),
        case_if(&av2, "returns::foreign::av2_log", move || argoverse(&av2_folder)),
        case_if(&kitti, "returns::foreign::kitti_raw_mini", move || kitti_raw(&kitti_folder)),
    ]
}

/// The clip of a folder, written and opened.
fn imported(folder: &Path, place: &Path) -> Result<ClipDir, Failed> {
    written(&importers::open(folder)?, place)
}

fn written(source: &ClipDir, place: &Path) -> Result<ClipDir, Failed> {
    let out = place.join("clip");
    importers::write(source, &out)?;
    Ok(ClipDir::open(&out)?)
}

fn layouts_keep_times() -> Outcome {
    let layouts = [("pandaset", true), ("av2", true), ("waymo", true)];
    for (layout, has) in layouts.into_iter().chain(["dgp", "nuscenes", "kitti-raw"].map(|layout| (layout, false))) {
        let (place, folder) = (tempfile::tempdir()?, foreign(layout)?.path());
        let dir = imported(&folder, place.path())?;
        for (frame, record) in dir.clip().frames.iter().enumerate() {
            let (found, own) = (dir.load_sweep(frame)?.times, importers::open(&folder)?.load_sweep(frame)?.times);
            if record.lidar.returns.times.is_some() != has || found.is_some() != has || found != own {
                return Err(format!("{layout}: frame {frame}: times {found:?}").into());
            }
        }
    }
    Ok(())
}

fn inspected() -> Outcome {
    let page = |folder: &Path| -> Result<Value, Failed> {
        let arguments = ["inspect".as_ref(), folder.as_os_str(), "--json".as_ref()];
        Ok(serde_json::from_str(&run(&binary("lgs-clip")?, &arguments, folder)?.stdout)?)
    };
    let (place, plain) = (tempfile::tempdir()?, foreign("kitti-raw")?.path());
    let known = page(&with_turns(&plain, place.path(), [0.02, 0.03])?)?["lidar"]["returns"].clone();
    if (&known["num_timed"], &known["motion_compensated"], &known["num_sensors"])
        != (&json!(3), &json!(true), &json!(1))
        || known["first_ms"]["min"].as_f64().is_none_or(|ms| !(-20.0..0.0).contains(&ms))
    {
        return Err(format!("returns: {known:#}").into());
    }
    let unknown = page(&plain)?["lidar"].clone();
    if unknown.get("returns").is_none() { Ok(()) } else { Err(format!("without times: {unknown:#}").into()) }
}

/// Adds when a drive's turns begin and end: `before` and `after` the timestamps, seconds (with six digits).
fn with_turns(from: &Path, place: &Path, [before, after]: [f64; 2]) -> Result<PathBuf, Failed> {
    let date = place.join("date");
    clips::copy(from, &date)?;
    let drive = lgs_tests::sources::all_files(&date)?
        .into_iter()
        .map(|file| date.join(file))
        .find_map(|file| file.ends_with("velodyne_points/timestamps.txt").then(|| file.parent().map(Path::to_owned))?)
        .ok_or("no velodyne_points")?;
    let text = std::fs::read_to_string(drive.join("timestamps.txt"))?;
    for (name, by) in [("timestamps_start.txt", -before), ("timestamps_end.txt", after)] {
        let mut moved = String::new();
        for line in text.lines() {
            let (minute, seconds) = line.trim().split_at(17);
            writeln!(moved, "{minute}{:012.9}", seconds.parse::<f64>()? + by)?;
        }
        std::fs::write(drive.join(name), moved)?;
    }
    Ok(date)
}

/// The fixture's car, `time` seconds after the first sweep: the world from its LiDAR.
fn world([x, y, z]: [f64; 3], time: f64) -> DVec3 {
    let vehicle = DMat3::from_rotation_z(time) * DVec3::new(x + 1.0, y, z + 1.75);
    DVec3::new(1000.0 + 10.0 * time, 2000.0, 10.0) + vehicle
}

fn kitti_fixture() -> Outcome {
    let (place, plain) = (tempfile::tempdir()?, foreign("kitti-raw")?.path());
    let turns = [0.02, 0.03];
    let folder = with_turns(&plain, place.path(), turns)?;
    let dir = imported(&folder, place.path())?;
    let record = &dir.clip().frames[1].lidar;
    let raw = importers::open(&plain)?;
    let (raw, found) = (raw.load_sweep(1)?.points, dir.load_sweep(1)?);
    let times = found.times.ok_or("no times")?;
    for ((raw, found), time) in raw.iter().zip(&found.points).zip(times) {
        let raw = raw.map(f64::from);
        // From behind over the left, the front and the right.
        let azimuth = raw[1].atan2(raw[0]);
        let want = -azimuth / std::f64::consts::PI * turns[usize::from(azimuth < 0.0)];
        close("time", &[f64::from(time)], &[want], absolute(1e-6))?;
        let place = record.world_from_lidar.transform_point(DVec3::from(found.map(f64::from)));
        close("place", &place.to_array(), &world(raw, 0.1 + want).to_array(), absolute(2e-4))?;
    }
    Ok(())
}

fn pandaset(folder: &Path) -> Outcome {
    let place = tempfile::tempdir()?;
    let lidars = Some(vec!["main_pandar64".to_owned()]);
    let selection = Selection { lidars, ..Selection::default() };
    let dir = written(&importers::open_as(Layout::PandaSet, folder, &selection)?, place.path())?;
    let clip = dir.clip();
    for (f, frame) in clip.frames.iter().enumerate() {
        let sweep = dir.load_sweep(f)?;
        let times = sweep.times.ok_or("no times")?;
        let span = times.iter().fold([1.0_f32, -1.0], |[a, b], &t| [a.min(t), b.max(t)]);
        // A turn of a tenth of a second that ends at the timestamp.
        if !(-0.11..-0.09).contains(&span[0]) || !(-0.01..0.01).contains(&span[1]) {
            return Err(format!("frame {f}: times {span:?}").into());
        }
        // What a camera sees was measured while it looked there.
        for record in &frame.cameras {
            let camera_from_lidar = record.camera.world_from_camera.inverse() * frame.lidar.world_from_lidar;
            let ahead = |p: &[f32; 3]| {
                let [x, y, z] = camera_from_lidar.transform_point(DVec3::from(p.map(f64::from))).to_array();
                z > 5.0 && x.abs() < 0.05 * z && y.abs() < 0.2 * z
            };
            let seen: Vec<f32> = sweep.points.iter().zip(&times).filter(|(p, _)| ahead(p)).map(|(_, &t)| t).collect();
            let mean = seen.iter().map(|&t| f64::from(t)).sum::<f64>() / seen.len() as f64;
            let apart = (frame.lidar.timestamp + mean - record.camera.timestamp).abs();
            if seen.len() < 100 || apart > 0.01 {
                return Err(format!("frame {f}: {}: {apart} s from its returns", record.camera.name).into());
            }
        }
    }
    // Rays start along the car's way, not at one place a sweep.
    let cloud = aggregate(&dir, &[0, 1], &ClipFrame::of(clip, 0))?;
    let ahead = cloud.origins.iter().zip(&cloud.frames).filter(|(_, frame)| **frame == 0).map(|(origin, _)| *origin);
    let ahead: Vec<[f32; 3]> = ahead.collect();
    let from_first = |[x, y, z]: [f32; 3]| {
        let [a, b, c] = ahead[0];
        ((x - a).powi(2) + (y - b).powi(2) + (z - c).powi(2)).sqrt()
    };
    let spread = ahead.iter().fold(0.0_f32, |most, origin| most.max(from_first(*origin)));
    if spread > 0.2 { Ok(()) } else { Err(format!("rays start within {spread} m").into()) }
}

fn argoverse(folder: &Path) -> Outcome {
    let dir = importers::open(folder)?;
    for f in 0..dir.clip().frames.len() {
        let times = dir.load_sweep(f)?.times.ok_or("no times")?;
        let span = times.iter().fold([1.0_f32, -1.0], |[a, b], &t| [a.min(t), b.max(t)]);
        if span[0] < 0.0 || !(0.09..0.12).contains(&span[1]) {
            return Err(format!("frame {f}: times {span:?}").into());
        }
    }
    Ok(())
}

fn kitti_raw(folder: &Path) -> Outcome {
    let place = tempfile::tempdir()?;
    let folder = with_turns(&folder.join("2011_09_26"), place.path(), [0.05, 0.05])?;
    let dir = imported(&folder, place.path())?;
    let drive = importers::open(&folder)?;
    let frames = &drive.clip().frames;
    let step = frames[0].lidar.world_from_lidar.inverse() * frames[1].lidar.world_from_lidar;
    let velocity = step.translation() / (frames[1].lidar.timestamp - frames[0].lidar.timestamp);
    let raw = read_sweep(&drive.root().join(&frames[0].lidar.file))?;
    let sweep = dir.load_sweep(0)?;
    let times = sweep.times.ok_or("no times")?;
    let (mut left, mut right) = (Vec::new(), Vec::new());
    for ((raw, found), time) in raw.points.iter().zip(&sweep.points).zip(times) {
        let moved = DVec3::from(found.map(f64::from)) - DVec3::from(raw.map(f64::from));
        let time = f64::from(time);
        // The car hardly turns: what a return moves by is what the car drove until then.
        let turned = DVec3::from(raw.map(f64::from)).length() * 0.05 * 0.1;
        if moved.distance(velocity * time) > 0.01 + turned {
            return Err(format!("a return at {raw:?} of {time} s moved by {moved}, {velocity} a second").into());
        }
        if raw[0].abs() < raw[1].abs() {
            if raw[1] > 0.0 { left.push(time) } else { right.push(time) }
        }
    }
    let mean = |times: &[f64]| times.iter().sum::<f64>() / times.len() as f64;
    // Clockwise as seen from above: what lies to the left comes before what lies ahead.
    if mean(&left) < -0.02 && mean(&right) > 0.02 {
        Ok(())
    } else {
        Err(format!("left at {} s, right at {} s", mean(&left), mean(&right)).into())
    }
}
