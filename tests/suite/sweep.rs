//! The sweep on a small clip and a small model: what `lgs-infer` finds, once, whatever interrupts it.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use lgs_tests::browser::{self, Page};
use lgs_tests::process::{Finished, binary, run};
use lgs_tests::weights::{Heads, SMALL, Weights};
use lgs_tests::{Outcome, case, case_if, clips, metrics};
use libtest_mimic::{Failed, Trial};
use serde_json::Value;

const GRID: [&str; 12] = [
    "--out",
    "out",
    "--image-size",
    "48x80",
    "--refine-steps",
    "0,2",
    "--adam",
    "0,1,3",
    "--repeats",
    "2",
    "--frames",
    "3",
];
const HEADS: Heads = Heads { residuals: 1e-4, scores: 2.0 };

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("sweep::figures_are_those_of_inference", figures_are_those_of_inference),
        case("sweep::goes_on_where_it_was_killed", goes_on_where_it_was_killed),
        case("sweep::what_makes_no_sense_is_refused", refusals),
        case("sweep::what_fails_is_listed_and_the_rest_is_measured", failures),
        case("sweep::budgets_stand_beside_what_would_have_fitted", budgets),
        case_if(&browser::needed(), "sweep::report_in_a_browser", report_in_a_browser),
    ]
}

/// A folder with weights whose heads are not zero.
fn place() -> Result<tempfile::TempDir, Failed> {
    let place = tempfile::tempdir()?;
    Weights::seeded(SMALL, 2, HEADS)?.write(&place.path().join("w.safetensors"))?;
    Ok(place)
}

fn arguments<'a>(clip: &'a Path, more: &[&'a str]) -> Vec<&'a OsStr> {
    let fixed = ["--weights", "w.safetensors", "--query", "on", "--background", "auto"];
    let refined = ["--then-adam", "0,1", "--pixel-stride", "2"];
    let words = GRID.iter().chain(&fixed).chain(&refined).chain(more).map(|word| OsStr::new(*word));
    [clip.as_os_str()].into_iter().chain(words).collect()
}

fn sweep(place: &Path, more: &[&str]) -> Result<Finished, String> {
    run(&binary("lgs-sweep")?, &arguments(&clips::street(), more), place)
}

fn page(place: &Path) -> Result<Value, Failed> {
    Ok(serde_json::from_str(&fs::read_to_string(place.join("out/sweep.json"))?)?)
}

fn list<'a>(value: &'a Value, key: &str) -> Result<&'a Vec<Value>, String> {
    value[key].as_array().ok_or_else(|| format!("{key} is no list"))
}

fn figures_are_those_of_inference() -> Outcome {
    let place = place()?;
    sweep(place.path(), &[])?.expect_success()?;
    let (page, csv) = (page(place.path())?, fs::read_to_string(place.path().join("out/points.csv"))?);
    let clip = &list(&page, "clips")?[0];
    let (rows, points) = (list(clip, "rows")?, list(clip, "points")?);
    // With exact pruning and without, two by two numbers of steps each; three marks of the reference.
    if (rows.len(), points.len(), csv.lines().count()) != (11, 11, 12) {
        return Err(format!("{} rows, {} points, {} lines", rows.len(), points.len(), csv.lines().count()).into());
    }
    for (line, row) in csv.lines().skip(1).zip(rows) {
        let words: Vec<&str> = line.split("lgs-infer ").last().unwrap_or_default().split_whitespace().collect();
        let out = ["--out", "inferred", "--views", "held-out"];
        run(&binary("lgs-infer")?, &[words.as_slice(), &out].concat(), place.path())?.expect_success()?;
        let inferred = metrics::read(&place.path().join("inferred"))?;
        for (got, want) in [
            (metrics::number(row, &["figures", "psnr"])?, metrics::number(&inferred, &["mean", "held_out", "psnr"])?),
            (
                metrics::number(row, &["gaussians"])?,
                metrics::number(&inferred, &["gaussians", "final"])?
                    + metrics::number(&inferred, &["gaussians", "background"])?,
            ),
        ] {
            if got.to_bits() != want.to_bits() {
                return Err(format!("{}: got {got}, lgs-infer says {want}", row["name"]).into());
            }
        }
    }
    for point in points {
        let repeats = list(point, "repeats")?;
        let stages = |repeat: &Value| metrics::number(&repeat["cost"], &["stages", "points"]).is_ok_and(|s| s > 0.0);
        if repeats.len() != 2 || !repeats.iter().all(stages) {
            return Err(format!("timed runs: {repeats:?}").into());
        }
    }
    Ok(())
}

