//! Weights files: what is wrong is named, half precision is nearly the same, configs cannot ask for too much.

use std::path::Path;

use candle_core::{DType, Device, Tensor};
use lgs_engine::network::config::ModelConfig;
use lgs_engine::network::source::{CONFIG_KEY, config_of, load_model, random_model};
use lgs_engine::network::weights::WeightFile;
use lgs_engine::predict::{backbone, predict, query, scores};
use lgs_tests::compare::{close, relative, same_bits, widened};
use lgs_tests::random::Random;
use lgs_tests::weights::{Heads, SMALL, Weights};
use lgs_tests::{Outcome, case};
use libtest_mimic::{Failed, Trial};

use super::scene::scene;

const HEADS: Heads = Heads { residuals: 0.05, scores: 0.5 };

/// A change of a config's text, and what the refusal must hold.
struct Wrong {
    name: &'static str,
    from: &'static str,
    to: &'static str,
    names: &'static [&'static str],
}

const WRONG: [Wrong; 16] = [
    Wrong { name: "unknown_key", from: r#""name""#, to: r#""colour": 1, "name""#, names: &["config", "colour"] },
    Wrong {
        name: "unknown_nested_key",
        from: r#""stem": 8"#,
        to: r#""stem": 8, "bias": 1"#,
        names: &["config", "bias"],
    },
    Wrong { name: "missing_key", from: r#""voxel_size": 0.2,"#, to: "", names: &["config", "voxel_size"] },
    Wrong { name: "other_format", from: "lgs-model/1", to: "lgs-model/9", names: &["format", "lgs-model/9"] },
    Wrong { name: "no_json", from: "{", to: "[", names: &["config"] },
    Wrong { name: "text_for_a_number", from: "0.2", to: r#""thin""#, names: &["config", "thin"] },
    Wrong { name: "voxel_of_zero", from: "0.2", to: "0.0", names: &["voxel_size", "0.001"] },
    Wrong { name: "voxel_without_end", from: "0.2", to: "1e30", names: &["voxel_size"] },
    Wrong { name: "stem_of_zero", from: r#""stem": 8"#, to: r#""stem": 0"#, names: &["unet", "stem 0"] },
    Wrong { name: "wide_stem", from: r#""stem": 8"#, to: r#""stem": 99999999999"#, names: &["unet", "99999999999"] },
    Wrong { name: "negative_width", from: r#""stem": 8"#, to: r#""stem": -8"#, names: &["config", "-8"] },
    Wrong {
        name: "more_parameters_than_a_memory_holds",
        from: r#""encoder": [8, 16], "decoder": [16, 8]"#,
        to: r#""encoder": [4096, 4096], "decoder": [4096, 4096]"#,
        names: &["config", "at most 400,000,000 parameters"],
    },
    Wrong { name: "heads_that_do_not_divide", from: r#""heads": 2"#, to: r#""heads": 3"#, names: &["policy", "heads"] },
    Wrong { name: "patch_of_zero", from: r#""patch": 32"#, to: r#""patch": 0"#, names: &["policy.patch", "0"] },
    Wrong { name: "unknown_curve", from: r#""hilbert","#, to: r#""peano","#, names: &["config", "peano"] },
    Wrong {
        name: "no_neighbours",
        from: r#""neighbours": 4"#,
        to: r#""neighbours": 0"#,
        names: &["query.neighbours", "0"],
    },
];

pub(crate) fn cases() -> Vec<Trial> {
    let wrong = WRONG.iter().map(|wrong| case(format!("network::config::{}", wrong.name), || config_is_refused(wrong)));
    let others = [
        case("network::weights::every_fault_is_named_in_one_error", every_fault_is_named),
        case("network::weights::many_faults_stay_one_readable_line", many_faults),
        case("network::weights::truncated_at_any_length", truncated),
        case("network::weights::other_types_and_no_config_are_refused", other_types),
        case("network::weights::a_file_is_what_was_saved", a_file_is_what_was_saved),
        case("network::weights::bf16_is_nearly_the_same", || half_precision(DType::BF16, 0.05)),
        case("network::weights::f16_is_nearly_the_same", || half_precision(DType::F16, 0.01)),
    ];
    wrong.chain(others).collect()
}

fn failed(error: impl std::fmt::Display) -> Failed {
    error.to_string().into()
}

/// Fails unless `result` is an error of one line that holds every one of `names`.
fn refused<T>(result: Result<T, lgs_engine::error::EngineError>, names: &[&str]) -> Outcome {
    let Err(error) = result else { return Err("expected an error, found none".into()) };
    let text = error.to_string();
    let missing: Vec<_> = names.iter().filter(|name| !text.contains(**name)).collect();
    if missing.is_empty() && !text.contains('\n') { Ok(()) } else { Err(format!("no {missing:?} in: {text}").into()) }
}

/// As a config to draw weights for, to describe, and in a weights file.
fn config_is_refused(wrong: &Wrong) -> Outcome {
    if !SMALL.contains(wrong.from) {
        return Err(format!("the config has no {}", wrong.from).into());
    }
    let place = tempfile::tempdir()?;
    let [config, weights] = ["config.json", "weights.safetensors"].map(|name| place.path().join(name));
    let text = SMALL.replacen(wrong.from, wrong.to, 1);
    std::fs::write(&config, &text)?;
    let mut file = Weights::seeded(SMALL, 1, Heads::ZERO)?;
    file.config = text;
    file.write(&weights)?;
    let with = |file: &'static str| [wrong.names, &[file]].concat();
    refused(random_model(&config, 0), &with("config.json"))?;
    refused(config_of(&config), &with("config.json"))?;
    refused(load_model(&weights), &with("weights.safetensors"))
}

/// The error of a file's tensors against the small model.
fn check(weights: &Weights) -> Result<Result<(), lgs_engine::error::EngineError>, Failed> {
    let place = tempfile::tempdir()?;
    let path = place.path().join("spoilt.safetensors");
    weights.write(&path)?;
    Ok(load_model(&path).map(|_| ()))
}

fn every_fault_is_named() -> Outcome {
    let mut weights = Weights::seeded(SMALL, 1, HEADS)?;
    let zeros = |shape: &[usize]| Tensor::zeros(shape, DType::F32, &Device::Cpu).map_err(failed);
    let [gone, shaped, poisoned] =
        ["initial.unet.stem.0.conv.weight", "query.projection.weight", "policy.heads.add.last.bias"];
    weights.tensors.remove(gone).ok_or("no tensor to remove")?;
    weights.tensors.insert("refine.unet.stem.9.conv.weight".to_owned(), zeros(&[2])?);
    weights.tensors.insert(shaped.to_owned(), zeros(&[3, 5])?).ok_or("no tensor to reshape")?;
    let nan = Tensor::new(&[f32::NAN], &Device::Cpu).map_err(failed)?;
    weights.tensors.insert(poisoned.to_owned(), nan).ok_or("no tensor to poison")?;
    let names = [
        "spoilt.safetensors",
        &format!("1 missing: {gone}"),
        "1 not used by the model: refine.unet.stem.9.conv.weight",
        &format!("1 of another shape: {shaped} [3, 5] for [8, 16]"),
        &format!("1 not finite: {poisoned} NaN at index 0"),
    ];
    refused(check(&weights)?, &names)
}

fn many_faults() -> Outcome {
    let mut weights = Weights::seeded(SMALL, 1, HEADS)?;
    let count = weights.tensors.len();
    weights.tensors = weights.tensors.into_iter().map(|(name, tensor)| (format!("old.{name}"), tensor)).collect();
    let names = [
        &format!("{count} missing: "),
        &format!("{count} not used by the model: old."),
        &format!("and {} more", count - 16),
    ];
    refused(check(&weights)?, &names.map(String::as_str))
}

fn truncated() -> Outcome {
    let bytes = Weights::seeded(SMALL, 1, HEADS)?.bytes(DType::F32)?;
    let lengths = [0, 1, 7, 8, 9, 100, 2000, bytes.len() / 2, bytes.len() - 4, bytes.len() - 1];
    for length in lengths {
        let result = WeightFile::parse("cut.safetensors", &bytes[..length]);
        refused(result, &["cut.safetensors", "safetensors"]).map_err(|e| format!("{length} bytes: {e:?}"))?;
    }
    let mut long = bytes.clone();
    long[..8].copy_from_slice(&u64::MAX.to_le_bytes());
    refused(WeightFile::parse("cut.safetensors", &long), &["cut.safetensors"])
}

fn other_types() -> Outcome {
    let weights = Weights::seeded(SMALL, 1, HEADS)?;
    refused(WeightFile::parse("f64.safetensors", &weights.bytes(DType::F64)?), &["F64", "F16", "BF16"])?;
    let place = tempfile::tempdir()?;
    let path = place.path().join("bare.safetensors");
    safetensors::serialize_to_file(weights.tensors.iter(), None, &path).map_err(failed)?;
    refused(load_model(&path), &["bare.safetensors", CONFIG_KEY])
}

/// Residuals, velocities and scores of a scene: everything that weights say at once.
fn said_by(path: &Path) -> Result<Vec<f32>, Failed> {
    let model = load_model(path).map_err(failed)?.model;
    let mut set = scene(&mut Random::new(7));
    set.num_lidar -= 30;
    let start = set.clone();
    let mut features = backbone(&set, &model).map_err(failed)?;
    query(&mut features, &set, &model).map_err(failed)?;
    predict(&mut set, &features, &model).map_err(failed)?;
    let [prune, add] = scores(&features, &set, &model).map_err(failed)?.ok_or("the model has no policy")?;
    let moved = set.attributes.as_flattened().iter().zip(start.attributes.as_flattened()).map(|(a, b)| a - b);
    Ok(moved.chain(set.velocities.concat()).chain(prune).chain(add).collect())
}

fn a_file_is_what_was_saved() -> Outcome {
    let place = tempfile::tempdir()?;
    let path = place.path().join("weights.safetensors");
    let weights = Weights::seeded(SMALL, 4, HEADS)?;
    weights.write(&path)?;
    let config = ModelConfig::parse(SMALL, Path::new("small.json")).map_err(failed)?;
    let loaded = load_model(&path).map_err(failed)?;
    if loaded.model.config != config || loaded.digest.len() != 64 {
        return Err(format!("config {:?}, digest {:?}", loaded.model.config, loaded.digest).into());
    }
    let set = scene(&mut Random::new(7));
    let rows = |model| -> Result<Vec<f32>, Failed> {
        let features = backbone(&set, model).map_err(failed)?;
        features.flatten_all().and_then(|t| t.to_vec1()).map_err(failed)
    };
    same_bits("features", &rows(&loaded.model)?, &rows(&weights.model()?)?)
}

fn half_precision(dtype: DType, tolerance: f64) -> Outcome {
    let place = tempfile::tempdir()?;
    let [whole, half] = ["whole", "half"].map(|name| place.path().join(name));
    let weights = Weights::seeded(SMALL, 4, HEADS)?;
    weights.write(&whole)?;
    std::fs::write(&half, weights.bytes(dtype)?)?;
    let (want, got) = (said_by(&whole)?, said_by(&half)?);
    let largest = want.iter().fold(0.0_f32, |all, v| all.max(v.abs()));
    if want == got || largest < 0.1 {
        return Err(format!("nothing is compared: largest value {largest}").into());
    }
    close("what the weights say", &widened(&got), &widened(&want), relative(tolerance, tolerance))
}
