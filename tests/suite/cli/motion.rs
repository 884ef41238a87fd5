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
    let wanted = if flags.contains(&"none") { "none" } else { "registered" };
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
