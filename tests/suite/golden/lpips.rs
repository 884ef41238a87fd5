//! LPIPS against the original implementation.

use std::fs;
use std::path::Path;

use lgs_engine::evaluate::lpips::Lpips;
use lgs_formats::image::RgbImage;
use lgs_tests::compare::{absolute, close};
use lgs_tests::golden::{GoldenFile, files};
use lgs_tests::views::{measured, picture};
use lgs_tests::{Needed, Outcome, case, case_if, places};
use libtest_mimic::Trial;
use serde_json::Value;

const TOLERANCE: f64 = 1e-4;

pub(crate) fn cases() -> Vec<Trial> {
    let needed = Needed::path(&places::lpips_weights(), "the LPIPS weights");
    match files("lpips", "json") {
        Ok(files) => files.into_iter().map(|file| case_if(&needed, file.name.clone(), move || equals(&file))).collect(),
        Err(error) => vec![case("golden::lpips::files", move || Err(error.into()))],
    }
}

fn equals(file: &GoldenFile) -> Outcome {
    let lpips = Lpips::load(&places::lpips_weights())?;
    let table: Value = serde_json::from_str(&fs::read_to_string(&file.path)?)?;
    let pairs = table["pairs"].as_array().ok_or("golden.json has no pairs")?;
    let directory = file.path.parent().unwrap_or(Path::new("."));
    for pair in pairs {
        let name = |side: &str| pair[side].as_str().unwrap_or_default().to_owned();
        let (a, b) = (read(&directory.join(name("a")))?, read(&directory.join(name("b")))?);
        let what = format!("{} against {}", name("a"), name("b"));
        let want = pair["squeeze"].as_f64().ok_or_else(|| format!("{what}: no value"))?;
        let distance = |x, y| measured(x, y, None, Some(&lpips)).map(|figures| figures.lpips.unwrap_or(f64::NAN));
        close(&what, &[distance(&a, &b)?], &[want], absolute(TOLERANCE))?;
        close(&format!("{} against itself", name("a")), &[distance(&a, &a)?], &[0.0], absolute(1e-9))?;
    }
    if pairs.is_empty() { Err("golden.json has no pairs".into()) } else { Ok(()) }
}

fn read(path: &Path) -> Result<RgbImage, libtest_mimic::Failed> {
    let image = image::open(path).map_err(|e| format!("{}: {e}", path.display()))?.to_rgb8();
    let values: Vec<f64> = image.iter().map(|&byte| f64::from(byte) / 255.0).collect();
    Ok(picture(usize::try_from(image.width())?, usize::try_from(image.height())?, &values))
}
