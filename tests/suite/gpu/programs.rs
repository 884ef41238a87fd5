//! `lgs-infer` on a GPU.

use lgs_tests::process::{binary, run};
use lgs_tests::{Outcome, clips, metrics, places};
use serde_json::Value;

use super::{Case, adapter};

pub(super) const CASES: &[Case] = &[
    ("infer_reaches_the_cpus_figures", infer_reaches_the_cpus_figures),
    ("devices_are_listed", devices_are_listed),
    ("a_gpu_that_is_not_there_is_refused", a_gpu_that_is_not_there_is_refused),
];

/// Views of a step of Adam, and the largest difference of held-out PSNR, dB. A step goes by the sign of a gradient however small it is, and what a view
/// hardly shows has one of rounding: by one view of this small clip each, single runs differ by up to 0.03 dB.
const MOST_APART_DB: [(&str, f64); 2] = [("4", 0.02), ("1", 0.1)];

fn flag() -> Result<String, String> {
    let index = adapter::gpu().map_err(|needed| format!("{needed:?}"))?.adapter().index;
    Ok(format!("gpu:{index}"))
}

/// The page of a run on the street with two learned steps and two passes of Adam.
fn infer(device: &str, views: &str) -> Result<Value, libtest_mimic::Failed> {
    let place = tempfile::tempdir()?;
    let (clip, out) = (clips::street(), place.path().join("out"));
    let flags = "--image-size 64x96 --frames 0..3 --hold-out odd --refine-with adam:2 --refine-steps 2 --views held-out --refine-views";
    let mut arguments = vec![clip.into_os_string(), "--out".into(), out.clone().into_os_string()];
    arguments.extend(flags.split(' ').chain([views, "--device", device]).map(Into::into));
    run(&binary("lgs-infer")?, &arguments, places::repository())?.expect_success()?;
    Ok(metrics::read(&out)?)
}

fn infer_reaches_the_cpus_figures() -> Outcome {
    MOST_APART_DB.into_iter().try_for_each(|(views, most)| figures_agree(views, most))
}

fn figures_agree(views: &str, most: f64) -> Outcome {
    let (got, want) = (infer(&flag()?, views)?, infer("cpu", views)?);
    let name = adapter::gpu().map_err(|needed| format!("{needed:?}"))?.adapter().name.clone();
    let drawn_on = |page: &Value| page["drawn_on"]["device"].as_str().unwrap_or_default().to_owned();
    if !drawn_on(&got).starts_with(&name) || got["drawn_on"].get("refused").is_some() || drawn_on(&want) != "CPU" {
        return Err(format!("drawn on {} and {}", got["drawn_on"], want["drawn_on"]).into());
    }
    let psnr = |page: &Value| metrics::number(page, &["mean", "held_out", "psnr"]);
    let (got, want) = (psnr(&got)?, psnr(&want)?);
    if (got - want).abs() > most {
        return Err(format!("{views} views a step: held-out PSNR {got} dB on the GPU, {want} dB by the CPU").into());
    }
    Ok(())
}

fn devices_are_listed() -> Outcome {
    let finished = run(&binary("lgs-infer")?, &["--devices"], places::repository())?;
    finished.expect_success()?;
    let wanted = flag()?;
    let lists = |text: &str| text.starts_with("cpu\n") && text.lines().any(|line| line.starts_with(&wanted));
    if lists(&finished.stdout) { Ok(()) } else { Err(format!("listed: {}", finished.stdout).into()) }
}

fn a_gpu_that_is_not_there_is_refused() -> Outcome {
    let (clip, place) = (clips::street().into_os_string(), tempfile::tempdir()?);
    for (program, flags) in [
        ("lgs-infer", "--out out --device gpu:99"),
        ("lgs-eval", "--protocol own --snippet-frames 3 --out out --device gpu:99"),
    ] {
        let arguments: Vec<_> = [clip.clone()].into_iter().chain(flags.split(' ').map(Into::into)).collect();
        let finished = run(&binary(program)?, &arguments, place.path())?;
        // Mesa may say before that it found no screen.
        finished.expect_one_line_at_the_end(&["--device", "a GPU of number 99"])?;
        if place.path().join("out").exists() {
            return Err(format!("{program} began its output").into());
        }
    }
    Ok(())
}
