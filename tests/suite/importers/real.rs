//! The real foreign folders beside the repository, where they are, against the same drives as clips.

use std::path::PathBuf;

use lgs_formats::clip::{Clip, TrackedBox};
use lgs_formats::clip_dir::ClipDir;
use lgs_formats::importers;
use lgs_formats::pose::Pose;
use lgs_tests::compare::{absolute, close, widened};
use lgs_tests::{Needed, Outcome, case_if, places};
use libtest_mimic::Trial;

/// Largest error of poses (metres, and entries of rotations), of intrinsics (pixels), of points (metres), of times (seconds).
const POSE: f64 = 1e-6;
const INTRINSICS: f64 = 1e-4;
const POINT: f64 = 1e-4;
const TIME: f64 = 1e-6;

pub(crate) fn cases() -> Vec<Trial> {
    let pair = |name: &str, folder: &'static str, clip: &'static str| {
        let (foreign, clip) = (shared("foreign", folder), shared("clips", clip));
        let needed = match Needed::path(&foreign, "the real foreign folders") {
            Needed::Here => Needed::path(&clip, "the real clips"),
            missing => missing,
        };
        case_if(&needed, format!("importers::real::{name}"), move || equals(&foreign, &clip))
    };
    let log = shared("foreign", "av2_log");
    let needed = Needed::path(&log, "the real foreign folders");
    vec![
        pair("dgp_scene_02_is_ddad_scene_02", "dgp_scene_02", "ddad_scene_02"),
        pair("kitti_raw_mini_is_kitti_sfnd", "kitti_raw_mini", "kitti_sfnd"),
        case_if(&needed, "importers::real::av2_log_fits_itself", move || boxes_hold_their_points(&log)),
    ]
}

fn shared(kind: &str, name: &str) -> PathBuf {
    places::shared().join(kind).join(name)
}

fn entries(pose: &Pose) -> Vec<f64> {
    pose.rows().into_iter().flatten().collect()
}

/// The pose in the frame of the clip's first sweep.
fn relative(clip: &Clip, pose: &Pose) -> Vec<f64> {
    entries(&(clip.frames[0].lidar.world_from_lidar.inverse() * *pose))
}

/// Every frame of the foreign folder is the frame of that index of the clip.
fn equals(foreign: &std::path::Path, clip: &std::path::Path) -> Outcome {
    let (got_dir, want_dir) = (importers::open(foreign)?, ClipDir::open(clip)?);
    let (got, want) = (got_dir.clip(), want_dir.clip());
    let start = |clip: &Clip| clip.frames[0].lidar.timestamp;
    for (f, (a, b)) in got.frames.iter().zip(&want.frames).enumerate() {
        let name = |what: &str| format!("frame {f}: {what}");
        let (pose_a, pose_b) = (&a.lidar.world_from_lidar, &b.lidar.world_from_lidar);
        close(&name("lidar pose"), &relative(got, pose_a), &relative(want, pose_b), absolute(POSE))?;
        let times = [a.lidar.timestamp - start(got)];
        close(&name("lidar time"), &times, &[b.lidar.timestamp - start(want)], absolute(TIME))?;
        let (sweep_a, sweep_b) = (got_dir.load_sweep(f)?, want_dir.load_sweep(f)?);
        let (points_a, points_b) = (sweep_a.points.as_flattened(), sweep_b.points.as_flattened());
        close(&name("points"), &widened(points_a), &widened(points_b), absolute(POINT))?;
        close(&name("intensities"), &widened(&sweep_a.intensities), &widened(&sweep_b.intensities), absolute(1e-6))?;
        let names = |frame: &lgs_formats::clip::Frame| -> Vec<String> {
            let mut names: Vec<String> = frame.cameras.iter().map(|record| record.camera.name.clone()).collect();
            names.sort();
            names
        };
        if names(a) != names(b) {
            return Err(format!("frame {f}: cameras {:?}, want {:?}", names(a), names(b)).into());
        }
        for record in &a.cameras {
            let Some(other) = b.cameras.iter().find(|other| other.camera.name == record.camera.name) else { continue };
            let (x, y) = (&record.camera, &other.camera);
            let name = |what: &str| format!("frame {f}: {} {what}", x.name);
            let (pose_a, pose_b) = (relative(got, &x.world_from_camera), relative(want, &y.world_from_camera));
            close(&name("pose"), &pose_a, &pose_b, absolute(POSE))?;
            let numbers = |k: lgs_formats::camera::Intrinsics| [k.fx, k.fy, k.cx, k.cy];
            close(&name("intrinsics"), &numbers(x.intrinsics), &numbers(y.intrinsics), absolute(INTRINSICS))?;
            close(&name("time"), &[x.timestamp - start(got)], &[y.timestamp - start(want)], absolute(TIME))?;
            let bytes = |dir: &ClipDir, file: &PathBuf| std::fs::read(dir.root().join(file));
            if bytes(&got_dir, &record.file)? != bytes(&want_dir, &other.file)? {
                return Err(format!("frame {f}: {}: another image file", x.name).into());
            }
        }
        same_boxes(f, [got, want], [a.boxes.as_deref(), b.boxes.as_deref()])?;
    }
    Ok(())
}

fn same_boxes(frame: usize, [got, want]: [&Clip; 2], boxes: [Option<&[TrackedBox]>; 2]) -> Outcome {
    let [Some(a), Some(b)] = boxes else {
        return if boxes == [None, None] {
            Ok(())
        } else {
            Err(format!("frame {frame}: boxes on one side only").into())
        };
    };
    if a.len() != b.len() {
        return Err(format!("frame {frame}: {} boxes, want {}", a.len(), b.len()).into());
    }
    for tracked in a {
        let Some(other) = b.iter().find(|other| (&other.track, &other.category) == (&tracked.track, &tracked.category))
        else {
            return Err(format!("frame {frame}: no box {} of {}", tracked.track, tracked.category).into());
        };
        let name = format!("frame {frame}: box {}", tracked.track);
        close(&name, &tracked.size, &other.size, absolute(POSE))?;
        let (a, b) = (relative(got, &tracked.world_from_box), relative(want, &other.world_from_box));
        close(&name, &a, &b, absolute(POSE))?;
    }
    Ok(())
}

/// Sweeps and annotations were stored apart: most boxes must hold points, and few points lie below the road.
fn boxes_hold_their_points(log: &std::path::Path) -> Outcome {
    let dir = importers::open(log)?;
    for (f, frame) in dir.clip().frames.iter().enumerate() {
        let points: Vec<_> = dir
            .load_sweep(f)?
            .points
            .iter()
            .map(|p| frame.lidar.world_from_lidar.transform_point(p.map(f64::from).into()))
            .collect();
        let boxes = frame.boxes.as_deref().unwrap_or_default();
        let holds = |tracked: &&TrackedBox| {
            let box_from_world = tracked.world_from_box.inverse();
            let half = tracked.size.map(|edge| edge / 2.0);
            points.iter().any(|&p| {
                let p = box_from_world.transform_point(p).to_array();
                (0..3).all(|k| p[k].abs() <= half[k])
            })
        };
        let filled = boxes.iter().filter(holds).count();
        if boxes.len() < 50 || filled * 10 < boxes.len() * 8 {
            return Err(format!("frame {f}: {filled} of {} boxes hold points", boxes.len()).into());
        }
    }
    Ok(())
}
