//! `lgs-infer --describe`: the table of a config's and of a weights file's model.

use std::fs;
use std::path::Path;

use lgs_engine::network::config::ModelConfig;
use lgs_engine::network::model::Model;
use lgs_tests::process::{binary, run};
use lgs_tests::weights::{Heads, SMALL, Weights};
use lgs_tests::{Outcome, case, places};
use libtest_mimic::{Failed, Trial};
use serde_json::Value;

/// The paper's four models: parts of `full.json` to take out, and parameters in 10,000.
const PAPER: [(&str, &[&str], usize); 4] = [
    ("neither", &["query", "policy"], 8696),
    ("query", &["policy"], 8698),
    ("policy", &["query"], 9565),
    ("both", &[], 9567),
];

pub(crate) fn cases() -> Vec<Trial> {
    let paper = PAPER.iter().map(|(name, without, want)| {
        case(format!("cli::describe::full_as_in_the_paper::{name}"), || full_size(without, *want))
    });
    let others = [
        case("cli::describe::a_weights_file_says_what_its_config_says", weights_file),
        case("cli::describe::refusals", refusals),
    ];
    paper.chain(others).collect()
}

fn describe(file: &Path) -> Result<String, Failed> {
    let finished = run(&binary("lgs-infer")?, &["--describe".as_ref(), file.as_os_str()], places::repository())?;
    finished.expect_success()?;
    Ok(finished.stdout)
}

/// The number at the end of a line, whose digits must stand in threes.
fn number(line: &str) -> Result<usize, Failed> {
    let text = line.split_whitespace().last().unwrap_or_default();
    let groups: Vec<&str> = text.split(',').collect();
    let sound = groups[0].len() <= 3 && groups[1..].iter().all(|group| group.len() == 3);
    let value = groups.concat().parse().ok().filter(|_| sound);
    value.ok_or_else(|| format!("no number with thousands separators: {line:?}").into())
}

/// The total, which must be the sum of the modules' lines.
fn total(table: &str) -> Result<usize, Failed> {
    let mut lines = table.lines().skip_while(|line| !line.starts_with("module")).skip(1);
    let mut sum = 0;
    for line in lines.by_ref() {
        let value = number(line)?;
        if line.starts_with("total") {
            return if value == sum { Ok(sum) } else { Err(format!("total {value}, but the lines give {sum}").into()) };
        }
        sum += value;
    }
    Err(format!("no total in {table}").into())
}

fn full_size(without: &[&str], want: usize) -> Outcome {
    let place = tempfile::tempdir()?;
    let text = fs::read_to_string(places::repository().join("models/full.json"))?;
    let mut config: Value = serde_json::from_str(&text)?;
    for part in without {
        config[*part] = Value::Null;
    }
    let path = place.path().join("model.json");
    fs::write(&path, config.to_string())?;
    let table = describe(&path)?;
    let got = total(&table)?;
    let named = ["initial", "refine", "background", "query", "policy"].iter().filter(|part| !without.contains(part));
    if let Some(part) = named.clone().find(|part| !table.lines().any(|line| line.starts_with(**part))) {
        return Err(format!("no module of {part} in {table}").into());
    }
    let rounded = (got + 5_000) / 10_000;
    if rounded == want { Ok(()) } else { Err(format!("{got} parameters, want {want} times 10,000").into()) }
}

fn weights_file() -> Outcome {
    let place = tempfile::tempdir()?;
    let [config, weights] = ["small.json", "small.safetensors"].map(|name| place.path().join(name));
    fs::write(&config, SMALL)?;
    Weights::seeded(SMALL, 1, Heads::ZERO)?.write(&weights)?;
    let (of_config, of_weights) = (describe(&config)?, describe(&weights)?);
    let parsed = ModelConfig::parse(SMALL, &config).map_err(|e| e.to_string())?;
    let tensors = Model::tensors(&parsed).map_err(|e| e.to_string())?;
    let want: usize = tensors.iter().filter(|t| t.is_parameter()).map(|t| t.len()).sum();
    if of_config != of_weights || total(&of_config)? != want {
        return Err(format!("want {want} parameters and the same twice, got\n{of_config}\n{of_weights}").into());
    }
    Ok(())
}

fn refusals() -> Outcome {
    let place = tempfile::tempdir()?;
    let garbage = place.path().join("garbage");
    fs::write(&garbage, [0_u8, 159, 146, 150])?;
    for (file, names) in [("garbage", ["garbage"]), ("nowhere.json", ["nowhere.json"])] {
        run(&binary("lgs-infer")?, &["--describe", file], place.path())?.expect_refusal(&names)?;
    }
    let both = ["--describe", "garbage", "clip"];
    run(&binary("lgs-infer")?, &both, place.path())?.expect_refusal(&["--describe"])
}
