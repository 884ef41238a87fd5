//! Rigs whose cameras disagree: in colour, in what lens their images have, in whether they see colour at all.

use std::f64::consts::PI;
use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec3};
use lgs_formats::clip_dir::ClipDir;
use lgs_formats::image::{RgbImage, write_png};
use lgs_formats::pose::Pose;
use lgs_formats::sweep::{read_sweep, write_sweep};
use lgs_tests::compare::{absolute, close};
use lgs_tests::metrics::number;
use lgs_tests::{Outcome, case, clips};
use libtest_mimic::{Failed, Trial};
use serde_json::{Value, json};

use crate::street;

/// A barrel of a lens, `[k1, k2, p1, p2, k3]`.
const LENS: [f64; 5] = [-0.25, 0.05, 0.0, 0.0, 0.0];
/// What a second camera of other colours may cost the first, decibels.
const COST: f64 = 0.25;

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("rig::cameras_of_other_colours_agree", other_colours),
        case("rig::a_grey_camera_takes_no_colour_away", grey_camera),
        case("rig::a_lens_that_images_know_nothing_of_is_told", stated_lens),
        case("rig::a_lens_that_images_have_stays", real_lens),
        case("rig::a_camera_that_is_turned_is_told", turned_camera),
        case("rig::a_lidar_may_be_mounted_otherwise", mounted_otherwise),
    ]
}

/// A copy of the shipped clip whose images were changed: `change` gets the camera's place in the rig, the image and its focal length.
fn changed(place: &Path, change: impl Fn(usize, &RgbImage, f64) -> RgbImage) -> Result<PathBuf, Failed> {
    let copy = place.join("changed");
    clips::copy(&clips::street(), &copy)?;
    let dir = ClipDir::open(&clips::street())?;
    let mut names = Vec::new();
    for (f, frame) in dir.clip().frames.iter().enumerate() {
        for c in 0..frame.cameras.len() {
            let loaded = dir.load_image(f, c, None)?;
            let name = format!("images/changed_{f}_{c}.png");
            write_png(&copy.join(&name), &change(c, &loaded.rgb, loaded.camera.intrinsics.fx))?;
            names.push(name);
        }
    }
    let mut names = names.into_iter();
    each_camera(&copy, |camera| camera["file"] = json!(names.next()))?;
    Ok(copy)
}

fn each_camera(clip: &Path, mut change: impl FnMut(&mut Value)) -> Result<(), String> {
    clips::edit(clip, |description| {
        let frames = description["frames"].as_array_mut().into_iter().flatten();
        frames.filter_map(|frame| frame["cameras"].as_array_mut()).flatten().for_each(&mut change);
    })
}

/// `metrics.json` of a run with odd frames held out and no network.
fn metrics_of(clip: &Path, flags: &[&str]) -> Result<Value, Failed> {
    Ok(street::half_size_of(clip, &[&["--weights", "none"], flags].concat())?)
}

/// Mean PSNR of a camera's held-out views.
fn psnr(page: &Value, camera: &str) -> Result<f64, Failed> {
    let views = page["views"].as_array().ok_or("no views")?;
    let own = views.iter().filter(|view| view["role"] == "held_out" || view["role"] == "held-out");
    let own: Vec<&Value> = own.filter(|view| view["camera"] == camera).collect();
    let sum = own.iter().map(|view| number(view, &["psnr"])).sum::<Result<f64, String>>()?;
    if own.is_empty() { Err(format!("no held-out view of {camera}").into()) } else { Ok(sum / own.len() as f64) }
}

#[expect(clippy::cast_possible_truncation, reason = "a focal length in pixels")]
fn narrow(focal: f64) -> f32 {
    focal as f32
}

/// The second camera has less gain, another white balance and vignetting: the first is as good as if it had not, and better than without
/// common colours.
fn other_colours() -> Outcome {
    let place = tempfile::tempdir()?;
    let clip = changed(place.path(), |camera, image, focal| {
        let mut image = image.clone();
        if camera == 1 {
            let (width, height) = (image.width, image.height);
            let focal = narrow(focal);
            for (i, value) in image.data.iter_mut().enumerate() {
                let (x, y) =
                    ((i / 3 % width) as f32 - 0.5 * width as f32, (i / 3 / width) as f32 - 0.5 * height as f32);
                let vignetting = (-0.3 * (x * x + y * y) / (focal * focal)).exp();
                *value *= [0.65, 0.7, 0.8][i % 3] * vignetting;
            }
        }
        image
    })?;
    let (agreed, as_taken) = (metrics_of(&clip, &[])?, metrics_of(&clip, &["--colours", "as-taken"])?);
    let before = street::without_network()?;
    if !before["photometry"].is_null() || agreed["photometry"]["reference"] != "front" {
        return Err(
            format!("photometry {}, of the clip as it is {}", agreed["photometry"], before["photometry"]).into()
        );
    }
    let [agreed, as_taken, before] = [&agreed, &as_taken, before].map(|page| psnr(page, "front"));
    let (agreed, as_taken, before) = (agreed?, as_taken?, before?);
    if agreed > before - COST && agreed > as_taken + 0.1 {
        return Ok(());
    }
    Err(format!("front camera: {before} dB as it was, {agreed} dB agreed, {as_taken} dB as taken").into())
}

