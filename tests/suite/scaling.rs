//! `lgs-sweep --scaling` as a process, on the smallest clips that tell anything.

use std::fs;
use std::path::Path;
use std::time::SystemTime;

use lgs_tests::process::{Finished, binary, run};
use lgs_tests::weights::{Heads, SMALL, Weights};
use lgs_tests::{Outcome, case, metrics};
use libtest_mimic::{Failed, Trial};
use serde_json::Value;

const FLAGS: &str = "--scaling --out out --weights w.safetensors --points 2000,8000,24000 --fixed-points 2000 --fixed-image-size 32x64 \
                     --image-sizes 32x64,64x128,128x256 --repeats 2";
const SIZES: usize = 5;

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("scaling::sizes_are_measured_once_and_laws_are_finite", sizes_are_measured_once_and_laws_are_finite),
        case("scaling::a_size_that_fails_is_listed", a_size_that_fails_is_listed),
    ]
}

fn scaling(place: &Path, more: &[&str]) -> Result<Finished, String> {
    run(&binary("lgs-sweep")?, &FLAGS.split_whitespace().chain(more.iter().copied()).collect::<Vec<_>>(), place)
}

fn place() -> Result<tempfile::TempDir, Failed> {
    let place = tempfile::tempdir()?;
    Weights::seeded(SMALL, 2, Heads { residuals: 1e-4, scores: 2.0 })?.write(&place.path().join("w.safetensors"))?;
    Ok(place)
}

fn page(place: &Path) -> Result<Value, Failed> {
    Ok(serde_json::from_str(&fs::read_to_string(place.join("out/scaling.json"))?)?)
}

fn list<'a>(value: &'a Value, key: &str) -> Result<&'a Vec<Value>, String> {
    value[key].as_array().ok_or_else(|| format!("{key} is no list"))
}

/// When each record was written.
fn written(place: &Path) -> Result<Vec<(String, SystemTime)>, Failed> {
    let mut all = Vec::new();
    for entry in fs::read_dir(place.join("out/sizes"))? {
        let entry = entry?;
        all.push((entry.file_name().to_string_lossy().into_owned(), entry.metadata()?.modified()?));
    }
    all.sort();
    Ok(all)
}

fn sizes_are_measured_once_and_laws_are_finite() -> Outcome {
    let place = place()?;
    scaling(place.path(), &[])?.expect_success()?;
    let out = place.path().join("out");
    if out.join("clip-of-a-size").exists() {
        return Err("the last clip was left behind".into());
    }
    let page_text = fs::read_to_string(out.join("scaling.html"))?;
    for wrong in ["NaN", "inf<", "http:", "https:"] {
        if page_text.contains(wrong) {
            return Err(format!("scaling.html says {wrong}").into());
        }
    }
    let lines = |name: &str| -> Result<usize, Failed> { Ok(fs::read_to_string(out.join(name))?.lines().count()) };
    let found = page(place.path())?;
    let (rows, sizes) = (list(&found, "rows")?, list(&found, "sizes")?);
    if (sizes.len(), lines("sizes.csv")?, lines("exponents.csv")?) != (SIZES, SIZES + 1, rows.len() + 1) {
        return Err(format!("{} sizes, {} rows", sizes.len(), rows.len()).into());
    }
    for size in sizes {
        let asked = metrics::number(size, &["size", "points"])?;
        let returns = metrics::number(&size["space"], &["work", "returns"])?;
        if !(0.8..1.2).contains(&(returns / asked)) {
            return Err(format!("{returns} returns for {asked}").into());
        }
        for part in ["cloud", "motion", "paint", "spacing", "merge"] {
            metrics::number(size, &["times", "first", part])?;
        }
        if list(&size["times"], "passes")?.len() != 2 || metrics::number(&size["space"], &["work", "sites"])? < 1.0 {
            return Err(format!("a size: {size}").into());
        }
    }
    let laws: Vec<&Value> =
        rows.iter().flat_map(|row| [&row["time"]["law"], &row["memory"]["law"]]).filter(|law| !law.is_null()).collect();
    for law in &laws {
        let (exponent, error) = (metrics::number(law, &["exponent"])?, metrics::number(law, &["standard_error"])?);
        if !(-1.0..3.0).contains(&exponent) || !(0.0..3.0).contains(&error) {
            return Err(format!("a law: {law}").into());
        }
    }
    let of_total = rows.iter().filter(|row| row["part"] == "total" && !row["time"]["law"].is_null()).count();
    if of_total != 2 {
        return Err(format!("{of_total} laws of the whole time").into());
    }
    let before = written(place.path())?;
    scaling(place.path(), &[])?.expect_success()?;
    if (written(place.path())?, page(place.path())?) != (before, found) {
        return Err("what was measured already was measured again".into());
    }
    Ok(())
}

fn a_size_that_fails_is_listed() -> Outcome {
    let place = place()?;
    let small = ["--scaling", "--out", "out", "--weights", "none", "--repeats", "1", "--fixed-points", "300"];
    let sizes = ["--points", "300", "--image-sizes", "4x4", "--fixed-image-size", "16x32"];
    let finished = run(&binary("lgs-sweep")?, &[small.as_slice(), &sizes].concat(), place.path())?;
    let found = page(place.path())?;
    let failed = list(&found, "failed")?;
    let reason = failed.first().map_or("", |failed| failed["reason"].as_str().unwrap_or_default());
    if finished.code != Some(1) || failed.len() != 1 || !reason.contains("rig.cameras[0]") {
        return Err(format!("{:?}, failed: {failed:?}", finished.code).into());
    }
    let two = ["--scaling", "--out", "other", "--weights", "w.safetensors,tiny"];
    run(&binary("lgs-sweep")?, &two, place.path())?.expect_refusal(&["--weights"])?;
    if place.path().join("other").exists() { Err("the output was begun".into()) } else { Ok(()) }
}
