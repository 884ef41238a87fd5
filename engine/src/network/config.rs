//! The size of a model, as one JSON page.

use std::path::Path;

use lgs_formats::error::FormatError;
use serde::{Deserialize, Serialize};

use super::policy::PolicyConfig;
use super::unet::UNetConfig;
use crate::error::Result;

/// The value of `format` in a model's config.
pub const MODEL_FORMAT: &str = "lgs-model/1";

/// Sizes and switches of a model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelConfig {
    /// [`MODEL_FORMAT`].
    pub format: String,
    /// Name of the size.
    pub name: String,
    /// Edge of a voxel of the finest level, metres.
    pub voxel_size: f64,
    /// Edge of a voxel of the background's finest level, metres: its Gaussians are far and sparse.
    pub background_voxel_size: f64,
    /// What tells a refinement step how the rendered views differ from the input views.
    #[serde(default, skip_serializing_if = "Guidance::is_gradient")]
    pub guidance: Guidance,
    /// How far a refinement step goes.
    #[serde(default, skip_serializing_if = "StepLength::is_learned")]
    pub step_length: StepLength,
    /// Width of a hidden layer of the heads, which reads what is each Gaussian's own beside the features of its voxel; absent: linear heads
    /// on the features.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub head_width: Option<usize>,
    /// U-Nets of the `LiDAR` branch, first prediction and refinement.
    pub unet: UNetConfig,
    /// U-Nets of the background branch.
    pub background_unet: UNetConfig,
    /// Cross-Time Point Query; absent: not part of the model.
    pub query: Option<QueryConfig>,
    /// Gaussian Densify Policy; absent: not part of the model.
    pub policy: Option<PolicyConfig>,
}

/// What tells a refinement step how the rendered views differ from the input views.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Guidance {
    /// The gradient of the loss, every dimension at its own scale in the scene.
    #[default]
    Gradient,
    /// The errors that a Gaussian sees on average, at their own scale: how far off it is, not only in which direction.
    Residual,
}

impl Guidance {
    #[expect(clippy::trivially_copy_pass_by_ref, reason = "the signature that serde asks for")]
    fn is_gradient(&self) -> bool {
        *self == Self::Gradient
    }
}

/// How far a refinement step goes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StepLength {
    /// As far as the network says.
    #[default]
    Learned,
    /// Every Gaussian as far along the network's step as the rendered views say once it is made: one more rendering of each.
    Local,
}

impl StepLength {
    #[expect(clippy::trivially_copy_pass_by_ref, reason = "the signature that serde asks for")]
    fn is_learned(&self) -> bool {
        *self == Self::Learned
    }
}

/// Size of the Cross-Time Point Query.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QueryConfig {
    /// Neighbours of other timestamps that a primitive asks.
    pub neighbours: usize,
}

impl ModelConfig {
    /// The config of a JSON file.
    ///
    /// # Errors
    /// When the file cannot be read or is no valid config.
    pub fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(|source| FormatError::io(path, "read", source))?;
        Self::parse(&text, path)
    }

    /// The config of a JSON text; `path` names its origin in errors.
    ///
    /// # Errors
    /// When the text is no valid config.
    pub fn parse(text: &str, path: &Path) -> Result<Self> {
        let config: Self = serde_json::from_str(text)
            .map_err(|error| FormatError::invalid(path, "config", MODEL_FORMAT, error.to_string()))?;
        if let Some((field, expected, found)) = config.fault() {
            return Err(FormatError::invalid(path, field, expected, found).into());
        }
        Ok(config)
    }

    fn fault(&self) -> Option<(&'static str, String, String)> {
        if self.format != MODEL_FORMAT {
            return Some(("format", MODEL_FORMAT.to_owned(), self.format.clone()));
        }
        for (field, size) in [("voxel_size", self.voxel_size), ("background_voxel_size", self.background_voxel_size)] {
            if !(1e-3..=1e3).contains(&size) {
                return Some((field, "metres from 0.001 to 1000".to_owned(), size.to_string()));
            }
        }
        for (field, unet) in [("unet", &self.unet), ("background_unet", &self.background_unet)] {
            let widths = || unet.encoder.iter().chain(&unet.decoder).chain([&unet.stem]);
            if unet.encoder.len() != unet.decoder.len()
                || unet.encoder.len() > 8
                || !widths().all(|w| (1..=4096).contains(w))
            {
                let found = format!("stem {}, encoder {:?}, decoder {:?}", unet.stem, unet.encoder, unet.decoder);
                return Some((
                    field,
                    "as many decoder as encoder levels (at most 8), widths 1 to 4096".to_owned(),
                    found,
                ));
            }
        }
        if let Some(width) = self.head_width.filter(|width| !(1..=4096).contains(width)) {
            return Some(("head_width", "1 to 4096".to_owned(), width.to_string()));
        }
        if let Some(fault) = self.policy.as_ref().and_then(PolicyConfig::fault) {
            return Some(fault);
        }
        match &self.query {
            Some(query) if !(1..=64).contains(&query.neighbours) => {
                Some(("query.neighbours", "1 to 64".to_owned(), query.neighbours.to_string()))
            }
            _ => None,
        }
    }
}