/// A grey camera in the place of the first, beside it.
fn grey_camera() -> Outcome {
    let place = tempfile::tempdir()?;
    let clip = changed(place.path(), |_, image, _| {
        let mut image = image.clone();
        for pixel in image.data.as_chunks_mut::<3>().0 {
            *pixel = [pixel.iter().sum::<f32>() / 3.0; 3];
        }
        image
    })?;
    // The colour images of the shipped clip stay; the grey ones stand beside them.
    let grey = clips::description(&clip)?;
    let both = place.path().join("both");
    clips::copy(&clip, &both)?;
    std::fs::copy(clips::street().join("clip.json"), both.join("clip.json"))?;
    clips::edit(&both, |description| {
        let frames = description["frames"].as_array_mut().into_iter().flatten();
        for (frame, grey) in frames.zip(grey["frames"].as_array().into_iter().flatten()) {
            let mut camera = grey["cameras"][0].clone();
            camera["name"] = json!("grey");
            frame["cameras"].as_array_mut().into_iter().for_each(|cameras| cameras.push(camera.clone()));
        }
    })?;
    let (without, with) = (street::without_network()?, metrics_of(&both, &[])?);
    let [without, with] = [psnr(without, "front")?, psnr(&with, "front")?];
    if with < without - 0.1 {
        return Err(format!("{without} dB without the grey camera, {with} dB with it").into());
    }
    Ok(())
}

fn with_lens(clip: &Path) -> Result<(), String> {
    each_camera(clip, |camera| camera["distortion"] = json!(LENS))
}

fn stated_lens() -> Outcome {
    let place = tempfile::tempdir()?;
    let copy = place.path().join("stated");
    clips::copy(&clips::street(), &copy)?;
    with_lens(&copy)?;
    let (plain, told) = (street::without_network()?, metrics_of(&copy, &[])?);
    let stated = metrics_of(&copy, &["--lenses", "stated"])?;
    if told["lenses"]["cameras"] != json!(["front", "front_left"]) || !stated["lenses"].is_null() {
        return Err(format!("lenses {}, where stated {}", told["lenses"], stated["lenses"]).into());
    }
    if told["views"] == plain["views"] {
        return Ok(());
    }
    Err("the figures are not those of the clip without a lens".into())
}

fn real_lens() -> Outcome {
    let place = tempfile::tempdir()?;
    let clip = changed(place.path(), |_, image, focal| distorted(image, focal))?;
    with_lens(&clip)?;
    let page = metrics_of(&clip, &[])?;
    if page["lenses"].is_null() { Ok(()) } else { Err(format!("the lens was taken away: {}", page["lenses"]).into()) }
}

/// The second camera turned and moved against what the clip states, then the first, against which all others seem to be wrong.
fn turned_camera() -> Outcome {
    let place = tempfile::tempdir()?;
    let copy = place.path().join("turned");
    clips::copy(&clips::street(), &copy)?;
    let [turn, shift] = [DVec3::new(0.004, -0.006, 0.003), DVec3::new(0.02, 0.0, 0.01)];
    let dir = ClipDir::open(&clips::street())?;
    let mut poses = dir.clip().frames.iter().flat_map(|frame| &frame.cameras).map(|record| &record.camera);
    let wrong = Pose::new(DMat3::from_quat(DQuat::from_scaled_axis(turn)), shift);
    each_camera(&copy, |camera| {
        if let Some(stated) = poses.next().filter(|stated| stated.name == "front_left") {
            camera["world_from_camera"] = json!((stated.world_from_camera * wrong).rows());
        }
    })?;
    // Turns of half a pixel are told at the full size alone.
    let run = |clip: &Path, flags: &[&str]| {
        street::found_of(clip, &[&["--weights", "none", "--views", "held-out"], flags].concat())
    };
    let plain = run(&clips::street(), &[])?;
    if !plain["mounts"].is_null() {
        return Err(format!("cameras that are where they are stated: {}", plain["mounts"]).into());
    }
    let found = run(&copy, &[])?;
    let stated = run(&copy, &["--mounts", "stated"])?;
    let first = run(&copy, &["--reference-camera", "front_left"])?;
    for (page, camera, wanted) in [(&found, "front_left", -turn.y), (&first, "front", turn.y)] {
        let mount = &page["mounts"]["cameras"][0];
        if mount["camera"] != json!(camera) || page["mounts"]["cameras"].as_array().map(Vec::len) != Some(1) {
            return Err(format!("expected {camera} alone, found {}", page["mounts"]).into());
        }
        // The axes of the two are turned against each other about y, by which they are told apart best.
        let about_y = mount["turn"][1].as_f64().ok_or("no turn")?;
        close(&format!("{camera} about y"), &[about_y], &[wanted], absolute(0.002))?;
    }
    for camera in ["front", "front_left"] {
        let [was, is] = [psnr(&plain, camera)?, psnr(&found, camera)?];
        if is < was - 0.1 {
            return Err(format!("{camera}: {was:.2} dB, found {is:.2}").into());
        }
    }
    let both = |page: &Value| Ok::<_, Failed>(0.5 * (psnr(page, "front")? + psnr(page, "front_left")?));
    let [was, is, lost] = [both(&plain)?, both(&found)?, both(&stated)?];
    if lost < was.min(is) - 0.1 {
        Ok(())
    } else {
        Err(format!("a turned camera costs nothing: {was:.2} dB, found {is:.2}, as stated {lost:.2}").into())
    }
}

