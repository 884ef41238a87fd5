//! Scores of validation: what `lgs-infer` finds with the same weights.

use std::ffi::OsStr;
use std::path::Path;

use lgs_engine::densify::Thresholds;
use lgs_engine::network::source::load_model;
use lgs_formats::image::ImageSize;
use lgs_tests::process::{binary, run};
use lgs_tests::weights::{Heads, SMALL, Weights};
use lgs_tests::{Outcome, case, clips, metrics};
use lgs_train::stages::settings::SetUpdate;
use lgs_train::stages::validate::ValidationClip;
use libtest_mimic::{Failed, Trial};

use super::fixtures::failed;

/// Most steps of the refinement: more than help, so that some are taken back.
const STEPS: usize = 4;

pub(crate) fn cases() -> Vec<Trial> {
    vec![case("train::validate::scores_are_those_of_inference", scores_are_those_of_inference)]
}

fn scores_are_those_of_inference() -> Outcome {
    let place = tempfile::tempdir()?;
    Weights::seeded(SMALL, 2, Heads { residuals: 1e-4, scores: 2.0 })?.write(&place.path().join("w.safetensors"))?;
    let model = load_model(&place.path().join("w.safetensors")).map_err(failed)?.model;
    let size = ImageSize { height: 48, width: 80 };
    let clip = ValidationClip::open(&clips::street(), 3, Some(size)).map_err(failed)?;
    let thresholds = Thresholds { prune: 0.5, add: 0.5 };
    let by_policy = ["--density", "policy", "--theta-prune", "0.5", "--theta-add", "0.5"];
    let ways: [(Option<SetUpdate>, &[&str]); 2] =
        [(None, &["--density", "off"]), (Some((thresholds, None)), &by_policy)];
    for (update, flags) in ways {
        let score = clip.score(&model, STEPS, update).map_err(failed)?;
        if score.after.len() != STEPS + 1 {
            return Err(format!("{flags:?}: {} scores", score.after.len()).into());
        }
        for (steps, got) in score.after.iter().enumerate() {
            let want = inferred(place.path(), flags, steps)?;
            if got.to_bits() != want.to_bits() {
                return Err(format!("{flags:?}, {steps} steps: got {got}, lgs-infer says {want}").into());
            }
        }
    }
    Ok(())
}

/// PSNR of the held-out views as `lgs-infer` says.
fn inferred(place: &Path, flags: &[&str], steps: usize) -> Result<f64, Failed> {
    let (street, steps) = (clips::street(), steps.to_string());
    let common = ["--weights", "w.safetensors", "--out", "out", "--image-size", "48x80", "--frames", "0..2"];
    let more = ["--hold-out", "odd", "--views", "held-out", "--refine-steps", &steps];
    let words = common.iter().chain(&more).chain(flags).map(|word| OsStr::new(*word));
    let words: Vec<&OsStr> = [street.as_os_str()].into_iter().chain(words).collect();
    run(&binary("lgs-infer")?, &words, place)?.expect_success()?;
    Ok(metrics::number(&metrics::read(&place.join("out"))?, &["mean", "held_out", "psnr"])?)
}
