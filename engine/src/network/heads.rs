//! The heads of a pass: from the features of a Gaussian, and what only it knows, to its residuals.

use candle_core::{Result, Tensor};
use candle_nn::VarBuilder;
use rayon::prelude::*;

use super::buffers::Buffers;
use super::linear::{Linear, PackedLinear};
use crate::gaussians::NUM_ATTRIBUTES;
use crate::ops::sparse_conv::KernelMap;

/// What the heads of a pass predict.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outputs {
    /// Attribute residuals and velocities (or their residuals): the `LiDAR` branch.
    Moving,
    /// Attribute residuals: the background.
    Static,
}

/// What the heads of a pass read and predict.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HeadSizes {
    /// Width of the features.
    pub features: usize,
    /// Values of every Gaussian's own that a hidden layer reads beside them.
    pub own: usize,
    /// Width of the hidden layer; `None`: linear heads on the features.
    pub hidden: Option<usize>,
    /// What is predicted.
    pub outputs: Outputs,
}

/// The trainable heads.
#[derive(Clone, Debug)]
pub struct Heads {
    hidden: Option<Linear>,
    gaussian: Linear,
    velocity: Option<Linear>,
}

/// The heads as inference runs them.
#[derive(Clone, Debug)]
pub struct FoldedHeads {
    hidden: Option<PackedLinear>,
    gaussian: PackedLinear,
    velocity: Option<PackedLinear>,
    width: usize,
}

impl Heads {
    /// Makes or loads `gaussian` and, where things move, `velocity`, which start at zero, and, where there is a hidden layer, `hidden`.
    ///
    /// # Errors
    /// When the builder has no such tensor.
    pub fn new(sizes: &HeadSizes, vb: &VarBuilder<'_>) -> Result<Self> {
        let HeadSizes { features, own, hidden, outputs } = *sizes;
        let layer = |width| Linear::new(features + own, width, &vb.pp("hidden"));
        let width = hidden.map_or(features, |hidden| hidden + own);
        let head = |name: &str, cout: usize| Linear::zero(width, cout, &vb.pp(name));
        Ok(Self {
            hidden: hidden.map(layer).transpose()?,
            gaussian: head("gaussian", NUM_ATTRIBUTES)?,
            velocity: (outputs == Outputs::Moving).then(|| head("velocity", 3)).transpose()?,
        })
    }

    /// Whether a hidden layer reads each Gaussian's own state.
    pub const fn read_own(&self) -> bool {
        self.hidden.is_some()
    }

    /// The outputs, differentiable: `[N, 17]`, or `[N, 14]` for what does not move.
    ///
    /// # Shapes
    /// `features` `[N, width]`, `own` `[N, own]`, which heads without a hidden layer do not read.
    ///
    /// # Formula
    /// `W [relu(H [features, own] + h), own] + b`, or `W features + b`.
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn forward(&self, features: &Tensor, own: &Tensor) -> Result<Tensor> {
        let hidden = match &self.hidden {
            Some(layer) => Tensor::cat(&[&layer.forward(&Tensor::cat(&[features, own], 1)?)?.relu()?, own], 1)?,
            None => features.clone(),
        };
        let gaussian = self.gaussian.forward(&hidden)?;
        match &self.velocity {
            Some(head) => Tensor::cat(&[gaussian, head.forward(&hidden)?], 1),
            None => Ok(gaussian),
        }
    }

    /// The form that inference runs.
    ///
    /// # Errors
    /// When a tensor cannot be read.
    pub fn fold(&self) -> Result<FoldedHeads> {
        let gaussian = self.gaussian.pack()?;
        let velocity = self.velocity.as_ref().map(Linear::pack).transpose()?;
        let width = gaussian.cout() + velocity.as_ref().map_or(0, PackedLinear::cout);
        Ok(FoldedHeads { hidden: self.hidden.as_ref().map(Linear::pack).transpose()?, gaussian, velocity, width })
    }
}

impl FoldedHeads {
    /// Number of outputs.
    pub const fn num_outputs(&self) -> usize {
        self.width
    }

    /// Whether a hidden layer reads each Gaussian's own state: else the outputs are the same for equal features.
    pub const fn read_own(&self) -> bool {
        self.hidden.is_some()
    }

    /// The outputs `[rows, outputs]`, a buffer of `buffers`.
    ///
    /// # Shapes
    /// As [`Heads::forward`].
    pub fn forward(&self, features: &[f32], own: &[f32], rows: usize, buffers: &mut Buffers) -> Vec<f32> {
        let map = KernelMap::identity(rows);
        let Some(layer) = &self.hidden else { return self.linear(features, &map, buffers) };
        let joined = join(features, own, rows, buffers);
        let mut hidden = buffers.take(rows * layer.cout());
        layer.forward_relu(&joined, &map, &mut hidden);
        let read = join(&hidden, own, rows, buffers);
        let outputs = self.linear(&read, &map, buffers);
        [joined, hidden, read].into_iter().for_each(|buffer| buffers.give(buffer));
        outputs
    }

    fn linear(&self, features: &[f32], map: &KernelMap, buffers: &mut Buffers) -> Vec<f32> {
        let rows = map.num_outputs();
        let mut gaussian = buffers.take(rows * self.gaussian.cout());
        self.gaussian.forward(features, map, None, &mut gaussian);
        let Some(head) = &self.velocity else { return gaussian };
        let mut velocity = buffers.take(rows * head.cout());
        head.forward(features, map, None, &mut velocity);
        let joined = join(&gaussian, &velocity, rows, buffers);
        buffers.give(gaussian);
        buffers.give(velocity);
        joined
    }
}

/// The rows of both one after the other, a buffer of `buffers`.
fn join(first: &[f32], second: &[f32], rows: usize, buffers: &mut Buffers) -> Vec<f32> {
    let [a, b] = [first, second].map(|values| values.len() / rows.max(1));
    let mut joined = buffers.take(first.len() + second.len());
    if a > 0 && b > 0 {
        let parts = first.par_chunks_exact(a).zip(second.par_chunks_exact(b));
        joined.par_chunks_exact_mut(a + b).zip(parts).with_min_len(1024).for_each(|(row, (first, second))| {
            row[..a].copy_from_slice(first);
            row[a..].copy_from_slice(second);
        });
    }
    joined
}
