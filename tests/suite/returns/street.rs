//! A made street whose LiDAR takes a tenth of a second to turn while the car drives.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec3;
use lgs_engine::gaussians::{Coarseness, GaussianSet, Start, background::Mode};
use lgs_engine::pipeline::{Opening, Run, Session, Silent, Watch};
use lgs_engine::points::PointCloud;
use lgs_engine::predict::other_time_neighbours;
use lgs_formats::clip_dir::ClipDir;
use lgs_formats::sweep::{read_sweep, write_sweep};
use lgs_tests::process::{binary, run};
use lgs_tests::{Outcome, case, clips, metrics};
use lgs_train::scenes::export::{Export, ImageFormat, write};
use lgs_train::scenes::presets;
use lgs_train::scenes::{Scene, SceneConfig};
use libtest_mimic::{Failed, Trial};
use serde_json::Value;

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("returns::street::motion_is_undone_where_the_clip_tells_of_it", motion_is_undone),
        case("returns::street::compensated_or_not_is_the_same_scene", compensated_or_not),
        case("returns::street::gaussians_have_the_times_of_their_returns", times_of_returns),
        case("returns::street::told_motion_is_worth_decibels", worth),
    ]
}

/// Seconds of a turn, and metres a second of the car.
const TURN: f64 = 0.1;
const SPEED: f64 = 14.0;
/// What telling of the motion brings at least, decibels.
const WORTH: f64 = 0.15;

/// The street, faster, with exact ranges and a LiDAR that turns.
fn config() -> SceneConfig {
    let mut config = presets::street_clip(3);
    config.traffic.ego_speed = SPEED;
    (config.rig.lidar.sweep_s, config.rig.lidar.compensated) = (TURN, false);
    config.rig.lidar.range_noise_m = 0.0;
    config.rig.cameras.truncate(1);
    for camera in &mut config.rig.cameras {
        (camera.height, camera.width) = (96, 160);
    }
    config
}

/// The street as a clip of returns as they were measured.
fn street(place: &Path) -> Result<(Scene, PathBuf), Failed> {
    written(config(), place)
}

fn written(config: SceneConfig, place: &Path) -> Result<(Scene, PathBuf), Failed> {
    let (scene, clip) = (Scene::new(config)?, place.join("measured"));
    let export = Export { name: "turning".to_owned(), images: ImageFormat::Png, masks: false, depth: None };
    write(&scene, &clip, &export, &|| ())?;
    Ok((scene, clip))
}

/// A copy of a clip whose `lidar` entries were changed.
fn changed(clip: &Path, name: &str, change: impl Fn(&mut serde_json::Map<String, Value>)) -> Result<PathBuf, Failed> {
    let copy = clip.with_file_name(name);
    clips::copy(clip, &copy)?;
    clips::edit(&copy, |description| {
        let frames = description["frames"].as_array_mut().into_iter().flatten();
        frames.filter_map(|frame| frame["lidar"].as_object_mut()).for_each(&change);
    })?;
    Ok(copy)
}

/// A copy of a clip that says nothing of times and motion, as if all returns were of one moment.
fn untold(clip: &Path) -> Result<PathBuf, Failed> {
    changed(clip, "untold", |lidar| {
        lidar.remove("times");
        lidar.remove("motion_compensated");
    })
}

/// Largest and mean distance of a frame's returns from where they were measured, metres.
fn off(scene: &Scene, dir: &ClipDir, measured: &Path, frame: usize) -> Result<[f64; 2], Failed> {
    let raw = read_sweep(&clips::named_file(measured, &format!("/frames/{frame}/lidar/file"))?)?;
    let times = scene.scan(frame).sweep.times.ok_or("the scan has no times")?;
    let here = dir.clip().frames[frame].lidar.world_from_lidar;
    let wide = |p: &[f32; 3]| DVec3::from(p.map(f64::from));
    let distance = |((loaded, raw), &time): ((&[f32; 3], &[f32; 3]), &f32)| {
        let want = scene.world_from_lidar_at(frame, f64::from(time)).transform_point(wide(raw));
        here.transform_point(wide(loaded)).distance(want)
    };
    let loaded = dir.load_sweep(frame)?;
    let distances: Vec<f64> = loaded.points.iter().zip(&raw.points).zip(&times).map(distance).collect();
    let mean = distances.iter().sum::<f64>() / distances.len() as f64;
    Ok([distances.iter().copied().fold(0.0, f64::max), mean])
}

fn motion_is_undone() -> Outcome {
    let place = tempfile::tempdir()?;
    let (scene, clip) = street(place.path())?;
    let (told, untold) = (ClipDir::open(&clip)?, ClipDir::open(&untold(&clip)?)?);
    for frame in 0..scene.config().num_frames {
        let (told, untold) = (off(&scene, &told, &clip, frame)?, off(&scene, &untold, &clip, frame)?);
        // The car sways and brakes between the poses that a clip has.
        if told[0] > 0.03 || untold[1] < 0.2 {
            return Err(format!("frame {frame}: largest and mean error {told:?} m, untold {untold:?} m").into());
        }
    }
    Ok(())
}

