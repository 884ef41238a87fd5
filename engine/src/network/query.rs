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

use super::buffers::Buffers;
use super::linear::{Linear, PackedLinear};
use crate::ops::knn::NO_NEIGHBOUR;
use crate::ops::neighbour_mean::{neighbour_mean, neighbour_mean_into};
use crate::ops::sparse_conv::KernelMap;

/// The trainable query.
#[derive(Clone, Debug)]
pub struct Query {
    projection: Linear,
    width: usize,
}

/// The query as inference runs it.
#[derive(Clone, Debug)]
pub struct PackedQuery {
    projection: PackedLinear,
    width: usize,
}

impl Query {
    /// Makes or loads `projection.weight` `[width, 2 width]`.
    ///
    /// # Errors
    /// When the builder has no such tensor.
    pub fn new(width: usize, vb: &VarBuilder<'_>) -> Result<Self> {
        Ok(Self { projection: Linear::zero_without_bias(2 * width, width, &vb.pp("projection"))?, width })
    }

    /// The fused features, differentiable.
    ///
    /// # Shapes
    /// `features` `[N, width]`, `neighbours` `[N * k]`; result `[N, width]`.
    ///
    /// # Gradient
    /// By features and weights; the neighbours are constant.
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn forward(&self, features: &Tensor, neighbours: &Arc<Vec<u32>>, k: usize) -> Result<Tensor> {
        let mean = neighbour_mean(features, neighbours, k)?;
        let update = self.projection.forward(&Tensor::cat(&[features, &mean], 1)?)?;
        let asked: Vec<f32> = neighbours
            .chunks_exact(k.max(1))
            .map(|n| f32::from(u8::from(n.iter().any(|&j| j != NO_NEIGHBOUR))))
            .collect();
        let asked = Tensor::from_vec(asked, (features.dim(0)?, 1), features.device())?;
        features + update.broadcast_mul(&asked)?
    }

    /// The form that inference runs.
    ///
    /// # Errors
    /// When a tensor cannot be read.
    pub fn pack(&self) -> Result<PackedQuery> {
        Ok(PackedQuery { projection: self.projection.pack()?, width: self.width })
    }
}

impl PackedQuery {
    /// The fused features.
    ///
    /// # Shapes
    /// As [`Query::forward`]; the result is a buffer of `buffers`.
    pub fn forward(&self, features: &[f32], neighbours: &[u32], k: usize, buffers: &mut Buffers) -> Vec<f32> {
        use rayon::prelude::*;
        let width = self.width;
        let rows = features.len() / width.max(1);
        let mut mean = buffers.take(features.len());
        neighbour_mean_into(features, neighbours, k, width, &mut mean);
        let mut joined = buffers.take(2 * features.len());
        let parts = features.par_chunks_exact(width).zip(mean.par_chunks_exact(width));
        joined.par_chunks_exact_mut(2 * width).zip(parts).with_min_len(1024).for_each(|(row, (f, m))| {
            row[..width].copy_from_slice(f);
            row[width..].copy_from_slice(m);
        });
        let mut out = mean;
        self.projection.forward(&joined, &KernelMap::identity(rows), Some(features), &mut out);
        buffers.give(joined);
        // A primitive that nobody else can tell anything keeps its features.
        let rows = out.par_chunks_exact_mut(width).zip(features.par_chunks_exact(width));
        rows.zip(neighbours.par_chunks_exact(k.max(1))).with_min_len(1024).for_each(|((out, f), neighbours)| {
            if neighbours.iter().all(|&j| j == NO_NEIGHBOUR) {
                out.copy_from_slice(f);
            }
        });
        out
    }
}
