//! Sweeps whose timestamps are those of their ends or beginnings, and that say nothing of it: a made drive whose stamps are moved.

use std::ffi::OsStr;
use std::path::Path;

use lgs_tests::compare::{absolute, close};
use lgs_tests::process::{binary, run};
use lgs_tests::{Outcome, case, clips, metrics, places};
use libtest_mimic::{Failed, Trial};
use serde_json::{Value, json};

use crate::street::found_of;

pub(crate) fn cases() -> Vec<Trial> {
    vec![case("returns::stamps::of_ends_and_beginnings_are_told_and_others_stay", told)]
}

/// Half a sweep of the made drives, seconds.
const HALF: f64 = 0.05;

/// A drive through traffic.
fn drive(place: &Path) -> Outcome {
    let flags = ["scenes", "--split", "traffic-test", "--seed", "4", "--count", "1", "--cameras", "1"];
    let mut arguments: Vec<&OsStr> = flags.iter().map(OsStr::new).collect();
    arguments.extend(["--image-size", "128x256", "--out"].map(OsStr::new));
    arguments.push(place.as_os_str());
    run(&binary("lgs-train")?, &arguments, places::repository())?.expect_success()
}

fn told() -> Outcome {
    let made = tempfile::tempdir()?;
    drive(made.path())?;
    // Of the drive whose sweeps are stamped so many seconds later than they were measured.
    let found = |later: f64| -> Result<Value, Failed> {
        let place = tempfile::tempdir()?;
        let copy = place.path().join("copy");
        clips::copy(&made.path().join("traffic-test-000004"), &copy)?;
        clips::edit(&copy, |description| {
            for frame in description["frames"].as_array_mut().into_iter().flatten() {
                let stamp = frame["lidar"]["timestamp"].as_f64().unwrap_or_default();
                frame["lidar"]["timestamp"] = json!(stamp + later);
            }
        })?;
        Ok(found_of(&copy, &["--weights", "none", "--views", "held-out"])?)
    };
    let as_measured = found(0.0)?;
    let psnr = |page: &Value| metrics::number(page, &["mean", "held_out", "psnr"]);
    for (page, stamp) in
        [(&as_measured, Value::Null), (&found(HALF)?, json!("end")), (&found(-HALF)?, json!("beginning"))]
    {
        if page["lidar_stamp"] != stamp {
            return Err(format!("expected {stamp}, told is {}", page["lidar_stamp"]).into());
        }
        // Once it is told, the drive is that of sweeps which are stamped when they were measured.
        close(&format!("PSNR, {stamp}"), &[psnr(page)?], &[psnr(&as_measured)?], absolute(0.02))?;
    }
    Ok(())
}
