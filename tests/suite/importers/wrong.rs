//! Clips that are plainly wrong in one way each: an inspection says so with the likely cause, exit code 1; right ones are left in peace.

use std::fs;
use std::path::{Path, PathBuf};

use lgs_formats::image::{PixelLabel, write_mask};
use lgs_tests::process::{Finished, binary, run};
use lgs_tests::{Needed, Outcome, case, case_if, clips, places};
use libtest_mimic::Trial;
use serde_json::{Value, json};

/// Cameras of KITTI stand this far apart, metres.
const BASELINE: f64 = 0.53;
/// What is said of a calibration that is not the camera's.
const ELSEWHERE: &str = "a calibration that is not this camera's?";
const MIRRORED: &str = "a left-handed world?";
const REAL: [&str; 7] = [
    "ddad_scene_02",
    "kitti360_suburb",
    "kitti_0018_standing",
    "kitti_0032_fast",
    "kitti_sfnd",
    "pandaset_002",
    "pandaset_front11",
];

type Tried<T> = Result<T, Box<dyn std::error::Error>>;

pub(crate) fn cases() -> Vec<Trial> {
    let name = |what: &str| format!("importers::wrong::{what}");
    let mut cases = vec![
        case(name("numbers_in_other_units"), units),
        case(name("poses_of_one_sensor_stand"), standing),
        case(name("rows_of_other_widths"), widths),
        case(name("masks_that_hide_all_or_hold_truth_values"), masks),
        case(name("a_made_calibration_is_told_either_way"), made_calibration),
        case(name("a_left_handed_world"), left_handed),
    ];
    for clip in REAL {
        let folder = places::shared().join("clips").join(clip);
        let needed = Needed::path(&folder, "the real clips");
        let right = folder.clone();
        cases.push(case_if(&needed, name(&format!("{clip}_is_right")), move || {
            let place = tempfile::tempdir()?;
            silent(&inspect(&right, place.path())?)
        }));
        if clip.starts_with("kitti_") {
            cases.push(case_if(&needed, name(&format!("{clip}_with_the_other_cameras_calibration")), move || {
                told_either_way(&folder)
            }));
        }
    }
    cases
}

fn inspect(clip: &Path, place: &Path) -> Result<Finished, String> {
    run(&binary("lgs-clip")?, &["inspect".as_ref(), clip.as_os_str()], place)
}

fn silent(finished: &Finished) -> Outcome {
    finished.expect_success()?;
    if finished.stdout.contains("look at") { Err(finished.stdout.clone().into()) } else { Ok(()) }
}

/// Fails unless a line says all of `words` and the exit code is 1.
fn told(finished: &Finished, words: &[&str]) -> Outcome {
    let says = |line: &str| line.contains("look at") && words.iter().all(|word| line.contains(word));
    if finished.code == Some(1) && finished.stdout.lines().any(says) {
        return Ok(());
    }
    Err(format!("exit {:?}, want 1 and {words:?}:\n{}{}", finished.code, finished.stdout, finished.stderr).into())
}

/// A copy of the shipped clip with a changed description.
fn changed(place: &Path, change: impl FnOnce(&mut Value)) -> Tried<PathBuf> {
    let clip = place.join("clip");
    clips::copy(&clips::street(), &clip)?;
    clips::edit(&clip, change)?;
    Ok(clip)
}

fn frames(description: &mut Value) -> impl Iterator<Item = &mut Value> {
    description["frames"].as_array_mut().into_iter().flatten()
}

fn cameras(description: &mut Value) -> impl Iterator<Item = &mut Value> {
    frames(description).filter_map(|frame| frame["cameras"].as_array_mut()).flatten()
}

fn scale(number: &mut Value, by: f64) {
    *number = json!(number.as_f64().unwrap_or(0.0) * by);
}

