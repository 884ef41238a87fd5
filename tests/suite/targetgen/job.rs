//! `lgs-targetgen` as a process: parts, threads, failures, other targets, spoilt shards.

use std::fs;
use std::path::{Path, PathBuf};

use lgs_formats::targets::{MANIFEST_FILE, Manifest, Shard, ZScore};
use lgs_targetgen::target::targets;
use lgs_tests::process::{Finished, binary, run};
use lgs_tests::{Outcome, case, clips};
use libtest_mimic::Trial;

/// Small enough that a clip takes part of a second.
pub(crate) const SMALL: [&str; 6] = ["--image-size", "24x40", "--shard-mb", "1", "--rounds", "1"];

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("targetgen::job::parts_threads_and_whole_are_the_same_bytes", parts_and_whole),
        case("targetgen::job::merge_goes_on_from_where_it_ended", merge_again),
        case("targetgen::job::failed_clips_are_listed", failed_clips),
        case("targetgen::job::retarget", retarget),
        case("targetgen::job::flipped_byte", flipped_byte),
        case("targetgen::job::features", features),
        case("targetgen::job::refusals", refusals),
        case("targetgen::job::fidelity", fidelity),
    ]
}

/// Runs `lgs-targetgen` in a folder.
pub(crate) fn targetgen(folder: &Path, arguments: &[&str]) -> Result<Finished, String> {
    run(&binary("lgs-targetgen")?, arguments, folder)
}

/// A list of the shipped clip, `count` times, in a folder.
pub(crate) fn list(folder: &Path, count: usize) -> std::io::Result<()> {
    let line = format!("{}\n", clips::street().display());
    fs::write(folder.join("list"), line.repeat(count))
}

