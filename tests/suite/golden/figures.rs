//! PSNR and SSIM against other implementations.

use std::fs;

use lgs_tests::compare::{absolute, close};
use lgs_tests::golden::tensors::{TensorFile, Values};
use lgs_tests::golden::{GoldenFile, files};
use lgs_tests::views::{measured, picture};
use lgs_tests::{Outcome, case};
use libtest_mimic::Trial;
use serde_json::Value;

const TOLERANCE: f64 = 1e-5;
/// The variants of SSIM that are ours: Gaussian window, mean over the pixels whose window lies in the image.
const SSIM: [&str; 2] = ["ssim_skimage_gauss11_cropped_mean", "ssim_pytorch_msssim_valid"];

pub(crate) fn cases() -> Vec<Trial> {
    let found = files("metrics", "safetensors").and_then(|files| {
        let cases: Result<Vec<_>, String> = files.iter().map(cases_of).collect();
        cases.map(|cases| cases.into_iter().flatten().collect())
    });
    found.unwrap_or_else(|error: String| vec![case("golden::metrics::files", move || Err(error.into()))])
}

/// A case for each pair that the `values.json` beside the file tells the values of.
fn cases_of(file: &GoldenFile) -> Result<Vec<Trial>, String> {
    let path = file.path.with_file_name("values.json");
    let text = fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    let values: Value = serde_json::from_str(&text).map_err(|e| format!("{}: {e}", path.display()))?;
    let pairs = values.as_object().ok_or_else(|| format!("{}: no object", path.display()))?;
    let case_of = |(pair, want): (&String, &Value)| {
        let (file, pair, want) = (file.clone(), pair.clone(), want.clone());
        case(format!("{}::{pair}", file.name), move || equals(&file, &pair, &want))
    };
    Ok(pairs.iter().map(case_of).collect())
}

fn equals(file: &GoldenFile, pair: &str, want: &Value) -> Outcome {
    let tensors = TensorFile::open(&file.path)?;
    let read = |side: &str| tensors.get(&format!("{pair}.{side}"));
    let (a, b) = (read("a")?, read("b")?);
    let image = |values: &Values| picture(values.shape[1], values.shape[0], &values.data);
    let figures = measured(&image(&a), &image(&b), None, None)?;
    let number = |key: &str| want[key].as_f64();
    let psnr = figures.psnr.ok_or("no PSNR")?;
    close("psnr", &[psnr], &[number("psnr").unwrap_or(f64::INFINITY)], absolute(TOLERANCE))?;
    let ssim = figures.ssim.ok_or("no SSIM")?;
    for variant in SSIM {
        let want = number(variant).ok_or_else(|| format!("values.json: {pair} has no {variant}"))?;
        close(variant, &[ssim], &[want], absolute(TOLERANCE))?;
    }
    Ok(())
}