fn units() -> Outcome {
    let times = |factor: f64| {
        move |description: &mut Value| {
            for frame in frames(description) {
                scale(&mut frame["lidar"]["timestamp"], factor);
                for camera in frame["cameras"].as_array_mut().into_iter().flatten() {
                    scale(&mut camera["timestamp"], factor);
                }
            }
        }
    };
    let intrinsics = |by_size: bool| {
        move |description: &mut Value| {
            for camera in cameras(description) {
                let [width, height] = ["width", "height"].map(|key| camera[key].as_f64().unwrap_or(1.0));
                let by = |size: f64| if by_size { 1.0 / size } else { 4.0 };
                for (key, size) in [("fx", width), ("cx", width), ("fy", height), ("cy", height)] {
                    scale(&mut camera["intrinsics"][key], by(size));
                }
            }
        }
    };
    let place = tempfile::tempdir()?;
    let clip = changed(place.path(), times(1e3))?;
    told(&inspect(&clip, place.path())?, &["100 s apart", "milliseconds?"])?;
    fs::remove_dir_all(&clip)?;
    let clip = changed(place.path(), times(1e-3))?;
    told(&inspect(&clip, place.path())?, &["s apart", "divided"])?;
    fs::remove_dir_all(&clip)?;
    let clip = changed(place.path(), intrinsics(true))?;
    told(&inspect(&clip, place.path())?, &["front:", "a view of 179 degrees", "divided by the image's size"])?;
    fs::remove_dir_all(&clip)?;
    let clip = changed(place.path(), intrinsics(false))?;
    told(&inspect(&clip, place.path())?, &["front:", "principal point", "another size"])
}

fn standing() -> Outcome {
    for (moves, words) in
        [("cameras", "the LiDAR stands while front moves"), ("lidar", "front stands while the LiDAR moves")]
    {
        let place = tempfile::tempdir()?;
        let clip = changed(place.path(), |description| {
            let first = description["frames"][0].clone();
            for frame in frames(description) {
                if moves == "cameras" {
                    frame["lidar"]["world_from_lidar"] = first["lidar"]["world_from_lidar"].clone();
                    continue;
                }
                for (camera, of) in frame["cameras"].as_array_mut().into_iter().flatten().zip(0..) {
                    camera["world_from_camera"] = first["cameras"][of]["world_from_camera"].clone();
                }
            }
        })?;
        told(&inspect(&clip, place.path())?, &[words, "two frames?"])?;
    }
    Ok(())
}

/// The sweeps of the shipped clip, written as rows of `width` values.
fn widths() -> Outcome {
    for width in [3, 5, 6] {
        let place = tempfile::tempdir()?;
        let clip = changed(place.path(), |_| ())?;
        for frame in 0..5 {
            let file = clips::named_file(&clip, &format!("/frames/{frame}/lidar/file"))?;
            let bytes = fs::read(&file)?;
            let rows = bytes.as_chunks::<16>().0;
            let rows = &rows[..rows.len() / 4 * 4];
            let more = |ring: usize| [ring as f32, 0.01 * ring as f32].map(f32::to_le_bytes).concat();
            let row = |(k, row): (usize, &[u8; 16])| [row.as_slice(), &more(k % 64)].concat()[..4 * width].to_vec();
            fs::write(&file, rows.iter().enumerate().flat_map(row).collect::<Vec<u8>>())?;
        }
        told(&inspect(&clip, place.path())?, &["5 of 5 sweeps", &format!("rows of {width} values read as 4")])?;
    }
    Ok(())
}

fn masks() -> Outcome {
    let place = tempfile::tempdir()?;
    let clip = changed(place.path(), |description| {
        cameras(description).for_each(|camera| camera["mask"] = json!("mask.png"))
    })?;
    let description = clips::description(&clip)?;
    let side = |key: &str| description["frames"][0]["cameras"][0][key].as_u64().and_then(|v| u32::try_from(v).ok());
    let (width, height) = (side("width").ok_or("no width")?, side("height").ok_or("no height")?);
    let pixels = (width * height) as usize;
    let write = |grey: &dyn Fn(u32) -> u8| {
        let mask = image::GrayImage::from_fn(width, height, |_, y| image::Luma([grey(y)]));
        mask.save(clip.join("mask.png"))
    };
    write(&|_| 0)?;
    told(&inspect(&clip, place.path())?, &["front: mask `mask.png` hides 100 %", "the wrong way round?"])?;
    write(&|y| u8::from(y < height / 2))?;
    told(&inspect(&clip, place.path())?, &["front_left: mask `mask.png` holds 0 and 1", "truth values?"])?;
    let labels: Vec<PixelLabel> =
        (0..pixels).map(|pixel| if pixel >= pixels / 2 { PixelLabel::Ignored } else { PixelLabel::Static }).collect();
    write_mask(&clip.join("mask.png"), width as usize, height as usize, &labels)?;
    silent(&inspect(&clip, place.path())?)?;
    let arguments = ["inspect", "clip", "--contact-sheet", "sheet.png"];
    run(&binary("lgs-clip")?, &arguments, place.path())?.expect_success()?;
    let sheet = image::open(place.path().join("sheet.png"))?.into_rgb8();
    let is_striped = |y: u32| (0..640).filter(|&x| sheet.get_pixel(x, y).0 == [255, 0, 255]).count();
    let tile = 640 * height / width;
    if is_striped(tile / 4) == 0 && is_striped(tile - 4) > 200 {
        return Ok(());
    }
    Err(format!("{} and {} pixels of stripes", is_striped(tile / 4), is_striped(tile - 4)).into())
}