/// The same returns from a sensor whose own axes are turned: upside down, like a camera's, tilted, rolled.
fn mounted_otherwise() -> Outcome {
    let place = tempfile::tempdir()?;
    let upright = street::without_network()?;
    let turns = [
        ("upside_down", DQuat::from_rotation_x(PI)),
        ("as_a_camera", DQuat::from_mat3(&DMat3::from_cols(DVec3::Z, -DVec3::X, -DVec3::Y))),
        ("tilted", DQuat::from_rotation_y(20_f64.to_radians())),
        ("rolled", DQuat::from_rotation_x(10_f64.to_radians())),
    ];
    for (name, sensor_from_lidar) in turns {
        let clip = mounted(place.path(), name, sensor_from_lidar)?;
        let turned = metrics_of(&clip, &[])?;
        for role in ["held_out", "input"] {
            let [want, got] = [upright, &turned].map(|page| number(page, &["mean", role, "psnr"]));
            close(&format!("{name}, {role}"), &[got?], &[want?], absolute(0.05))?;
        }
    }
    Ok(())
}

fn mounted(place: &Path, name: &str, sensor_from_lidar: DQuat) -> Result<PathBuf, Failed> {
    let copy = place.join(name);
    clips::copy(&clips::street(), &copy)?;
    let dir = ClipDir::open(&clips::street())?;
    for frame in &dir.clip().frames {
        let file = copy.join(&frame.lidar.file);
        let mut sweep = read_sweep(&file)?;
        for point in &mut sweep.points {
            *point = (sensor_from_lidar * DVec3::from(point.map(f64::from))).as_vec3().to_array();
        }
        write_sweep(&file, &sweep)?;
    }
    let lidar_from_sensor = Pose::new(DMat3::from_quat(sensor_from_lidar.inverse()), DVec3::ZERO);
    let mut frames = dir.clip().frames.iter();
    clips::edit(&copy, |description| {
        for frame in description["frames"].as_array_mut().into_iter().flatten() {
            let pose = frames.next().map(|frame| frame.lidar.world_from_lidar * lidar_from_sensor);
            frame["lidar"]["world_from_lidar"] = json!(pose.map(|pose| pose.rows()));
        }
    })?;
    Ok(copy)
}

/// The image as the lens would have taken it; black where it sees beyond.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside the image")]
fn distorted(image: &RgbImage, focal: f64) -> RgbImage {
    let (width, height) = (image.width, image.height);
    let mut data = vec![0.0; 3 * width * height];
    for (i, pixel) in data.as_chunks_mut::<3>().0.iter_mut().enumerate() {
        let seen = [(i % width) as f64 + 0.5 - 0.5 * width as f64, (i / width) as f64 + 0.5 - 0.5 * height as f64];
        let seen = seen.map(|at| at / focal);
        let mut place = seen;
        for _ in 0..30 {
            let r2 = place[0] * place[0] + place[1] * place[1];
            place = seen.map(|at| at / (1.0 + r2 * (LENS[0] + r2 * LENS[1])));
        }
        let (x, y) = (place[0] * focal + 0.5 * width as f64 - 0.5, place[1] * focal + 0.5 * height as f64 - 0.5);
        if x >= 0.0 && y >= 0.0 && x < (width - 1) as f64 && y < (height - 1) as f64 {
            let (left, top, fx, fy) = (x as usize, y as usize, x.fract() as f32, y.fract() as f32);
            let at = |c: usize, r: usize, k: usize| image.data[3 * (r * width + c) + k];
            *pixel = std::array::from_fn(|k| {
                let line = |r: usize| at(left, r, k) * (1.0 - fx) + at(left + 1, r, k) * fx;
                line(top) * (1.0 - fy) + line(top + 1) * fy
            });
        }
    }
    RgbImage { width, height, data }
}
