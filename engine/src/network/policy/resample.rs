//! The layers between stages: the stem, the way down and the way up.

use std::sync::Arc;

use candle_core::{Result, Tensor};
use candle_nn::{Init, VarBuilder};

use super::layers::{BatchNorm, Linear};
use crate::ops::activation::gelu;
use crate::ops::segment::{Segments, gather, max_pool};
use crate::ops::sparse_conv::{KernelMap, convolve};

/// Edge of the stem's kernel.
pub(super) const STEM_KERNEL: usize = 5;

/// A 5^3 convolution without bias, normalisation, GELU.
#[derive(Clone, Debug)]
pub(super) struct Stem {
    pub(super) weight: Tensor,
    pub(super) norm: BatchNorm,
}

/// A dense layer, the largest values of each coarse voxel, normalisation, GELU.
#[derive(Clone, Debug)]
pub(super) struct Down {
    pub(super) linear: Linear,
    pub(super) norm: BatchNorm,
}

/// Dense layer, normalisation and GELU of the coarse voxels and of the skipped features; their sum.
#[derive(Clone, Debug)]
pub(super) struct Up {
    pub(super) coarse: (Linear, BatchNorm),
    pub(super) skip: (Linear, BatchNorm),
}

impl Stem {
    pub(super) fn new(inputs: usize, channels: usize, vb: &VarBuilder<'_>) -> Result<Self> {
        let reach = 1.0 / ((STEM_KERNEL.pow(3) * inputs) as f64).sqrt();
        let init = Init::Uniform { lo: -reach, up: reach };
        let shape = (channels, STEM_KERNEL, STEM_KERNEL, STEM_KERNEL, inputs);
        Ok(Self {
            weight: vb.pp("stem.conv").get_with_hints(shape, "weight", init)?,
            norm: BatchNorm::new(channels, &vb.pp("stem.norm"))?,
        })
    }

    pub(super) fn forward(&self, x: &Tensor, map: &Arc<KernelMap>, train: bool) -> Result<Tensor> {
        gelu(&self.norm.forward(&convolve(x, &self.weight, map)?, train)?)
    }
}

impl Down {
    pub(super) fn new(inputs: usize, channels: usize, vb: &VarBuilder<'_>) -> Result<Self> {
        Ok(Self {
            linear: Linear::new(inputs, channels, &vb.pp("proj"))?,
            norm: BatchNorm::new(channels, &vb.pp("norm.0"))?,
        })
    }

    pub(super) fn forward(&self, x: &Tensor, parents: &Arc<Segments>, train: bool) -> Result<Tensor> {
        gelu(&self.norm.forward(&max_pool(&self.linear.forward(x)?, parents)?, train)?)
    }
}

impl Up {
    pub(super) fn new(inputs: usize, skipped: usize, channels: usize, vb: &VarBuilder<'_>) -> Result<Self> {
        let branch = |inputs, name: &str| {
            let vb = vb.pp(name);
            Ok::<_, candle_core::Error>((
                Linear::new(inputs, channels, &vb.pp("0"))?,
                BatchNorm::new(channels, &vb.pp("1"))?,
            ))
        };
        Ok(Self { coarse: branch(inputs, "proj")?, skip: branch(skipped, "proj_skip")? })
    }

    /// The sum, and the skipped features' part of it, which is all that the convolution behind sees: so the reference has it.
    pub(super) fn forward(
        &self,
        x: &Tensor,
        skip: &Tensor,
        parents: &Arc<Segments>,
        train: bool,
    ) -> Result<[Tensor; 2]> {
        let branch =
            |(linear, norm): &(Linear, BatchNorm), x: &Tensor| gelu(&norm.forward(&linear.forward(x)?, train)?);
        let skip = branch(&self.skip, skip)?;
        let sum = (&skip + gather(&branch(&self.coarse, x)?, parents)?)?;
        Ok([sum, skip])
    }
}
