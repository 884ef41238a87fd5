//! The weights that ship: the card is theirs, and programs that were built with them use them.

use std::fs;

use lgs_engine::network::shipped;
use lgs_engine::network::source::load_model;
use lgs_tests::process::{binary, run};
use lgs_tests::{Needed, Outcome, case, case_if, clips, metrics, places};
use lgs_train::ship::{CARD_FILE, MAX_BYTES, WEIGHTS_FILE};
use libtest_mimic::Trial;

pub(crate) fn cases() -> Vec<Trial> {
    let weights = match shipped::BYTES {
        Some(_) => Needed::Here,
        None => Needed::Missing(shipped::FILE.to_owned()),
    };
    vec![
        case("cli::shipped::the_card_is_beside_the_file", the_card_is_beside_the_file),
        case_if(&weights, "cli::shipped::the_card_is_of_the_file", the_card_is_of_the_file),
        case("cli::shipped::tiny_means_the_file_or_is_refused", tiny_means_the_file),
        case_if(&weights, "cli::shipped::a_line_search_of_the_last_step_is_that_of_one_step_alone", line_searches),
    ]
}

fn the_card_is_beside_the_file() -> Outcome {
    let models = places::repository().join("models");
    let (weights, card) = (models.join(WEIGHTS_FILE), models.join(CARD_FILE));
    if weights.is_file() != card.is_file() {
        return Err(format!("of {WEIGHTS_FILE} and {CARD_FILE} one is there and one is not").into());
    }
    if weights.is_file() != shipped::BYTES.is_some() {
        return Err("the programs were not built from these files".into());
    }
    Ok(())
}

fn the_card_is_of_the_file() -> Outcome {
    let models = places::repository().join("models");
    let (weights, card) = (models.join(WEIGHTS_FILE), models.join(CARD_FILE));
    let bytes = fs::read(&weights)?;
    if bytes.len() > MAX_BYTES || shipped::BYTES != Some(&bytes) {
        return Err(format!("{} bytes, at most {MAX_BYTES}, the same as in the programs", bytes.len()).into());
    }
    let (digest, text) = (load_model(&weights).map_err(|e| e.to_string())?.digest, fs::read_to_string(card)?);
    for wanted in [&digest, &bytes.len().to_string(), "## Data", "## Scores", "licence"] {
        if !text.contains(wanted) {
            return Err(format!("{CARD_FILE} does not say {wanted}").into());
        }
    }
    Ok(())
}

fn tiny_means_the_file() -> Outcome {
    let place = tempfile::tempdir()?;
    let street = clips::street();
    let infer = |out: &str, flags: &[&str]| {
        let mut arguments = vec![street.as_os_str()];
        let common = ["--out", out, "--image-size", "48x80", "--frames", "0", "--views", "none"];
        arguments.extend(common.iter().chain(flags).map(|flag| flag.as_ref() as &std::ffi::OsStr));
        run(&binary("lgs-infer")?, &arguments, place.path())
    };
    let (named, unnamed) = (infer("named", &["--weights", "tiny"])?, infer("unnamed", &[])?);
    unnamed.expect_success()?;
    let used = metrics::read(&place.path().join("unnamed"))?["weights"].clone();
    if shipped::BYTES.is_none() {
        named.expect_refusal(&["--weights", "models/tiny.safetensors"])?;
        return if used.is_null() { Ok(()) } else { Err(format!("used {used}").into()) };
    }
    named.expect_success()?;
    let digest = load_model(&places::repository().join(shipped::FILE)).map_err(|e| e.to_string())?.digest;
    if used == digest.as_str() { Ok(()) } else { Err(format!("used {used}, want {digest}").into()) }
}

fn line_searches() -> Outcome {
    let place = tempfile::tempdir()?;
    let street = clips::street();
    let psnr = |steps: &str, search: &str| -> Result<f64, libtest_mimic::Failed> {
        let mut arguments = vec![street.as_os_str()];
        let flags =
            ["--out", "out", "--image-size", "48x80", "--frames", "0..2", "--hold-out", "1", "--views", "held-out"];
        let more = ["--density", "off", "--refine-steps", steps, "--line-search", search];
        arguments.extend(flags.iter().chain(&more).map(|flag| flag.as_ref() as &std::ffi::OsStr));
        run(&binary("lgs-infer")?, &arguments, place.path())?.expect_success()?;
        let page = metrics::read(&place.path().join("out"))?;
        if page["config"]["line_search"] != search {
            return Err(format!("config.line_search {}, want {search}", page["config"]["line_search"]).into());
        }
        Ok(metrics::number(&page, &["mean", "held_out", "psnr"])?)
    };
    let figures = |steps: &str| -> Result<[f64; 3], libtest_mimic::Failed> {
        Ok([psnr(steps, "every")?, psnr(steps, "last")?, psnr(steps, "off")?])
    };
    let ([every, last, off], [of_every, of_last, of_off]) = (figures("1")?, figures("2")?);
    if every != last || every == off || of_every == of_last || of_last == of_off {
        return Err(format!("one step: {every}, {last}, {off} dB; two: {of_every}, {of_last}, {of_off} dB").into());
    }
    Ok(())
}
