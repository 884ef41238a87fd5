//! The layers between stages: the stem, the way down and the way up.

use std::sync::Arc;

use candle_core::{Result, Tensor};
use candle_nn::{Init, VarBuilder};

use crate::network::conv::{ConvNorm, ConvSize};
use crate::network::linear::Linear;
use crate::network::norm::BatchNorm;
use crate::ops::activation::gelu_owned;
use crate::ops::segment::{Segments, max_pool};
use crate::ops::sparse_conv::KernelMap;

/// Edge of the stem's kernel.
const STEM_KERNEL: usize = 5;
/// Added to the variance of a column (Point Transformer V3's choice).
const BATCH_EPS: f64 = 1e-3;

/// A 5^3 convolution without bias, normalisation, GELU.
#[derive(Clone, Debug)]
pub(super) struct Stem(ConvNorm);

/// A dense layer, the largest values of each coarse voxel, normalisation, GELU.
#[derive(Clone, Debug)]
pub(super) struct Down {
    linear: Linear,
    /// Stands behind the maximum, so it is never part of the layer.
    norm: BatchNorm,
}

/// Dense layer, normalisation and GELU of the coarse voxels and of the skipped features.
#[derive(Clone, Debug)]
pub(super) struct Up {
    coarse: LinearNorm,
    skip: LinearNorm,
}

#[derive(Clone, Debug)]
enum LinearNorm {
    Parts { linear: Linear, norm: BatchNorm },
    Folded(Linear),
}

impl Stem {
    pub(super) fn new(inputs: usize, channels: usize, vb: &VarBuilder<'_>) -> Result<Self> {
        let size = ConvSize { kernel: STEM_KERNEL, cin: inputs, cout: channels };
        let reach = 1.0 / size.fan_in().sqrt();
        Ok(Self(ConvNorm::new(size, Init::Uniform { lo: -reach, up: reach }, BATCH_EPS, &vb.pp("stem"))?))
    }

    pub(super) fn forward(&self, x: &Tensor, map: &Arc<KernelMap>, train: bool) -> Result<Tensor> {
        gelu_owned(self.0.forward(x, None, map, train, false)?)
    }

    pub(super) fn fold(&self) -> Result<Self> {
        Ok(Self(self.0.fold()?))
    }
}

impl Down {
    pub(super) fn new(inputs: usize, channels: usize, vb: &VarBuilder<'_>) -> Result<Self> {
        Ok(Self {
            linear: Linear::new(inputs, channels, &vb.pp("proj"))?,
            norm: BatchNorm::new(channels, BATCH_EPS, &vb.pp("norm.0"))?,
        })
    }

    pub(super) fn forward(&self, x: &Tensor, parents: &Arc<Segments>, train: bool) -> Result<Tensor> {
        gelu_owned(self.norm.forward(&max_pool(&self.linear.forward(x)?, parents)?, train)?)
    }

    pub(super) fn fold(&self) -> Result<Self> {
        Ok(Self { linear: self.linear.fold()?, norm: self.norm.fold()? })
    }
}

impl Up {
    pub(super) fn new(inputs: usize, skipped: usize, channels: usize, vb: &VarBuilder<'_>) -> Result<Self> {
        let part = |inputs, name: &str| LinearNorm::new(inputs, channels, &vb.pp(name));
        Ok(Self { coarse: part(inputs, "proj")?, skip: part(skipped, "proj_skip")? })
    }

    /// The parts of the sum: of the fine voxels and of the coarse ones. The convolution behind sees the former only: so the reference has it.
    pub(super) fn forward(&self, coarse: &Tensor, skip: &Tensor, train: bool) -> Result<[Tensor; 2]> {
        Ok([self.skip.forward(skip, train)?, self.coarse.forward(coarse, train)?])
    }

    pub(super) fn fold(&self) -> Result<Self> {
        Ok(Self { coarse: self.coarse.fold()?, skip: self.skip.fold()? })
    }
}

impl LinearNorm {
    fn new(inputs: usize, channels: usize, vb: &VarBuilder<'_>) -> Result<Self> {
        let linear = Linear::new(inputs, channels, &vb.pp("0"))?;
        Ok(Self::Parts { linear, norm: BatchNorm::new(channels, BATCH_EPS, &vb.pp("1"))? })
    }

    fn forward(&self, x: &Tensor, train: bool) -> Result<Tensor> {
        let normalised = match self {
            Self::Folded(linear) => return gelu_owned(linear.forward(x)?),
            Self::Parts { linear, norm } if train => norm.by_batch(&linear.forward(x)?)?,
            Self::Parts { .. } => None,
        };
        match normalised {
            Some(normalised) => gelu_owned(normalised),
            None => gelu_owned(self.merged()?.forward(x)?),
        }
    }

    /// The layer with the running statistics in its weights.
    fn merged(&self) -> Result<Linear> {
        match self {
            Self::Parts { linear, norm } => linear.then_affine(&norm.affine()?),
            Self::Folded(linear) => Ok(linear.clone()),
        }
    }

    fn fold(&self) -> Result<Self> {
        Ok(Self::Folded(self.merged()?.fold()?))
    }
}