/// The shards and the manifest of a folder, by name.
pub(crate) fn product(folder: &Path) -> Result<Vec<(PathBuf, Vec<u8>)>, String> {
    let entries = fs::read_dir(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    files.sort();
    let is_product = |path: &PathBuf| path.extension().is_some_and(|e| e == "safetensors" || e == "json");
    files.retain(is_product);
    let read = |path: PathBuf| {
        let bytes = fs::read(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        Ok((path.file_name().map(PathBuf::from).unwrap_or_default(), bytes))
    };
    files.into_iter().map(read).collect()
}

/// Fails unless both folders hold the same shards and manifest, and nothing that is not finished.
pub(crate) fn same_product(got: &Path, want: &Path) -> Outcome {
    let (files, wanted) = (product(got)?, product(want)?);
    let names = |files: &[(PathBuf, Vec<u8>)]| files.iter().map(|(name, _)| name.clone()).collect::<Vec<_>>();
    if names(&files) != names(&wanted) {
        return Err(format!("files {:?}, want {:?}", names(&files), names(&wanted)).into());
    }
    match files.iter().zip(&wanted).find(|(got, want)| got.1 != want.1) {
        None => Ok(()),
        Some(((name, _), _)) => Err(format!("{}: other bytes", name.display()).into()),
    }
}

fn parts_and_whole() -> Outcome {
    let place = tempfile::tempdir()?;
    list(place.path(), 5)?;
    let go = |more: &[&str]| -> Outcome {
        targetgen(place.path(), &[&["list"], SMALL.as_slice(), more].concat())?.expect_success()
    };
    go(&["--out", "whole", "--threads", "1"])?;
    for part in ["1/4", "4/4", "2/4", "3/4"] {
        go(&["--out", "parts", "--part", part, "--threads", "2"])?;
    }
    let missing = targetgen(place.path(), &["merge", "whole", "--out", "nothing"])?;
    missing.expect_refusal(&["part-I-of-N.json", "whole"])?;
    targetgen(place.path(), &["merge", "parts", "--shard-mb", "1"])?.expect_success()?;
    same_product(&place.path().join("parts"), &place.path().join("whole"))?;
    // Another cap repacks, and back gives the bytes of before.
    let large = ["list", "--out", "parts", "--resume", "--image-size", "24x40", "--rounds", "1", "--shard-mb", "50"];
    targetgen(place.path(), &large)?.expect_success()?;
    if product(&place.path().join("parts"))?.len() != 2 {
        return Err("five small clips need one shard of 50 MB".into());
    }
    go(&["--out", "parts", "--resume"])?;
    same_product(&place.path().join("parts"), &place.path().join("whole"))
}

/// More parts than clips, of which some have nothing to do; a merge that ended between the manifest and the last of its clearing up.
fn merge_again() -> Outcome {
    let place = tempfile::tempdir()?;
    clips::short(&place.path().join("tiny"), 1)?;
    fs::write(place.path().join("list"), "tiny\ntiny\n")?;
    let go = |more: &[&str]| -> Outcome {
        targetgen(place.path(), &[&["list"], SMALL.as_slice(), more].concat())?.expect_success()
    };
    go(&["--out", "whole"])?;
    for part in ["1/3", "2/3", "3/3"] {
        go(&["--out", "parts", "--part", part])?;
    }
    let (whole, parts) = (place.path().join("whole"), place.path().join("parts"));
    let left = fs::read(parts.join("part-2-of-3.json"))?;
    let merge = || targetgen(place.path(), &["merge", "parts", "--shard-mb", "1"]);
    merge()?.expect_success()?;
    same_product(&parts, &whole)?;
    fs::write(parts.join("part-2-of-3.json"), &left)?;
    merge()?.expect_success()?;
    same_product(&parts, &whole)?;
    merge()?.expect_success()?;
    same_product(&parts, &whole)?;
    // A share of another job is no leftover of this one.
    let other = String::from_utf8_lossy(&left).replace("\"seed\": 0", "\"seed\": 5");
    fs::write(parts.join("part-2-of-3.json"), other)?;
    merge()?.expect_refusal(&["part-1-of-3.json"])
}

fn failed_clips() -> Outcome {
    let place = tempfile::tempdir()?;
    let spoilt = place.path().join("spoilt");
    clips::copy(&clips::street(), &spoilt)?;
    fs::remove_file(clips::named_file(&spoilt, "/frames/1/lidar/file")?)?;
    fs::write(place.path().join("list"), format!("spoilt\n{}\n", clips::street().display()))?;
    let first = targetgen(place.path(), &[&["list", "--out", "o"], SMALL.as_slice()].concat())?;
    if first.code != Some(1) || !first.stderr.contains("lgs-targetgen: spoilt: ") {
        return Err(format!("exit {:?}: {}", first.code, first.stderr).into());
    }
    let out = place.path().join("o");
    let manifest = Manifest::read(&out.join(MANIFEST_FILE)).map_err(|e| e.to_string())?;
    if manifest.failed.len() != 1
        || !manifest.failed[0].reason.contains("frames[1].lidar.file")
        || manifest.shards.len() != 1
    {
        return Err(format!("{manifest:?}").into());
    }
    if !fs::read_to_string(out.join("report.html"))?.contains("frames[1].lidar.file") {
        return Err("the report does not name the reason".into());
    }
    // Once the clip is whole, the job is as if it had been from the start.
    clips::copy(&clips::street(), &spoilt)?;
    targetgen(place.path(), &[&["list", "--out", "o", "--resume"], SMALL.as_slice()].concat())?.expect_success()?;
    targetgen(place.path(), &[&["list", "--out", "fresh"], SMALL.as_slice()].concat())?.expect_success()?;
    same_product(&out, &place.path().join("fresh"))
}

fn retarget() -> Outcome {
    let place = tempfile::tempdir()?;
    let street = clips::street();
    let street = street.to_str().ok_or("a path that is no text")?;
    targetgen(place.path(), &[&[street, "--out", "a"], SMALL.as_slice()].concat())?.expect_success()?;
    let other = ["--zscore", "per-action", "--log-scale", "0.1"];
    targetgen(place.path(), &[&["retarget", "a", "--out", "b"], other.as_slice()].concat())?.expect_success()?;
    targetgen(place.path(), &[&[street, "--out", "c"], SMALL.as_slice(), &other].concat())?.expect_success()?;
    same_product(&place.path().join("b"), &place.path().join("c"))?;
    let shard = Shard::read(&place.path().join("b/targets-00000.safetensors")).map_err(|e| e.to_string())?;
    let clip = shard.clip("street").map_err(|e| e.to_string())?;
    let want = targets([&clip.prune.delta, &clip.add.delta], [&clip.prune.mask, &clip.add.mask], shard.config());
    let valid = clip.prune.mask.iter().filter(|set| **set).count();
    if want.prune != clip.prune || shard.config().zscore != ZScore::PerAction || valid < 1000 {
        return Err(format!("{valid} valid targets").into());
    }
    Ok(())
}

fn flipped_byte() -> Outcome {
    let place = tempfile::tempdir()?;
    list(place.path(), 3)?;
    targetgen(place.path(), &[&["list", "--out", "o"], SMALL.as_slice()].concat())?.expect_success()?;
    targetgen(place.path(), &["verify", "o"])?.expect_success()?;
    let name = "targets-00001.safetensors";
    let path = place.path().join("o").join(name);
    let mut bytes = fs::read(&path)?;
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&path, bytes)?;
    targetgen(place.path(), &["verify", "o"])?.expect_refusal(&[name, "SHA-256"])?;
    targetgen(place.path(), &["retarget", "o", "--out", "p"])?.expect_refusal(&[name, "SHA-256"])?;
    targetgen(place.path(), &[&["list", "--out", "o", "--resume"], SMALL.as_slice()].concat())?
        .expect_refusal(&[name, "SHA-256"])
}

fn features() -> Outcome {
    let place = tempfile::tempdir()?;
    let street = clips::street();
    let street = street.to_str().ok_or("a path that is no text")?;
    let weights = format!("random:{}", lgs_tests::places::repository().join("models/tiny.json").display());
    let flags = ["--weights", &weights, "--with-features", "--signal", "magnitude"];
    targetgen(place.path(), &[&[street, "--out", "o"], SMALL.as_slice(), &flags].concat())?.expect_success()?;
    let shard = Shard::read(&place.path().join("o/targets-00000.safetensors")).map_err(|e| e.to_string())?;
    let clip = shard.clip("street").map_err(|e| e.to_string())?;
    let features = clip.features.ok_or("no features")?;
    let finite = features.bits.iter().all(|bits| bits & 0x7c00 != 0x7c00);
    let some = features.bits.iter().any(|bits| bits & 0x7fff != 0);
    let known = shard.config().weights.as_ref().is_some_and(|weights| weights.starts_with("random:"));
    if finite && some && known && features.bits.len() == features.width * clip.gaussians.len() {
        return Ok(());
    }
    Err(format!("finite {finite}, some {some}, weights {:?}", shard.config().weights).into())
}

fn refusals() -> Outcome {
    let place = tempfile::tempdir()?;
    let street = clips::street();
    let street = street.to_str().ok_or("a path that is no text")?;
    let refused = |arguments: &[&str], names: &[&str]| targetgen(place.path(), arguments)?.expect_refusal(names);
    refused(&[], &["required"])?;
    refused(&[street], &["--out"])?;
    refused(&["nowhere", "--out", "o"], &["nowhere"])?;
    refused(&[street, "--out", "o", "--part", "3/2"], &["--part", "3/2"])?;
    refused(&[street, "--out", "o", "--rho", "2"], &["--rho", "2"])?;
    refused(&[street, "--out", "o", "--weights", "nowhere.safetensors"], &["nowhere.safetensors"])?;
    if place.path().join("o").exists() {
        return Err("a refused run left a folder".into());
    }
    let small = [&[street, "--out", "o"], SMALL.as_slice()].concat();
    targetgen(place.path(), &small)?.expect_success()?;
    refused(&small, &["--resume", "manifest.json"])?;
    refused(
        &[small.as_slice(), &["--resume", "--seed", "9"]].concat(),
        &["targets-00000.safetensors", "config", "seed"],
    )
}

fn fidelity() -> Outcome {
    let place = tempfile::tempdir()?;
    let street = clips::street();
    let street = street.to_str().ok_or("a path that is no text")?;
    let flags = ["--sample", "60", "--after", "1", "--sample-after", "5", "--image-size", "48x80", "--warm-up", "1"];
    targetgen(place.path(), &[&["fidelity", street, "--out", "o"], flags.as_slice()].concat())?.expect_success()?;
    let text = fs::read_to_string(place.path().join("o/fidelity.json"))?;
    let page: serde_json::Value = serde_json::from_str(&text)?;
    let rows = page["at-once"].as_array().ok_or("no rows")?;
    let correlation = |row: &serde_json::Value| row["correlation"].as_f64().unwrap_or(0.0);
    let footprint: Vec<f64> = rows.iter().filter(|row| row["signal"] == "footprint").map(correlation).collect();
    let drawn = place.path().join("o/after-add-magnitude.svg").exists();
    if footprint.len() == 2 && footprint.iter().all(|&r| r > 0.4) && page["after"][0]["count"] == 5 && drawn {
        return Ok(());
    }
    Err(text.into())
}
