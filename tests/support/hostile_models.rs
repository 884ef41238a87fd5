//! Readers of networks, in the way of [`crate::hostile`].

use std::collections::HashMap;
use std::fs;
use std::path::Path;

use lgs_engine::network::config::ModelConfig;
use lgs_engine::network::model::Model;
use lgs_engine::network::source::{CONFIG_KEY, config_of, load_model};
use safetensors::tensor::{Dtype, TensorView};

use crate::hostile::Target;

/// The smallest model that has every part of a backbone.
const CONFIG: &str = r#"{ "format": "lgs-model/1", "name": "least", "voxel_size": 0.2, "background_voxel_size": 1.0,
  "unet": { "stem": 1, "encoder": [1], "decoder": [1] }, "background_unet": { "stem": 1, "encoder": [1], "decoder": [1] },
  "query": { "neighbours": 2 }, "policy": null }"#;

/// Both targets.
pub const TARGETS: [Target; 2] = [
    Target { name: "weights", fill: fill_weights, read: read_weights },
    Target { name: "config", fill: fill_config, read: read_config },
];

type Said = Result<(), String>;

fn said(error: impl std::fmt::Display) -> String {
    error.to_string()
}

fn fill_weights(_: &Path, to: &Path) -> Said {
    let config = ModelConfig::parse(CONFIG, Path::new("config")).map_err(said)?;
    let specs = Model::tensors(&config).map_err(said)?;
    let values: Vec<Vec<u8>> = specs.iter().map(|spec| 0.5_f32.to_le_bytes().repeat(spec.len())).collect();
    let views = specs.iter().zip(&values).map(|(spec, values)| {
        TensorView::new(Dtype::F32, spec.shape.clone(), values).map(|view| (spec.name.as_str(), view))
    });
    let views = views.collect::<Result<Vec<_>, _>>().map_err(said)?;
    let metadata = HashMap::from([(CONFIG_KEY.to_owned(), CONFIG.to_owned())]);
    let bytes = safetensors::serialize(views, Some(metadata)).map_err(said)?;
    fs::write(to.join("w.safetensors"), bytes).map_err(said)
}

fn read_weights(folder: &Path) -> Said {
    load_model(&folder.join("w.safetensors")).map(drop).map_err(said)
}

fn fill_config(repository: &Path, to: &Path) -> Said {
    fs::write(to.join("least.json"), CONFIG).map_err(said)?;
    for name in ["tiny.json", "full.json"] {
        fs::copy(repository.join("models").join(name), to.join(name)).map_err(said)?;
    }
    Ok(())
}

fn read_config(folder: &Path) -> Said {
    ["least.json", "tiny.json", "full.json"]
        .iter()
        .try_for_each(|name| config_of(&folder.join(name)).map(drop).map_err(said))
}
