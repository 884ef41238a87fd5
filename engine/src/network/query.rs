//! Cross-Time Point Query: features of the nearest primitives of other timestamps.
//!
//! # Formula
//! `fbar_i = mean_{j in N(i)} f_j`, `f'_i = f_i + W [f_i, fbar_i]`; `N(i)` are the K nearest with `t_j != t_i`. Fewer than K exist: the mean over
//! those. None: `f'_i = f_i`.
//!
//! # Source
//! The paper, section 3.3.

use std::sync::Arc;

use candle_core::{Result, Tensor};
use candle_nn::VarBuilder;

use super::linear::Linear;
use crate::ops::neighbour_mean::with_neighbour_mean;

/// The query.
#[derive(Clone, Debug)]
pub struct Query {
    projection: Linear,
}

impl Query {
    /// Makes or loads `projection.weight` `[width, 2 width]`.
    ///
    /// # Errors
    /// When the builder has no such tensor.
    pub fn new(width: usize, vb: &VarBuilder<'_>) -> Result<Self> {
        Ok(Self { projection: Linear::zero_without_bias(2 * width, width, &vb.pp("projection"))? })
    }

    /// The fused features of primitives, in the memory of `features`, which nobody else may hold, where no gradient is asked for.
    ///
    /// # Shapes
    /// `features` `[N, width]`, `neighbours` `[N * k]`; result `[N, width]`.
    ///
    /// # Gradient
    /// By features and weights; the neighbours are constant.
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn forward(&self, features: Tensor, neighbours: &Arc<Vec<u32>>, k: usize) -> Result<Tensor> {
        // Who has nobody to ask brings zeros, of which the projection makes zeros.
        let asked = with_neighbour_mean(&features, neighbours, k)?;
        self.projection.add_to(features, &asked)
    }

    /// The query as inference runs it.
    ///
    /// # Errors
    /// When a tensor cannot be read.
    pub fn fold(&self) -> Result<Self> {
        Ok(Self { projection: self.projection.fold()? })
    }
}
