//! `lgs-infer --motion`: what moves in the clip that ships has its velocity from the start.

use std::path::Path;

use lgs_engine::gaussians::{GaussianSet, MEAN, NUM_ATTRIBUTES};
use lgs_engine::views::ClipFrame;
use lgs_formats::clip_dir::ClipDir;
use lgs_formats::ply::read_ply;
use lgs_tests::process::{binary, run};
use lgs_tests::{Outcome, case, clips, metrics, places};
use lgs_train::velocity::{TrueVelocities, VelocityErrors};
use libtest_mimic::{Failed, Trial};

/// Largest error of what moves, as a share of its speed.
const MOVING: f64 = 0.2;
/// Largest mean speed of what stands still, metres a second.
const RESTING: f64 = 0.02;

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("cli::motion::street", || near_the_tracks(&["--hold-out", "odd"], &[0, 2, 4])),
        case("cli::motion::street_of_two_frames", || near_the_tracks(&["--frames", "0,2"], &[0, 2])),
        case("cli::motion::all_of_street", || near_the_tracks(&[], &[0, 1, 2, 3, 4])),
        case("cli::motion::none", nothing_moves),
        case("cli::motion::boxes", boxes_tell),
        case("cli::motion::boxes_of_held_out_frames_do_not_count", boxes_of_held_out_frames_do_not_count),
        case("cli::motion::boxes_where_there_are_none", no_boxes_to_tell),
        case("cli::motion::held_out_sweeps_do_not_count", held_out_sweeps_do_not_count),
    ]
}

/// The `LiDAR` Gaussians of a run without a network.
fn initial(clip: &Path, flags: &[&str]) -> Result<GaussianSet, Failed> {
    let place = tempfile::tempdir()?;
    let out = place.path().join("out");
    let mut arguments = vec![clip.as_os_str(), "--out".as_ref(), out.as_os_str()];
    let common = ["--weights", "none", "--background", "off", "--views", "none", "--image-size", "96x160"];
    arguments.extend(common.iter().chain(flags).map(|flag| flag.as_ref() as &std::ffi::OsStr));
    run(&binary("lgs-infer")?, &arguments, places::repository())?.expect_success()?;
    let named = |name: &&&str| flags.contains(*name);
    let wanted = ["none", "boxes"].iter().find(named).copied().unwrap_or("registered");
    let page = metrics::read(&out)?;
    if page["config"]["motion"] != wanted {
        return Err(format!("motion {}, want {wanted}", page["config"]["motion"]).into());
    }
    let cloud = read_ply(&out.join("scene.ply"))?;
    let row = |mean: &[f32; 3]| {
        let mut row = [0.0; NUM_ATTRIBUTES];
        row[MEAN].copy_from_slice(mean);
        row
    };
    let attributes: Vec<_> = cloud.means.iter().map(row).collect();
    let frames = cloud.frames.ok_or("scene.ply: no column `frame`")?;
    let num_lidar = attributes.len();
    Ok(GaussianSet { attributes, times: cloud.times, frames, velocities: cloud.velocities, num_lidar })
}

fn errors(scene: &GaussianSet, inputs: &[usize]) -> Result<VelocityErrors, Failed> {
    let dir = ClipDir::open(&clips::street())?;
    let frame = ClipFrame::of(dir.clip(), inputs[0]);
    let known: Vec<usize> = (0..dir.clip().frames.len()).collect();
    let truth = TrueVelocities::of(dir.clip(), &frame, inputs, &known, scene).ok_or("the clip has no boxes")?;
    Ok(truth.errors(scene))
}

fn near_the_tracks(flags: &[&str], inputs: &[usize]) -> Outcome {
    let errors = errors(&initial(&clips::street(), flags)?, inputs)?;
    let good = errors.moving > 100 && errors.error < MOVING * errors.speed && errors.resting_speed < RESTING;
    if good { Ok(()) } else { Err(format!("{errors:?}").into()) }
}

fn nothing_moves() -> Outcome {
    let scene = initial(&clips::street(), &["--hold-out", "odd", "--motion", "none"])?;
    let moving = scene.velocities.iter().filter(|v| **v != [0.0; 3]).count();
    if moving == 0 { Ok(()) } else { Err(format!("{moving} Gaussians move").into()) }
}

/// Other sweeps in the place of those that are held out change no velocity.
fn held_out_sweeps_do_not_count() -> Outcome {
    let place = tempfile::tempdir()?;
    let clip = place.path().join("clip");
    clips::copy(&clips::street(), &clip)?;
    for frame in [1, 3] {
        let file = |frame: usize| clips::named_file(&clip, &format!("/frames/{frame}/lidar/file"));
        std::fs::copy(file(0)?, file(frame)?)?;
    }
    let [clean, other] = [clips::street(), clip].map(|clip| initial(&clip, &["--hold-out", "odd"]));
    let (clean, other) = (clean?, other?);
    let moving = clean.velocities.iter().any(|v| *v != [0.0; 3]);
    if moving && clean == other { Ok(()) } else { Err("the sweeps of held-out frames count".into()) }
}

/// What is inside of a box moves as the box does, and nothing else.
fn boxes_tell() -> Outcome {
    let errors = errors(&initial(&clips::street(), &["--hold-out", "odd", "--motion", "boxes"])?, &[0, 2, 4])?;
    let good = errors.moving > 100 && errors.error < 0.05 * errors.speed && errors.resting_speed < RESTING;
    if good { Ok(()) } else { Err(format!("{errors:?}").into()) }
}

fn without_boxes(clip: &Path, frames: &[usize]) -> Result<(), Failed> {
    clips::copy(&clips::street(), clip)?;
    clips::edit(clip, |description| {
        for &frame in frames {
            description["frames"][frame].as_object_mut().and_then(|frame| frame.remove("boxes"));
        }
    })?;
    Ok(())
}

fn boxes_of_held_out_frames_do_not_count() -> Outcome {
    let place = tempfile::tempdir()?;
    let clip = place.path().join("clip");
    without_boxes(&clip, &[1, 3])?;
    let [clean, other] =
        [clips::street(), clip].map(|clip| initial(&clip, &["--hold-out", "odd", "--motion", "boxes"]));
    if clean? == other? { Ok(()) } else { Err("the boxes of held-out frames count".into()) }
}

fn no_boxes_to_tell() -> Outcome {
    let place = tempfile::tempdir()?;
    let (clip, out) = (place.path().join("clip"), place.path().join("out"));
    without_boxes(&clip, &[0, 1, 2, 3, 4])?;
    let arguments = [clip.as_os_str(), "--motion".as_ref(), "boxes".as_ref(), "--out".as_ref(), out.as_os_str()];
    let names = ["--motion", "`boxes` of an input frame in clip.json", "found none"];
    run(&binary("lgs-infer")?, &arguments, places::repository())?.expect_one_line_at_the_end(&names)?;
    if out.join("scene.ply").exists() { Err("a scene was written".into()) } else { Ok(()) }
}