/// The clip with its returns brought to one moment beforehand.
fn compensated(clip: &Path) -> Result<PathBuf, Failed> {
    let copy = changed(clip, "compensated", |lidar| drop(lidar.remove("motion_compensated")))?;
    let dir = ClipDir::open(clip)?;
    for (frame, record) in dir.clip().frames.iter().enumerate() {
        write_sweep(&copy.join(&record.lidar.file), &dir.load_sweep(frame)?)?;
    }
    Ok(copy)
}

/// The initial scene of a clip with a Gaussian for each return that a camera sees, and its cloud.
fn initial(clip: &Path) -> Result<(GaussianSet, PointCloud), Failed> {
    let mut watch = Watch::new(&Silent);
    let session = Session::open(Arc::new(ClipDir::open(clip)?), Opening::default(), &mut watch)?;
    let start = Start { background: Mode::Off, coarseness: Coarseness::FINEST };
    let made = session.run(&Run::initial(start), &mut watch)?;
    Ok((made.scene, session.inputs().cloud()?))
}

fn compensated_or_not() -> Outcome {
    let place = tempfile::tempdir()?;
    let (_, clip) = street(place.path())?;
    let (measured, compensated) = (initial(&clip)?, initial(&compensated(&clip)?)?);
    if measured != compensated {
        return Err("the scenes differ".into());
    }
    let stays = changed(&clip, "to_zero", |lidar| {
        lidar.remove("times");
        lidar.insert("motion_compensated".to_owned(), serde_json::json!({ "to": 0 }));
    })?;
    if initial(&stays)? == initial(&untold(&clip)?)? { Ok(()) } else { Err("`to` 0 is not what is usual".into()) }
}

fn times_of_returns() -> Outcome {
    let place = tempfile::tempdir()?;
    let (scene, clip) = street(place.path())?;
    let (set, cloud) = initial(&clip)?;
    let starts: Vec<f32> = (0..5_u8).map(|frame| 0.1 * f32::from(frame)).collect();
    let mut spans = [[f32::INFINITY, f32::NEG_INFINITY]; 5];
    for (i, (row, (&time, &frame))) in set.attributes.iter().zip(set.times.iter().zip(&set.frames)).enumerate() {
        let after = time - starts[frame as usize];
        let [first, last] = spans[frame as usize];
        spans[frame as usize] = [first.min(after), last.max(after)];
        let place = cloud.positions.iter().position(|position| position[..] == row[..3]);
        let Some(place) = place.filter(|_| f64::from(after.abs()) <= 0.5 * TURN + 1e-6) else {
            return Err(format!("Gaussian {i} of frame {frame}: {after} s after its sweep's timestamp").into());
        };
        if (cloud.times[place], cloud.frames[place]) != (time, frame) {
            return Err(format!("Gaussian {i}: time {time}, that of its return is {}", cloud.times[place]).into());
        }
    }
    // Rays start where the LiDAR was: from the first to the last of a turn it drives more than a metre.
    let first_sweep = cloud.frames.partition_point(|&frame| frame == 0);
    let ahead = cloud.origins[..first_sweep].iter().map(|origin| origin[0]);
    let driven = ahead.clone().fold(f32::MIN, f32::max) - ahead.fold(f32::MAX, f32::min);
    let want = scene.world_from_lidar_at(0, 0.5 * TURN).translation();
    let want = want.distance(scene.world_from_lidar_at(0, -0.5 * TURN).translation());
    if spans.iter().any(|[first, last]| last - first < 0.03) || (f64::from(driven) - want).abs() > 0.05 {
        return Err(format!("first and last returns {spans:?} s, {driven} m driven in a turn, want {want} m").into());
    }
    let mut whole = set.clone();
    whole.times = set.frames.iter().map(|&frame| starts[frame as usize]).collect();
    let [found, want] = [&set, &whole].map(|set| other_time_neighbours(set, 8));
    let (Some(found), Some(want)) = (found?, want?) else { return Err("nobody was asked".into()) };
    if found.indices == want.indices { Ok(()) } else { Err("times of returns change the query's neighbours".into()) }
}

fn worth() -> Outcome {
    let place = tempfile::tempdir()?;
    let mut config = config();
    (config.rig.lidar.num_beams, config.rig.lidar.num_azimuths) = (64, 400);
    for camera in &mut config.rig.cameras {
        (camera.height, camera.width) = (192, 320);
    }
    let (_, clip) = written(config, place.path())?;
    let psnr = |clip: &Path| -> Result<f64, Failed> {
        let out = clip.with_extension("scene");
        let flags = ["--hold-out", "odd", "--weights", "none", "--out"];
        let mut arguments = vec![clip.as_os_str()];
        arguments.extend(flags.iter().map(|flag| flag.as_ref() as &std::ffi::OsStr));
        arguments.push(out.as_os_str());
        run(&binary("lgs-infer")?, &arguments, place.path())?.expect_success()?;
        fs::metadata(out.join("scene.ply"))?;
        Ok(metrics::number(&metrics::read(&out)?, &["mean", "held_out", "psnr"])?)
    };
    let (told, untold) = (psnr(&clip)?, psnr(&untold(&clip)?)?);
    if told > untold + WORTH { Ok(()) } else { Err(format!("held out {told} dB, untold {untold} dB").into()) }
}