/// What must not depend on times: every figure of every point.
fn without_times(page: &Value) -> Result<Vec<[Value; 3]>, Failed> {
    let points = list(&list(page, "clips")?[0], "points")?;
    Ok(points.iter().map(|point| [&point["setting"], &point["accuracy"], &point["crop"]].map(Value::clone)).collect())
}

fn record(place: &Path) -> Result<Vec<u8>, Failed> {
    Ok(fs::read(place.join("out/clips/000_street.json"))?)
}

fn goes_on_where_it_was_killed() -> Outcome {
    let (undisturbed, place) = (place()?, place()?);
    let start = Instant::now();
    sweep(undisturbed.path(), &[])?.expect_success()?;
    let took = start.elapsed();
    for share in [0.3, 0.5, 0.4] {
        let mut job = Command::new(binary("lgs-sweep")?)
            .args(arguments(&clips::street(), &["--threads", "1"]))
            .current_dir(place.path())
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()?;
        std::thread::sleep(took.mul_f64(share));
        job.kill()?;
        job.wait()?;
    }
    // The number of threads is a cause of times: what one thread took is no time of two.
    sweep(place.path(), &["--threads", "1"])?.expect_success()?;
    let (got, want) = (page(place.path())?, page(undisturbed.path())?);
    if without_times(&got)? != without_times(&want)? {
        return Err("figures differ from those of an undisturbed sweep on another number of threads".into());
    }
    for point in list(&list(&got, "clips")?[0], "points")? {
        if list(point, "repeats")?.len() != 2 {
            return Err(format!("{} timed runs of {}", list(point, "repeats")?.len(), point["setting"]).into());
        }
    }
    let before = record(place.path())?;
    sweep(place.path(), &["--threads", "1"])?.expect_success()?;
    if record(place.path())? == before { Ok(()) } else { Err("what was measured already was measured again".into()) }
}

fn refusals() -> Outcome {
    let place = place()?;
    let (out, street) = (place.path().join("out"), clips::street());
    let refused = |clip: &Path, flags: &[&str], names: &[&str]| -> Outcome {
        run(&binary("lgs-sweep")?, &arguments(clip, flags), place.path())?.expect_refusal(names)?;
        if out.exists() { Err(format!("{flags:?}: the output was begun").into()) } else { Ok(()) }
    };
    refused(Path::new("nowhere"), &[], &["nowhere"])?;
    refused(&PathBuf::from(format!("{};cameras=no_such", street.display())), &[], &["no_such"])?;
    refused(&street, &["--lpips-weights", "w.safetensors"], &["w.safetensors"])?;
    refused(&street, &["--threads", "0"], &["--threads"])?;
    let nothing = ["--out", "out", "--weights", "none", "--no-adam"].map(OsStr::new);
    let finished = run(&binary("lgs-sweep")?, &[&[street.as_os_str()], nothing.as_slice()].concat(), place.path())?;
    finished.expect_refusal(&["--weights", "--adam"])?;
    fs::write(&out, "a file")?;
    sweep(place.path(), &[])?.expect_refusal(&["--out"])
}