/// A made clip whose LiDAR sees as finely as a real one.
fn made(place: &Path) -> Tried<PathBuf> {
    let fixed = ["scenes", "--out", "made", "--name", "clip", "--preset", "street", "--frames", "3"];
    let sizes = ["--image-size", "128x256", "--beams", "64", "--azimuths", "1024"];
    run(&binary("lgs-train")?, &[fixed.as_slice(), &sizes].concat(), place)?
        .expect_success()
        .map_err(|e| format!("{:?}", e.message()))?;
    Ok(place.join("made/clip"))
}

/// Moves every camera to its right, metres.
fn shift(clip: &Path, metres: f64) -> Result<(), String> {
    clips::edit(clip, |description| {
        for camera in cameras(description) {
            for row in 0..3 {
                let pose = &mut camera["world_from_camera"][row];
                let [axis, place] = [0, 3].map(|column| pose[column].as_f64().unwrap_or(0.0));
                pose[3] = json!(place + metres * axis);
            }
        }
    })
}

fn told_either_way(right: &Path) -> Outcome {
    for (metres, side) in [(BASELINE, "left"), (-BASELINE, "right")] {
        let place = tempfile::tempdir()?;
        let clip = place.path().join("clip");
        clips::copy(right, &clip)?;
        shift(&clip, metres)?;
        let finished = inspect(&clip, place.path())?;
        told(&finished, &[ELSEWHERE, &format!("m farther {side}")])?;
        let found = finished
            .stdout
            .split("with the camera ")
            .nth(1)
            .and_then(|rest| rest.split(' ').next()?.parse::<f64>().ok());
        if !found.is_some_and(|found| (found - BASELINE).abs() < 0.15) {
            return Err(format!("found {found:?} m, want about {BASELINE}").into());
        }
    }
    Ok(())
}

fn made_calibration() -> Outcome {
    let place = tempfile::tempdir()?;
    let clip = made(place.path())?;
    silent(&inspect(&clip, place.path())?)?;
    told_either_way(&clip)
}

/// The clip in a world whose y axis points the other way, as engines of games have it: its images are what they were.
fn left_handed() -> Outcome {
    let place = tempfile::tempdir()?;
    let clip = made(place.path())?;
    clips::edit(&clip, |description| {
        let mirror = |pose: &mut Value, column: usize| {
            for row in 0..4 {
                for k in 0..4 {
                    if (row == 1) != (k == column) {
                        scale(&mut pose[row][k], -1.0);
                    }
                }
            }
        };
        for frame in frames(description) {
            mirror(&mut frame["lidar"]["world_from_lidar"], 1);
            frame["cameras"].as_array_mut().into_iter().flatten().for_each(|c| mirror(&mut c["world_from_camera"], 0));
            frame.as_object_mut().map(|frame| frame.remove("boxes"));
        }
    })?;
    for frame in 0..3 {
        let file = clips::named_file(&clip, &format!("/frames/{frame}/lidar/file"))?;
        let mut bytes = fs::read(&file)?;
        // The sign of y.
        bytes.as_chunks_mut::<16>().0.iter_mut().for_each(|row| row[7] ^= 0x80);
        fs::write(&file, bytes)?;
    }
    told(&inspect(&clip, place.path())?, &["front:", MIRRORED])
}
