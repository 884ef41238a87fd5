//! `metrics.json`: what copying an input image is worth, and which share of the Gaussians moves.

use std::path::Path;

use lgs_formats::ply::read_ply;
use lgs_tests::compare::{absolute, close};
use lgs_tests::metrics::{self, number};
use lgs_tests::process::{binary, run};
use lgs_tests::{Outcome, case, clips, places};
use libtest_mimic::{Failed, Trial};

/// Speed above which a Gaussian counts as moving, m/s.
const MOVING_SPEED: f32 = 0.5;

pub(crate) fn cases() -> Vec<Trial> {
    vec![case("cli::copying::figures_are_those_of_the_files", figures_are_those_of_the_files)]
}

/// Frame 2 is held out between the inputs 1 and 3, so that 1 is copied; inputs have no copy.
fn figures_are_those_of_the_files() -> Outcome {
    let place = tempfile::tempdir()?;
    let out = place.path().join("out");
    let clip = clips::street();
    let flags = ["--weights", "none", "--background", "gaps", "--frames", "1..3", "--hold-out", "2"];
    let mut arguments = vec![clip.as_os_str(), "--out".as_ref(), out.as_os_str()];
    arguments.extend(flags.iter().map(|flag| flag.as_ref() as &std::ffi::OsStr));
    run(&binary("lgs-infer")?, &arguments, places::repository())?.expect_success()?;
    let page = metrics::read(&out)?;
    let mut copies = Vec::new();
    for view in page["views"].as_array().ok_or("no views")? {
        let camera = view["camera"].as_str().ok_or("no camera")?;
        if view["role"] == "input" {
            if !view["psnr_copying"].is_null() {
                return Err(format!("an input view has a copy: {view}").into());
            }
            continue;
        }
        let want = of_pictures(&out, camera, [1, 2])?;
        close(camera, &[number(view, &["psnr_copying"])?], &[want], absolute(0.05))?;
        copies.push(number(view, &["psnr_copying"])?);
    }
    let mean = copies.iter().sum::<f64>() / copies.len() as f64;
    close("mean", &[number(&page, &["mean", "held_out", "psnr_copying"])?], &[mean], absolute(1e-9))?;

    let cloud = read_ply(&out.join("scene.ply"))?;
    let moves = |v: &[f32; 3]| v.iter().map(|x| x * x).sum::<f32>() > MOVING_SPEED * MOVING_SPEED;
    let share = |all: &[[f32; 3]]| all.iter().filter(|v| moves(v)).count() as f64 / all.len() as f64;
    let num_lidar = page["gaussians"]["final"].as_u64().ok_or("no count")?;
    let (lidar, background) = cloud.velocities.split_at(usize::try_from(num_lidar)?);
    let got = [number(&page, &["moving", "lidar"])?, number(&page, &["moving", "background"])?];
    close("moving", &got, &[share(lidar), share(background)], absolute(1e-12))?;
    if got[0] > 0.0 { Ok(()) } else { Err("nothing moves in the clip that ships".into()) }
}

/// PSNR of the true pictures of two frames.
fn of_pictures(out: &Path, camera: &str, frames: [usize; 2]) -> Result<f64, Failed> {
    let [a, b] = frames.map(|frame| image::open(out.join(format!("views/f{frame}_{camera}_truth.png"))));
    let (a, b) = (a?.to_rgb8(), b?.to_rgb8());
    let pairs = a.as_raw().iter().zip(b.as_raw());
    let sum: f64 = pairs.map(|(a, b)| ((f64::from(*a) - f64::from(*b)) / 255.0).powi(2)).sum();
    Ok(-10.0 * (sum / a.as_raw().len() as f64).log10())
}
