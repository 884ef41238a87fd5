//! A pass: one U-Net and the linear heads on its features.

use std::sync::Arc;

use candle_core::{Result, Tensor};
use candle_nn::VarBuilder;

use super::buffers::Buffers;
use super::heads::{FoldedHeads, HeadSizes, Heads};
use super::levels::Levels;
use super::unet::{FoldedUNet, UNet, UNetConfig};
use crate::ops::segment::{self, Segments};

/// The trainable pass.
#[derive(Clone, Debug)]
pub struct Pass {
    unet: UNet,
    heads: Heads,
}

/// The pass as inference runs it.
#[derive(Clone, Debug)]
pub struct FoldedPass {
    unet: FoldedUNet,
    heads: FoldedHeads,
}

impl Pass {
    /// Makes or loads `unet` and `heads`; the heads start at zero.
    ///
    /// # Errors
    /// When the builder has no such tensor.
    pub fn new(cin: usize, config: &UNetConfig, heads: &HeadSizes, vb: &VarBuilder<'_>) -> Result<Self> {
        Ok(Self { unet: UNet::new(cin, config, &vb.pp("unet"))?, heads: Heads::new(heads, &vb.pp("heads"))? })
    }

    /// Features of the points, differentiable: voxel means of `rows`, the U-Net, then every point its voxel's features.
    ///
    /// # Shapes
    /// `voxel_rows` `[M, cin]` means of the points of each site; result `[N, width]`.
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn features(&self, voxel_rows: &Tensor, levels: &Levels, train: bool) -> Result<Tensor> {
        let features = self.unet.forward(voxel_rows, levels, train)?;
        let points = Segments::new(levels.site_of.clone(), levels.sites.len())?;
        segment::gather(&features, &Arc::new(points))
    }

    /// As [`Pass::features`], each point's own gradients with them as [`with_own`] says, differentiable.
    ///
    /// # Shapes
    /// `own` `[N, gradients]`; result `[N, width]`.
    ///
    /// # Gradient
    /// By the voxel rows and all parameters; `own` is constant.
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn features_with_own(&self, voxel_rows: &Tensor, own: &Tensor, levels: &Levels, train: bool) -> Result<Tensor> {
        let features = self.features(voxel_rows, levels, train)?;
        let width = features.dim(1)?;
        let used = own.dim(1)?.min(width / 2);
        let own = own.narrow(1, 0, used)?;
        let added = (features.narrow(1, 0, used)? + &own)?;
        let gated = (features.narrow(1, used, used)? * &own)?;
        Tensor::cat(&[added, gated, features.narrow(1, 2 * used, width - 2 * used)?], 1)
    }

    /// The heads.
    pub const fn heads(&self) -> &Heads {
        &self.heads
    }

    /// The form that inference runs.
    ///
    /// # Errors
    /// When a tensor cannot be read.
    pub fn fold(&self) -> Result<FoldedPass> {
        Ok(FoldedPass { unet: self.unet.fold()?, heads: self.heads.fold()? })
    }
}

impl FoldedPass {
    /// Features of the sites, `[M, width of the U-Net]`, a buffer of `buffers`.
    ///
    /// # Shapes
    /// `rows` `[N, cin]` of the points.
    pub fn site_features(&self, rows: &[f32], cin: usize, levels: &Levels, buffers: &mut Buffers) -> Vec<f32> {
        self.unet.forward(&levels.mean_of_points(rows, cin), levels, buffers)
    }

    /// The heads.
    pub const fn heads(&self) -> &FoldedHeads {
        &self.heads
    }
}

