//! `lgs-infer` with a network: what `metrics.json` says of its stages, and of what was left out.

use std::fs;

use lgs_tests::process::{Finished, binary, run};
use lgs_tests::weights::{Heads, SMALL, Weights};
use lgs_tests::{Outcome, case, clips, metrics};
use libtest_mimic::{Failed, Trial};
use serde_json::{Value, json};

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("cli::network::metrics_have_exactly_the_promised_keys", promised_keys),
        case("cli::network::a_single_timestamp_is_not_asked", single_timestamp),
        case("cli::network::what_the_model_lacks_is_said", lacking),
        case("cli::network::query_and_refinement_can_be_switched_off", switched_off),
        case("cli::network::a_step_that_helps_is_kept", a_step_that_helps),
        case("cli::network::sizes_at_the_edges_run", sizes_at_the_edges),
    ]
}

/// A folder with the small config and weights of it whose refinement moves things a little.
fn place() -> Result<tempfile::TempDir, Failed> {
    place_of(2)
}

/// The same with the weights of a seed.
fn place_of(seed: u64) -> Result<tempfile::TempDir, Failed> {
    let place = tempfile::tempdir()?;
    fs::write(place.path().join("small.json"), SMALL)?;
    let weights = Weights::seeded(SMALL, seed, Heads { residuals: 1e-4, scores: 0.0 })?.at_rest()?;
    weights.write(&place.path().join("forward.safetensors"))?;
    weights.backwards()?.write(&place.path().join("backward.safetensors"))?;
    Ok(place)
}

fn finish(place: &tempfile::TempDir, flags: &[&str]) -> Result<Finished, Failed> {
    let street = clips::street();
    let mut arguments = vec![street.as_os_str()];
    let common = ["--out", "out", "--image-size", "48x80", "--views", "none"];
    arguments.extend(common.iter().chain(flags).map(|flag| flag.as_ref() as &std::ffi::OsStr));
    Ok(run(&binary("lgs-infer")?, &arguments, place.path())?)
}

fn page(place: &tempfile::TempDir, flags: &[&str]) -> Result<Value, Failed> {
    finish(place, flags)?.expect_success()?;
    Ok(metrics::read(&place.path().join("out"))?)
}

fn equals(what: &str, got: &Value, want: &Value) -> Outcome {
    if got == want { Ok(()) } else { Err(format!("{what}: got {got}, want {want}").into()) }
}

fn promised_keys() -> Outcome {
    let place = place()?;
    let flags = ["--weights", "forward.safetensors", "--frames", "0,1", "--density", "policy"];
    let page = page(&place, &flags)?;
    metrics::expect_network_keys(&page)?;
    let seconds = |key: &str| metrics::number(&page, &["stages_s", key]);
    let parts = seconds("refine_render")? + seconds("refine_loss")? + seconds("refine_network")?;
    if parts > seconds("refine")?
        || seconds("refine_network")? <= 0.0
        || seconds("backbone")? <= 0.0
        || seconds("policy")? <= 0.0
    {
        return Err(format!("stages that do not add up: {}", page["stages_s"]).into());
    }
    let digest = page["weights"].as_str().unwrap_or_default();
    if digest.len() == 64 { Ok(()) } else { Err(format!("weights {digest:?}, want a SHA-256").into()) }
}

fn single_timestamp() -> Outcome {
    let page = page(&place()?, &["--weights", "random:small.json", "--frames", "0", "--density", "policy"])?;
    equals("query_skipped", &page["network"]["query_skipped"], &json!("single_timestamp"))?;
    equals("stages_s.policy > 0", &json!(metrics::number(&page, &["stages_s", "policy"])? > 0.0), &json!(true))
}

fn lacking() -> Outcome {
    let place = place()?;
    let mut config: Value = serde_json::from_str(SMALL)?;
    config["query"] = Value::Null;
    config["policy"] = Value::Null;
    fs::write(place.path().join("plain.json"), config.to_string())?;
    let page = page(&place, &["--weights", "random:plain.json", "--frames", "0,1", "--density", "policy"])?;
    equals("query_skipped", &page["network"]["query_skipped"], &json!("not_in_model"))?;
    equals("set_update_skipped", &page["network"]["set_update_skipped"], &json!("not_in_model"))
}

fn switched_off() -> Outcome {
    let flags = ["--weights", "random:small.json", "--frames", "0,1", "--query", "off", "--refine-steps", "0"];
    let page = page(&place()?, &flags)?;
    equals("query_skipped", &page["network"]["query_skipped"], &json!("off"))?;
    equals("refine.losses", &page["network"]["refine"]["losses"], &json!([]))?;
    equals("config.query", &page["config"]["query"], &json!(false))
}

/// A step that helps is kept and the loss falls; one that does not is taken back. Of some pairs of opposite steps one at least helps.
fn a_step_that_helps() -> Outcome {
    let (mut kept, mut undone) = (0, 0);
    for seed in 0..4 {
        let place = place_of(seed)?;
        for weights in ["forward.safetensors", "backward.safetensors"] {
            let page = page(&place, &["--weights", weights, "--frames", "0,1", "--refine-steps", "1"])?;
            let refine = &page["network"]["refine"];
            let losses = [0, 1].map(|k| refine["losses"][k].as_f64().unwrap_or(f64::NAN));
            let fell = losses[1] < losses[0];
            let want = json!([u8::from(fell), !fell]);
            equals("steps and early stop", &json!([refine["steps"], refine["stopped_early"]]), &want)?;
            kept += u8::from(fell);
            undone += u8::from(!fell);
        }
    }
    if kept > 0 && undone > 0 { Ok(()) } else { Err(format!("{kept} steps kept, {undone} taken back").into()) }
}

/// No levels, no blocks, widths that no vector divides, patches of one: all of them run and change nothing.
fn sizes_at_the_edges() -> Outcome {
    let place = place()?;
    let stage =
        |channels: usize, heads: usize, blocks: usize| json!({"channels": channels, "heads": heads, "blocks": blocks});
    let edges = [
        ("/unet/encoder", json!([]), "/unet/decoder", json!([])),
        ("/background_unet/encoder", json!([]), "/background_unet/decoder", json!([])),
        ("/unet/encoder", json!([5, 3]), "/unet/decoder", json!([11, 13])),
        ("/policy/encoder", json!([stage(9, 3, 1)]), "/policy/decoder", json!([])),
        ("/policy/encoder", json!([stage(9, 3, 1), stage(10, 5, 0)]), "/policy/decoder", json!([stage(7, 7, 2)])),
        ("/policy/patch", json!(1), "/policy/curves", json!(["hilbert-trans"])),
        ("/policy/patch", json!(4096), "/policy/head_blocks", json!(0)),
    ];
    for (first, a, second, b) in edges {
        let mut config: Value = serde_json::from_str(SMALL)?;
        for (pointer, value) in [(first, a), (second, b)] {
            *config.pointer_mut(pointer).ok_or("no such field")? = value;
        }
        fs::write(place.path().join("edge.json"), config.to_string())?;
        let page = page(&place, &["--weights", "random:edge.json", "--frames", "0,1", "--density", "policy"])
            .map_err(|e| format!("{first}: {}", e.message().unwrap_or_default()))?;
        equals(first, &page["gaussians"]["final"], &page["gaussians"]["initial"])?;
    }
    Ok(())
}