/// A sweep of a few points without a network, and of what `more` asks for.
fn few(place: &Path, more: &[&str]) -> Result<Finished, String> {
    let street = clips::street();
    let fixed = ["--out", "out", "--image-size", "48x80", "--frames", "3", "--repeats", "2", "--warm-up", "0"];
    let words: Vec<&OsStr> = fixed.iter().chain(more).map(|word| OsStr::new(*word)).collect();
    run(&binary("lgs-sweep")?, &[&[street.as_os_str()], words.as_slice()].concat(), place)
}

fn failures() -> Outcome {
    let place = tempfile::tempdir()?;
    // The clip has no depth maps.
    let finished = few(place.path(), &["--weights", "none", "--adam", "0,1", "--background", "gaps,maps"])?;
    if finished.code != Some(1) {
        return Err(format!("exit code {:?}: {}", finished.code, finished.stderr).into());
    }
    let page = page(place.path())?;
    let (failed, rows) = (list(&page, "failed")?, list(&list(&page, "clips")?[0], "rows")?);
    let said = |row: &Value| {
        let text = |key: &str| row[key].as_str().unwrap_or_default();
        text("clip") == "street" && text("name").contains("maps") && text("reason").starts_with("--background")
    };
    if failed.is_empty() || !failed.iter().all(said) || rows.len() != 2 {
        return Err(format!("failed: {failed:?}; rows: {rows:?}").into());
    }
    let reason = failed[0]["reason"].as_str().unwrap_or_default();
    let report = fs::read_to_string(place.path().join("out/report.html"))?;
    if !report.contains("Could not be measured") || !finished.stderr.contains(reason) {
        return Err(format!("nothing said of {reason}: {}", finished.stderr).into());
    }
    Ok(())
}

fn budgets() -> Outcome {
    let place = tempfile::tempdir()?;
    let flags = ["--weights", "none", "--adam", "0,1", "--background", "gaps,auto", "--budgets", "0.000001,100000"];
    few(place.path(), &flags)?.expect_success()?;
    let found = page(place.path())?;
    let clip = &list(&found, "clips")?[0];
    let [short, long] = list(clip, "budgets")?.as_slice() else {
        return Err(format!("budgets: {}", clip["budgets"]).into());
    };
    let all = list(clip, "rows")?.iter().filter_map(|row| row["figures"]["psnr"].as_f64());
    let best = all.fold(f64::NEG_INFINITY, f64::max);
    let right = short["fits"] == false && short["kept"] == false && short["best"].is_null();
    let right = right && long["fits"] == true && long["kept"] == true && long["runs"] == 2;
    if !right || long["best"]["psnr"].as_f64() != Some(best) || long["psnr"].as_f64().is_none() {
        return Err(format!("{short}\n{long}\n{best}").into());
    }
    let before = record(place.path())?;
    let finished = few(place.path(), &flags)?;
    if record(place.path())? != before || !finished.stdout.contains("budget 100000 s: finished after") {
        return Err(format!("run again, or not told: {}", finished.stdout).into());
    }
    Ok(())
}

fn report_in_a_browser() -> Outcome {
    let place = place()?;
    sweep(place.path(), &["--warm-up", "0"])?.expect_success()?;
    let file = place.path().join("out/report.html");
    let mut shown = Page::open(&file, "")?;
    let counts = "[document.querySelectorAll('circle').length, document.querySelectorAll('tbody tr').length, \
                  [...document.images].filter(i => i.naturalWidth > 0).length, document.images.length, \
                  document.querySelectorAll('[src^=http], link').length]";
    let found = shown.value(counts)?;
    let numbers: Vec<u64> = found.as_array().into_iter().flatten().filter_map(Value::as_u64).collect();
    // Time against PSNR and SSIM, memory and Gaussians against PSNR.
    match numbers.as_slice() {
        [44, 11, drawn, all, 0] if drawn == all && *all >= 3 => Ok(()),
        _ => Err(format!("circles, rows, pictures that are drawn, all, things from elsewhere: {found}").into()),
    }
}
