//! `lgs-infer --preset` and `--time-budget`: what runs, and what is said about it.

use std::ffi::OsStr;
use std::fs;
use std::path::Path;

use lgs_tests::places::repository;
use lgs_tests::process::{Finished, binary, run};
use lgs_tests::{Outcome, case, clips, metrics};
use libtest_mimic::{Failed, Trial};
use serde_json::{Value, json};

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("cli::plan::a_preset_is_the_recipe_that_was_measured", preset),
        case("cli::plan::flags_change_a_preset", flags_change_a_preset),
        case("cli::plan::ample_time_gives_the_best_and_its_flags_the_same_scene", ample_time),
        case("cli::plan::without_time_the_quickest_runs_and_says_so", no_time),
        case("cli::plan::a_budget_decides_alone_and_for_known_weights", refusals),
    ]
}

const COMMON: [&str; 8] = ["--image-size", "48x80", "--frames", "0..2", "--hold-out", "1", "--views", "none"];

fn start(place: &Path, out: &str, flags: &[&str]) -> Result<Finished, Failed> {
    let street = clips::street();
    let mut arguments = vec![street.as_os_str()];
    arguments.extend(["--out", out].iter().chain(&COMMON).chain(flags).map(|flag| OsStr::new(*flag)));
    Ok(run(&binary("lgs-infer")?, &arguments, place)?)
}

fn infer(place: &Path, out: &str, flags: &[&str]) -> Result<Value, Failed> {
    start(place, out, flags)?.expect_success()?;
    Ok(metrics::read(&place.join(out))?)
}

fn record() -> Result<Value, Failed> {
    Ok(serde_json::from_str(&fs::read_to_string(repository().join("models/presets.json"))?)?)
}

/// The recipe that a name means.
fn recipe(name: &str) -> Result<Value, Failed> {
    let record = record()?;
    let presets = record["presets"].as_array().ok_or("no presets")?;
    let preset = presets.iter().find(|preset| preset["name"] == name).ok_or("no such preset")?;
    let index = preset["recipe"].as_u64().and_then(|index| usize::try_from(index).ok()).ok_or("no index")?;
    Ok(record["recipes"][index]["recipe"].clone())
}

fn expect(what: &str, got: &Value, want: &Value) -> Outcome {
    if got == want { Ok(()) } else { Err(format!("{what}: got {got}, want {want}").into()) }
}

/// Compares the settings that a run says it had with a recipe.
fn expect_recipe(page: &Value, recipe: &Value) -> Outcome {
    let config = &page["config"];
    expect("background", &config["background"], &recipe["background"])?;
    let network = recipe["network"] == true;
    let of_network = |key: &str| if network { recipe[key].clone() } else { Value::Null };
    for key in ["query", "density", "refine_steps"] {
        expect(key, &config[key], &of_network(key))?;
    }
    let adam = recipe["adam_passes"].as_u64().unwrap_or(0);
    let refiner = match (adam, network) {
        (0, false) => Value::Null,
        (0, true) => json!("learned"),
        _ => json!(format!("adam:{adam}")),
    };
    expect("refine_with", &config["refine_with"], &refiner)?;
    let learned = network && recipe["refine_steps"] != 0;
    let search = if learned { recipe.get("line_search").cloned().unwrap_or(json!("auto")) } else { Value::Null };
    expect("line_search", &config["line_search"], &search)
}

fn preset() -> Outcome {
    let place = tempfile::tempdir()?;
    for name in ["fast", "balanced", "accurate"] {
        let page = infer(place.path(), name, &["--preset", name])?;
        expect_recipe(&page, &recipe(name)?)?;
        expect("no budget", &page["budget"], &Value::Null)?;
    }
    Ok(())
}

fn flags_change_a_preset() -> Outcome {
    let place = tempfile::tempdir()?;
    let flags = ["--preset", "accurate", "--background", "off", "--refine-with", "adam:1", "--pixel-stride", "3"];
    let config = &infer(place.path(), "out", &flags)?["config"];
    expect("background", &config["background"], &json!("off"))?;
    expect("refine_with", &config["refine_with"], &json!("adam:1"))?;
    expect("pixel_stride", &config["pixel_stride"], &json!("3"))
}

fn ample_time() -> Outcome {
    let place = tempfile::tempdir()?;
    let page = infer(place.path(), "budget", &["--time-budget", "100000"])?;
    let budget = &page["budget"];
    expect("it fits", &budget["fits"], &json!(true))?;
    expect("nothing is given up", &budget["gives_up_db"], &json!(0.0))?;
    expect_recipe(&page, &budget["recipe"])?;
    let finished = metrics::number(budget, &["finished_s"])?;
    let before = metrics::number(budget, &["before_s"])?;
    if !(before > 0.0 && finished > before) {
        return Err(format!("expected times in their order, found {budget}").into());
    }
    let recipe = &budget["recipe"];
    let (steps, adam) = (recipe["refine_steps"].to_string(), format!("adam:{}", recipe["adam_passes"]));
    let on_off = |key: &str| if recipe[key] == true { "on" } else { "off" };
    let text = |key: &str| recipe[key].as_str().unwrap_or_default();
    let mut flags = vec!["--background", text("background"), "--refine-with", &adam, "--query", on_off("query")];
    if recipe["network"] == true {
        let search = recipe["line_search"].as_str().unwrap_or("auto");
        flags.extend(["--refine-steps", &steps, "--line-search", search, "--density", text("density")]);
        let limit = if recipe["max_gaussians"].is_null() { "none" } else { text("max_gaussians") };
        flags.extend(["--max-gaussians", limit]);
    } else {
        flags.extend(["--weights", "none"]);
    }
    flags.extend(["--pixel-stride", recipe["pixel_stride"].as_str().unwrap_or("auto")]);
    infer(place.path(), "again", &flags)?;
    let scene = |out: &str| fs::read(place.path().join(out).join("scene.ply"));
    if scene("budget")? == scene("again")? { Ok(()) } else { Err(format!("{flags:?}: another scene").into()) }
}

fn no_time() -> Outcome {
    let place = tempfile::tempdir()?;
    let finished = start(place.path(), "out", &["--time-budget", "0.000001"])?;
    finished.expect_success()?;
    if !finished.stdout.contains("time budget") || !finished.stdout.contains("the quickest ran") {
        return Err(format!("nothing said of it: {}", finished.stdout).into());
    }
    let page = metrics::read(&place.path().join("out"))?;
    expect("it does not fit", &page["budget"]["fits"], &json!(false))?;
    let kept = page["network"]["refine"]["steps"].as_u64().unwrap_or(0);
    if kept <= 1 { Ok(()) } else { Err(format!("{kept} steps after the time was over").into()) }
}

fn refusals() -> Outcome {
    let place = tempfile::tempdir()?;
    for (flags, names) in [
        (["--time-budget", "3", "--preset", "fast"], ["--time-budget", "--preset"]),
        (["--time-budget", "3", "--refine-steps", "1"], ["--time-budget", "--refine-steps"]),
        (["--time-budget", "3", "--weights", "random:model.json"], ["--time-budget", "--weights"]),
        (["--time-budget", "0", "--json", "--spz"], ["--time-budget", "0"]),
    ] {
        start(place.path(), "out", &flags)?.expect_refusal(&names)?;
    }
    Ok(())
}
