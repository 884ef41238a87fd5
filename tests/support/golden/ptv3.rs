//! Point Transformer V3 goldens: the reference implementation in f64, see `golden/README.md`.

use std::collections::HashMap;
use std::path::Path;

use candle_core::{Device, Tensor};
use lgs_engine::network::policy::{Cycle, PolicyConfig, StageConfig};
use lgs_engine::ops::sparse_conv::Sites;
use serde_json::Value;

use super::tensors::TensorFile;

/// Endings of the two files of a golden, before `.safetensors`.
pub const IO: &str = ".io";
const WEIGHTS: &str = ".weights";

/// One network with its input and what it makes of it.
#[derive(Debug)]
pub struct Ptv3Golden {
    /// Input, codes, orders and activations.
    pub io: TensorFile,
    /// Sizes; the heads, which the golden does not have, have no hidden blocks.
    pub config: PolicyConfig,
    /// Parameters by the reference's names, and zeros for the heads.
    pub weights: HashMap<String, Tensor>,
    /// Bits per axis of the codes.
    pub depth: u32,
    /// `[N]` voxel (batch, x, y, z) of every row of the input.
    pub voxels: Vec<[i32; 4]>,
    /// Occupied voxels of every stage, finest first.
    pub stages: Vec<Sites>,
    /// `[N]` site of every row of the input.
    pub site_of: Vec<u32>,
}

/// The golden of an input file; its weights lie beside it.
///
/// # Errors
/// A file is missing or not in the layout.
pub fn load(path: &Path) -> Result<Ptv3Golden, String> {
    let io = TensorFile::open(path)?;
    let weights = TensorFile::open(Path::new(&path.to_string_lossy().replace(IO, WEIGHTS)))?;
    let config = config(&io, &weights)?;
    let depth = io.metadata("depth")?.parse().map_err(|e| format!("depth: {e}"))?;
    let voxels = with_batch(&io.integers("in.grid_coord")?, &io.integers("in.offset")?)?;
    let (sites, site_of) = Sites::unique(&voxels).map_err(|e| e.to_string())?;
    let mut stages = vec![sites];
    for _ in 1..config.encoder.len() {
        let halved: Vec<[i32; 4]> = stages[stages.len() - 1].coords().iter().map(|&c| half(c)).collect();
        stages.push(Sites::unique(&halved).map_err(|e| e.to_string())?.0);
    }
    Ok(Ptv3Golden { weights: parameters(&weights, &config)?, io, config, depth, voxels, stages, site_of })
}

impl Ptv3Golden {
    /// The site of every row of an activation of a stage: `[rows]`.
    ///
    /// # Errors
    /// The golden has no such activation, or it has other voxels than the stage.
    pub fn sites_of_rows(&self, activation: &str, stage: usize) -> Result<Vec<usize>, String> {
        let name = format!("act.{activation}.grid_coord");
        let sites = self.stages[stage].coords();
        // Rows of a cloud lie together, and clouds follow each other.
        let ends = sites.chunk_by(|a, b| a[0] == b[0]).scan(0, |end, cloud| {
            *end += i64::try_from(cloud.len()).unwrap_or(i64::MAX);
            Some(*end)
        });
        let voxels = with_batch(&self.io.integers(&name)?, &ends.collect::<Vec<i64>>())?;
        let index: HashMap<[i32; 4], usize> = sites.iter().enumerate().map(|(i, &c)| (c, i)).collect();
        let found = voxels.iter().map(|v| index.get(v).copied().ok_or_else(|| format!("{name}: no voxel at {v:?}")));
        let found: Vec<usize> = found.collect::<Result<_, _>>()?;
        if found.len() == sites.len() { Ok(found) } else { Err(format!("{name}: want {} rows", sites.len())) }
    }
}

fn half([batch, x, y, z]: [i32; 4]) -> [i32; 4] {
    [batch, x >> 1, y >> 1, z >> 1]
}

/// Voxels with the index of their cloud in front; `ends` is the row after the last of each cloud.
fn with_batch(coords: &[i64], ends: &[i64]) -> Result<Vec<[i32; 4]>, String> {
    let voxel = |(row, [x, y, z]): (usize, &[i64; 3])| {
        let row = i64::try_from(row).map_err(|e| e.to_string())?;
        let batch = ends.iter().position(|&end| row < end).ok_or(format!("row {row} belongs to no cloud"))?;
        let small = |v: i64| i32::try_from(v).map_err(|e| format!("voxel {v}: {e}"));
        Ok([i32::try_from(batch).map_err(|e| e.to_string())?, small(*x)?, small(*y)?, small(*z)?])
    };
    coords.as_chunks::<3>().0.iter().enumerate().map(voxel).collect()
}

fn config(io: &TensorFile, weights: &TensorFile) -> Result<PolicyConfig, String> {
    let text = io.metadata("cfg")?;
    let sizes: Value = serde_json::from_str(&text).map_err(|e| format!("cfg: {e}"))?;
    let list = |key: &str| -> Result<Vec<usize>, String> {
        serde_json::from_value(sizes[key].clone()).map_err(|e| format!("cfg.{key}: {e}"))
    };
    let stages = |side: &str| -> Result<Vec<StageConfig>, String> {
        let [channels, heads, blocks] = ["channels", "num_head", "depths"].map(|what| list(&format!("{side}_{what}")));
        let parts = channels?.into_iter().zip(heads?).zip(blocks?);
        Ok(parts.map(|((channels, heads), blocks)| StageConfig { channels, heads, blocks }).collect())
    };
    let (encoder, patches) = (stages("enc")?, [list("enc_patch_size")?, list("dec_patch_size")?].concat());
    if list("stride")?.iter().any(|&s| s != 2) || patches.iter().any(|&p| p != patches[0]) {
        return Err(format!("cfg: expected strides of 2 and patches of one size, found {text}"));
    }
    let hidden = weights.get("w.enc.enc0.block0.mlp.0.fc1.bias")?.data.len();
    Ok(PolicyConfig {
        mlp_ratio: hidden / encoder[0].channels,
        encoder,
        decoder: stages("dec")?,
        patch: patches[0],
        curves: serde_json::from_value(sizes["order"].clone()).map_err(|e| format!("cfg.order: {e}"))?,
        cycle: Cycle::Restart,
        head_blocks: 0,
        head_width: 1,
    })
}

#[expect(clippy::cast_possible_truncation, reason = "the file holds f32 values")]
fn parameters(file: &TensorFile, config: &PolicyConfig) -> Result<HashMap<String, Tensor>, String> {
    let mut all = HashMap::new();
    for name in file.names()? {
        let values = file.get(&name)?;
        let data: Vec<f32> = values.data.iter().map(|&v| v as f32).collect();
        let tensor = Tensor::from_vec(data, values.shape, &Device::Cpu).map_err(|e| e.to_string())?;
        all.insert(name.trim_start_matches("w.").to_owned(), tensor);
    }
    let width = config.decoder.first().map_or(0, |stage| stage.channels);
    for head in ["prune", "add"] {
        for (part, shape) in [("weight", vec![1, width]), ("bias", vec![1])] {
            let zeros = Tensor::zeros(shape, candle_core::DType::F32, &Device::Cpu).map_err(|e| e.to_string())?;
            all.insert(format!("heads.{head}.last.{part}"), zeros);
        }
    }
    Ok(all)
}
