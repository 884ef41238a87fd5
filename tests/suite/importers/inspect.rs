//! `lgs-clip inspect`.

use std::ffi::OsStr;
use std::path::Path;

use lgs_formats::clip_dir::ClipDir;
use lgs_tests::process::{Finished, binary, run};
use lgs_tests::{Outcome, case, clips};
use libtest_mimic::Trial;
use serde_json::{Value, json};

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("importers::inspect::says_what_is_in_a_clip", says_what_is_in_a_clip),
        case("importers::inspect::warns_of_what_is_wrong", warns_of_what_is_wrong),
        case("importers::inspect::draws_returns_where_they_belong", draws_returns_where_they_belong),
    ]
}

fn inspect(clip: &Path, flags: &[&OsStr]) -> Result<Finished, String> {
    let mut arguments: Vec<&OsStr> = vec!["inspect".as_ref(), clip.as_os_str()];
    arguments.extend(flags);
    run(&binary("lgs-clip")?, &arguments, clip)
}

fn report(finished: &Finished) -> Result<Value, String> {
    serde_json::from_str(&finished.stdout).map_err(|e| format!("{e}: {}{}", finished.stdout, finished.stderr))
}

fn says_what_is_in_a_clip() -> Outcome {
    let finished = inspect(&clips::street(), &["--json".as_ref()])?;
    finished.expect_success()?;
    let page = report(&finished)?;
    let want = [
        ("/format", json!("lgs-inspect/1")),
        ("/clip", json!("street")),
        ("/num_frames", json!(5)),
        ("/cameras/0/name", json!("front")),
        ("/cameras/1/num_images", json!(5)),
        ("/cameras/1/masked", json!(false)),
        ("/boxes/num_tracks", json!(13)),
        ("/warnings", json!([])),
    ];
    for (place, value) in want {
        if page.pointer(place) != Some(&value) {
            return Err(format!("{place}: {:?}, want {value}", page.pointer(place)).into());
        }
    }
    let number = |place: &str| page.pointer(place).and_then(Value::as_f64).unwrap_or(f64::NAN);
    let share = number("/cameras/0/visible_share/mean");
    if (number("/lidar/rate_hz") - 10.0).abs() > 0.1 || !(0.3..0.7).contains(&share) || number("/unseen_share") > 0.3 {
        return Err(format!("rate, share or unseen share of {page:#}").into());
    }
    let text = inspect(&clips::street(), &[])?;
    text.expect_success()?;
    let missing: Vec<_> =
        ["street", "front_left", "10.0 Hz", "13 ("].into_iter().filter(|word| !text.stdout.contains(word)).collect();
    if missing.is_empty() { Ok(()) } else { Err(format!("no {missing:?} in {}", text.stdout).into()) }
}

/// A camera that looks back, one with another clock, a pose that jumps: exit code 1 and a line for each.
fn warns_of_what_is_wrong() -> Outcome {
    let place = tempfile::tempdir()?;
    let clip = place.path().join("clip");
    clips::copy(&clips::street(), &clip)?;
    clips::edit(&clip, |v| {
        for frame in v["frames"].as_array_mut().into_iter().flatten() {
            for row in 0..3 {
                for column in [0, 2] {
                    let entry = &mut frame["cameras"][0]["world_from_camera"][row][column];
                    *entry = json!(-entry.as_f64().unwrap_or(0.0));
                }
            }
            let time = &mut frame["cameras"][1]["timestamp"];
            *time = json!(time.as_f64().unwrap_or(0.0) + 0.4);
        }
        let x = &mut v["frames"][3]["lidar"]["world_from_lidar"][0][3];
        *x = json!(x.as_f64().unwrap_or(0.0) + 50.0);
    })?;
    let finished = inspect(&clip, &["--json".as_ref()])?;
    if finished.code != Some(1) {
        return Err(format!("exit {:?}, want 1", finished.code).into());
    }
    let warnings = report(&finished)?["warnings"].to_string();
    let wanted = ["front: sees 0.00 %", "front_left: images 395 to 395 ms", "frames 2 and 3: the pose jumps"];
    let missing: Vec<_> = wanted.into_iter().filter(|word| !warnings.contains(word)).collect();
    if missing.is_empty() { Ok(()) } else { Err(format!("no {missing:?} in {warnings}").into()) }
}

/// On white images the coloured pixels of the sheet are the returns of the first sweep: each is there, and nothing else.
fn draws_returns_where_they_belong() -> Outcome {
    let place = tempfile::tempdir()?;
    let (clip, sheet) = (place.path().join("clip"), place.path().join("sheet.png"));
    clips::copy(&clips::street(), &clip)?;
    let dir = ClipDir::open(&clip)?;
    for record in dir.clip().frames.iter().flat_map(|frame| &frame.cameras) {
        let white = image::RgbImage::from_pixel(record.camera.width, record.camera.height, image::Rgb([255; 3]));
        white.save(clip.join(&record.file))?;
    }
    inspect(&clip, &["--contact-sheet".as_ref(), sheet.as_os_str()])?.expect_success()?;
    let picture = image::open(&sheet)?.into_rgb8();
    if picture.dimensions() != (640 * 2 + 4, 384 * 4 + 4 * 3) {
        return Err(format!("a sheet of {:?}", picture.dimensions()).into());
    }
    let is_drawn = |x: u32, y: u32| picture.get_pixel(x, y).0 != [255; 3];
    let frame = &dir.clip().frames[0];
    let camera = &frame.cameras[0].camera;
    let camera_from_lidar = camera.world_from_camera.inverse() * frame.lidar.world_from_lidar;
    let mut num_points = 0;
    for point in dir.load_sweep(0)?.points {
        let p = camera_from_lidar.transform_point(point.map(f64::from).into());
        let k = camera.intrinsics;
        // The tile is twice as large as the image.
        let (u, v) = (2.0 * (k.fx * p.x / p.z + k.cx), 2.0 * (k.fy * p.y / p.z + k.cy));
        if p.z > 0.1 && (0.0..640.0).contains(&u) && (0.0..384.0).contains(&v) {
            num_points += 1;
            if !is_drawn(pixel(u), pixel(v)) {
                return Err(format!("the return at {u}, {v} is not drawn").into());
            }
        }
    }
    let drawn = (0..384).flat_map(|y| (0..640).map(move |x| (x, y))).filter(|&(x, y)| is_drawn(x, y)).count();
    // Two by two pixels each.
    if num_points > 500 && drawn <= 4 * num_points {
        Ok(())
    } else {
        Err(format!("{drawn} pixels, {num_points} returns").into())
    }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the tile")]
fn pixel(place: f64) -> u32 {
    place as u32
}
