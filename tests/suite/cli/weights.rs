//! `lgs-infer --weights`: what is wrong with the file is one line, exit code 2, `--out` untouched.

use std::fs;
use std::path::Path;

use candle_core::DType;
use lgs_tests::process::{Finished, binary, run};
use lgs_tests::weights::{Heads, SMALL, Weights};
use lgs_tests::{Outcome, case, clips};
use libtest_mimic::Trial;

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("cli::weights::faults_are_named_in_one_line", faults_are_named),
        case("cli::weights::truncated", truncated),
        case("cli::weights::missing_file", || refuses("nowhere.safetensors", &["nowhere.safetensors"])),
        case("cli::weights::missing_config", || refuses("random:nowhere.json", &["nowhere.json"])),
        case("cli::weights::no_file_after_random", || refuses("random:", &["--weights"])),
        case("cli::weights::absurd_config", absurd_config),
        case("cli::weights::a_file_that_is_none", || refuses("clip", &["clip"])),
    ]
}

fn infer(place: &Path, weights: &str) -> Result<Finished, String> {
    let street = clips::street();
    let arguments = [street.as_os_str(), "--out".as_ref(), "out".as_ref(), "--weights".as_ref(), weights.as_ref()];
    run(&binary("lgs-infer")?, &arguments, place)
}

fn refused_in(place: &Path, weights: &str, names: &[&str]) -> Outcome {
    infer(place, weights)?.expect_refusal(names)?;
    if place.join("out").exists() { Err("the refused run left an output directory".into()) } else { Ok(()) }
}

fn refuses(weights: &str, names: &[&str]) -> Outcome {
    let place = tempfile::tempdir()?;
    fs::write(place.path().join("clip"), "no weights")?;
    refused_in(place.path(), weights, names)
}

fn faults_are_named() -> Outcome {
    let place = tempfile::tempdir()?;
    let mut weights = Weights::seeded(SMALL, 1, Heads::ZERO)?;
    let missing = weights.tensors.remove("query.projection.weight").ok_or("no query")?;
    weights.tensors.insert("query.projection.bias".to_owned(), missing);
    weights.write(&place.path().join("w.safetensors"))?;
    let names =
        ["w.safetensors", "1 missing: query.projection.weight", "1 not used by the model: query.projection.bias"];
    refused_in(place.path(), "w.safetensors", &names)
}

fn truncated() -> Outcome {
    let place = tempfile::tempdir()?;
    let bytes = Weights::seeded(SMALL, 1, Heads::ZERO)?.bytes(DType::F32)?;
    fs::write(place.path().join("w.safetensors"), &bytes[..bytes.len() / 2])?;
    refused_in(place.path(), "w.safetensors", &["w.safetensors", "safetensors file"])
}

fn absurd_config() -> Outcome {
    let place = tempfile::tempdir()?;
    let wide = SMALL
        .replace(r#""encoder": [8, 16], "decoder": [16, 8]"#, r#""encoder": [4096, 4096], "decoder": [4096, 4096]"#);
    fs::write(place.path().join("wide.json"), wide)?;
    refused_in(place.path(), "random:wide.json", &["wide.json", "parameters"])
}
