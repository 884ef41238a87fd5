//! `lgs-infer --refine-with adam:N`: per-scene optimisation, with a network and without.

use std::ffi::OsStr;
use std::fs;
use std::path::Path;

use lgs_tests::process::{binary, run};
use lgs_tests::weights::{Heads, SMALL, Weights};
use lgs_tests::{Outcome, case, clips, metrics};
use libtest_mimic::{Failed, Trial};
use serde_json::{Value, json};

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("cli::adam::the_loss_falls_and_the_page_says_what_was_done", the_loss_falls),
        case("cli::adam::same_bytes_for_any_number_of_threads", same_bytes),
        case("cli::adam::views_in_turns_are_fewer_and_their_order_is_the_seeds", views_in_turns),
        case("cli::adam::behind_a_network_it_takes_the_place_of_the_learned_steps", behind_a_network),
    ]
}

fn infer(place: &Path, out: &str, flags: &[&str]) -> Result<Value, Failed> {
    let street = clips::street();
    let mut arguments = vec![street.as_os_str()];
    let common = ["--out", out, "--image-size", "48x80", "--frames", "0..2", "--hold-out", "1", "--views", "held-out"];
    arguments.extend(common.iter().chain(flags).map(|flag| OsStr::new(*flag)));
    run(&binary("lgs-infer")?, &arguments, place)?.expect_success()?;
    Ok(metrics::read(&place.join(out))?)
}

fn losses(page: &Value) -> Vec<f64> {
    page["optimisation"]["losses"].as_array().into_iter().flatten().filter_map(Value::as_f64).collect()
}

fn expect(what: &str, got: &Value, want: &Value) -> Outcome {
    if got == want { Ok(()) } else { Err(format!("{what}: got {got}, want {want}").into()) }
}

fn the_loss_falls() -> Outcome {
    let place = tempfile::tempdir()?;
    let page = infer(place.path(), "out", &["--weights", "none", "--refine-with", "adam:8"])?;
    let plain = infer(place.path(), "plain", &["--weights", "none"])?;
    metrics::expect_optimised_keys(&page)?;
    expect("config.refine_with", &page["config"]["refine_with"], &json!("adam:8"))?;
    expect("config.refine_with without", &plain["config"]["refine_with"], &Value::Null)?;
    let losses = losses(&page);
    if losses.len() != 8 || !losses.is_sorted_by(|a, b| a > b) {
        return Err(format!("expected 8 falling losses, got {losses:?}").into());
    }
    let psnr = |page: &Value| metrics::number(page, &["mean", "held_out", "psnr"]);
    let (optimised, start) = (psnr(&page)?, psnr(&plain)?);
    if optimised > start { Ok(()) } else { Err(format!("held out {optimised} dB, {start} dB without").into()) }
}

fn same_bytes() -> Outcome {
    let place = tempfile::tempdir()?;
    for threads in ["1", "2"] {
        infer(place.path(), threads, &["--weights", "none", "--refine-with", "adam:3", "--threads", threads])?;
    }
    let scene = |out: &str| fs::read(place.path().join(out).join("scene.ply"));
    if scene("1")? == scene("2")? { Ok(()) } else { Err("scene.ply differs".into()) }
}

fn views_in_turns() -> Outcome {
    let place = tempfile::tempdir()?;
    let with = |out: &str, seed: &str| {
        let flags = ["--weights", "none", "--refine-with", "adam:4", "--refine-views", "1", "--seed", seed];
        infer(place.path(), out, &flags)
    };
    let (first, again, other) = (with("a", "1")?, with("b", "1")?, with("c", "2")?);
    expect("config.refine_views", &first["config"]["refine_views"], &json!(1))?;
    if losses(&first) != losses(&again) || losses(&first) == losses(&other) {
        return Err(format!("{:?} {:?} {:?}", losses(&first), losses(&again), losses(&other)).into());
    }
    Ok(())
}

fn behind_a_network() -> Outcome {
    let place = tempfile::tempdir()?;
    Weights::seeded(SMALL, 2, Heads { residuals: 1e-3, scores: 0.0 })?.write(&place.path().join("w.safetensors"))?;
    let with = |out: &str, flags: &[&str]| {
        infer(place.path(), out, &[["--weights", "w.safetensors"].as_slice(), flags].concat())
    };
    let (adam, none) = (with("a", &["--refine-with", "adam:0"])?, with("b", &["--refine-steps", "0"])?);
    expect("no learned step", &adam["network"]["refine"]["steps"], &json!(0))?;
    expect("adam:0 leaves the prediction as it is", &adam["views"], &none["views"])?;
    let two = with("c", &["--refine-with", "adam:2"])?;
    if two["views"] == none["views"] {
        return Err("two steps changed nothing".into());
    }
    let both = with("d", &["--refine-with", "adam:2", "--refine-steps", "1", "--pixel-stride", "2"])?;
    expect("config.refine_steps", &both["config"]["refine_steps"], &json!(1))?;
    expect("config.pixel_stride", &both["config"]["pixel_stride"], &json!("2"))?;
    for (what, found) in [("network", &both["network"]["refine"]), ("optimisation", &both["optimisation"])] {
        expect(what, &found["pixel_stride"], &json!(2))?;
    }
    if losses(&both).len() != 2 || both["network"]["refine"]["losses"].as_array().is_none_or(Vec::is_empty) {
        return Err(format!("expected both refinements, found {both}").into());
    }
    Ok(())
}
