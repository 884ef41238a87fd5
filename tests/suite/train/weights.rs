//! Weights files that training writes.

use lgs_engine::network::source::load_model;
use lgs_tests::{Outcome, case};
use lgs_train::stages::variables::Variables;
use lgs_train::stages::weights::{Precision, StartWeights, write_weights};
use libtest_mimic::Trial;

use super::fixtures::{config_with_policy, failed};

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("train::weights::copies_load_and_keep_their_digits", copies),
        case("train::weights::what_16_bits_do_not_hold_is_refused", too_large),
    ]
}

fn copies() -> Outcome {
    let place = tempfile::tempdir()?;
    let variables = Variables::seeded(&config_with_policy(), 7).map_err(failed)?;
    let wanted = variables.values().map_err(failed)?;
    let mut sizes = Vec::new();
    for (name, precision, error) in [("full", Precision::Full, 0.0), ("half", Precision::Half, 1.0 / 2048.0)] {
        let file = place.path().join(name);
        write_weights(&variables, precision, &file).map_err(failed)?;
        load_model(&file).map_err(failed)?;
        let found = StartWeights::read(&file).map_err(failed)?.variables.values().map_err(failed)?;
        for (want, got) in wanted.iter().flatten().zip(found.iter().flatten()) {
            if (want - got).abs() > error * want.abs() + 6e-8 * f32::from(u8::from(error > 0.0)) {
                return Err(format!("{name}: expected {want}, found {got}").into());
            }
        }
        sizes.push(std::fs::metadata(&file)?.len());
    }
    if 10 * sizes[1] < 7 * sizes[0] { Ok(()) } else { Err(format!("sizes {sizes:?}").into()) }
}

fn too_large() -> Outcome {
    let place = tempfile::tempdir()?;
    let variables = Variables::seeded(&config_with_policy(), 7).map_err(failed)?;
    let k = variables.specs().iter().position(|spec| spec.shape.len() > 1).ok_or("no weights")?;
    let mut values = variables.values().map_err(failed)?.swap_remove(k);
    values[0] = 1e6;
    variables.set(k, values).map_err(failed)?;
    let file = place.path().join("half");
    match write_weights(&variables, Precision::Half, &file) {
        Err(error) if error.to_string().contains("values that 16 bits hold, found 1000000") && !file.exists() => Ok(()),
        other => Err(format!("expected a refusal, found {other:?}").into()),
    }
}
