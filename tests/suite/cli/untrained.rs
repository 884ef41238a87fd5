//! A network whose heads are still zero gives what no network gives, byte for byte.

use std::fs;
use std::path::{Path, PathBuf};

use lgs_formats::ply::read_ply;
use lgs_tests::process::{binary, run};
use lgs_tests::weights::SMALL;
use lgs_tests::{Outcome, case, clips, metrics};
use libtest_mimic::Trial;

use super::infer::files;

pub(crate) fn cases() -> Vec<Trial> {
    ["off", "policy", "random"]
        .map(|density| case(format!("cli::untrained::density_{density}"), move || same_as_without(density)))
        .into()
}

fn infer(place: &Path, out: &str, flags: &[&str]) -> Result<PathBuf, libtest_mimic::Failed> {
    let street = clips::street();
    let mut arguments = vec![street.as_os_str(), "--out".as_ref(), out.as_ref()];
    let common = ["--hold-out", "odd", "--image-size", "96x160"];
    arguments.extend(common.iter().chain(flags).map(|flag| flag.as_ref() as &std::ffi::OsStr));
    run(&binary("lgs-infer")?, &arguments, place)?.expect_success()?;
    Ok(place.join(out))
}

fn same_as_without(density: &str) -> Outcome {
    let place = tempfile::tempdir()?;
    fs::write(place.path().join("small.json"), SMALL)?;
    let without = infer(place.path(), "without", &["--weights", "none"])?;
    let with = infer(place.path(), "with", &["--weights", "random:small.json", "--density", density])?;
    for picture in files(&without)?.iter().filter(|name| name.starts_with("views")) {
        if fs::read(without.join(picture))? != fs::read(with.join(picture))? {
            return Err(format!("{} differs", picture.display()).into());
        }
    }
    let mut scene = read_ply(&with.join("scene.ply"))?;
    let scores = std::mem::take(&mut scene.extra);
    if density == "off" && fs::read(with.join("scene.ply"))? != fs::read(without.join("scene.ply"))? {
        return Err("scene.ply differs".into());
    }
    // Bits, not values: written again without its scores the file must be the one without a network.
    let again = place.path().join("again.ply");
    lgs_formats::ply::write_ply(&again, &scene)?;
    if fs::read(again)? != fs::read(without.join("scene.ply"))? {
        return Err("the Gaussians of scene.ply differ".into());
    }
    let (page, plain) = (metrics::read(&with)?, metrics::read(&without)?);
    if page["views"] != plain["views"] || page["gaussians"] != plain["gaussians"] {
        return Err(format!("figures differ: {page:#}, {plain:#}").into());
    }
    let num_lidar = page["gaussians"]["final"].as_u64().and_then(|n| usize::try_from(n).ok()).unwrap_or(0);
    let undecided = |(_, column): &(String, Vec<f32>)| column[..num_lidar].iter().all(|&score| score == 0.5);
    let sound = if density == "off" { scores.is_empty() } else { scores.len() == 2 && scores.iter().all(undecided) };
    if sound { Ok(()) } else { Err("expected scores of 1/2 with a policy and none without".into()) }
}