/// Changes the features of points by their own gradients: what a voxel's points share says where its points are to go, their
/// gradients say how they differ, and the voxel's features decide how far each follows its own.
///
/// # Shapes
/// `features` `[N, width]`, `own` `[N, gradients]`.
///
/// # Formula
/// `f_k <- f_k + own_k`, `f_{G+k} <- f_{G+k} own_k` for k below `G = min(gradients, width / 2)`.
pub fn with_own(features: &mut [f32], own: &[f32], num_points: usize) {
    use rayon::prelude::*;
    let (width, gradients) = (features.len() / num_points.max(1), own.len() / num_points.max(1));
    let used = gradients.min(width / 2);
    if used == 0 {
        return;
    }
    let rows = features.par_chunks_exact_mut(width).zip(own.par_chunks_exact(gradients));
    rows.with_min_len(1024).for_each(|(row, own)| {
        let (added, gated) = row.split_at_mut(used);
        for ((added, gated), own) in added.iter_mut().zip(gated).zip(own) {
            *added += own;
            *gated *= own;
        }
    });
}

/// The rows of each point's site.
///
/// # Shapes
/// `site_rows` `[M, width]`; result `[N, width]`, a buffer of `buffers`.
pub fn gather(site_rows: &[f32], levels: &Levels, buffers: &mut Buffers) -> Vec<f32> {
    use rayon::prelude::*;
    let width = site_rows.len() / levels.num_points.len().max(1);
    let mut rows = buffers.take(levels.site_of.len() * width);
    if width > 0 {
        rows.par_chunks_exact_mut(width).with_min_len(1024).zip(&levels.site_of).for_each(|(row, &site)| {
            row.copy_from_slice(&site_rows[site as usize * width..][..width]);
        });
    }
    rows
}

#[cfg(test)]
mod tests {
    use candle_core::{DType, Device, Tensor};
    use candle_nn::VarBuilder;

    use super::{HeadSizes, Levels, Pass, UNetConfig, gather, with_own};
    use crate::gaussians::NUM_ATTRIBUTES;
    use crate::network::buffers::Buffers;
    use crate::network::heads::Outputs;
    use crate::network::weights::RandomWeights;

    /// Both forms of a refinement pass, points of one voxel with gradients of their own.
    #[test]
    fn folded_features_equal_the_trainable_ones() {
        let config = UNetConfig { stem: 8, encoder: vec![8], decoder: vec![30] };
        let vb = VarBuilder::from_backend(Box::new(RandomWeights { seed: 3 }), DType::F32, Device::Cpu);
        let heads = HeadSizes { features: 30, own: 0, hidden: None, outputs: Outputs::Static };
        let pass = Pass::new(5, &config, &heads, &vb).unwrap();
        let voxels: Vec<[i32; 4]> = (0..60).map(|i| [0, i % 4, i / 7 % 3, i % 5 / 2]).collect();
        let levels = Levels::new(&voxels, config.num_levels()).unwrap();
        let value = |k: usize| ((k * 53 + 7) % 97) as f32 / 97.0 - 0.5;
        let rows: Vec<f32> = (0..60 * 5).map(value).collect();
        let own: Vec<f32> = (0..60 * NUM_ATTRIBUTES).map(|k| 3.0 * value(k + 1)).collect();
        let tensor = |v: &[f32], rows: usize| Tensor::from_slice(v, (rows, v.len() / rows), &Device::Cpu).unwrap();
        let means = tensor(&levels.mean_of_points(&rows, 5), levels.sites.len());
        let want = pass.features_with_own(&means, &tensor(&own, 60), &levels, false).unwrap();
        let mut buffers = Buffers::default();
        let by_site = pass.fold().unwrap().site_features(&rows, 5, &levels, &mut buffers);
        let mut got = gather(&by_site, &levels, &mut buffers);
        with_own(&mut got, &own, 60);
        let want = want.flatten_all().unwrap().to_vec1::<f32>().unwrap();
        let worst = got.iter().zip(&want).map(|(g, w)| (g - w).abs()).fold(0.0, f32::max);
        assert!(worst < 1e-4, "{worst}");
        assert_ne!(got[..30], got[30 * 20..30 * 21], "points of one voxel differ");
    }
}
