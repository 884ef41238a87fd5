//! A pass: one U-Net and the heads on its features.

use candle_core::{Result, Tensor};
use candle_nn::VarBuilder;

use super::heads::{HeadSizes, Heads};
use super::levels::Levels;
use super::unet::{UNet, UNetConfig};
use crate::ops::segment::{gather, gather_gated, mean_pool};

/// The pass.
#[derive(Clone, Debug)]
pub struct Pass {
    unet: UNet,
    heads: Heads,
}

impl Pass {
    /// Makes or loads `unet` and `heads`; the heads start at zero.
    ///
    /// # Errors
    /// When the builder has no such tensor.
    pub fn new(cin: usize, config: &UNetConfig, heads: &HeadSizes, vb: &VarBuilder<'_>) -> Result<Self> {
        Ok(Self { unet: UNet::new(cin, config, &vb.pp("unet"))?, heads: Heads::new(heads, &vb.pp("heads"))? })
    }

    /// Features of the sites: the U-Net on the means of their points' rows.
    ///
    /// # Shapes
    /// `rows` `[N, cin]`; result `[M, width]`.
    ///
    /// # Gradient
    /// By the rows and all parameters.
    ///
    /// # Errors
    /// When a shape does not fit.
    pub(crate) fn site_features(&self, rows: &Tensor, levels: &Levels, train: bool) -> Result<Tensor> {
        self.unet.forward(&mean_pool(rows, &levels.points)?, levels, train)
    }

    /// Features of the points: those of their sites.
    ///
    /// # Shapes
    /// `rows` `[N, cin]`; result `[N, width]`.
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn features(&self, rows: &Tensor, levels: &Levels, train: bool) -> Result<Tensor> {
        gather(&self.site_features(rows, levels, train)?, &levels.points)
    }

    /// As [`Pass::features`], changed by inputs of each point as [`gather_gated`] does it; by heads that read them there, unchanged.
    ///
    /// # Shapes
    /// `point_inputs` `[N, gradients]`, constant.
    ///
    /// # Errors
    /// When a shape does not fit.
    pub(crate) fn gated_features(
        &self,
        rows: &Tensor,
        point_inputs: &Tensor,
        levels: &Levels,
        train: bool,
    ) -> Result<Tensor> {
        if self.heads.read_point_inputs() {
            return self.features(rows, levels, train);
        }
        gather_gated(&self.site_features(rows, levels, train)?, point_inputs, &levels.points)
    }

    /// The heads.
    pub const fn heads(&self) -> &Heads {
        &self.heads
    }

    /// The pass as inference runs it, to the bit what it is with running statistics.
    ///
    /// # Errors
    /// When a tensor cannot be read.
    pub fn fold(&self) -> Result<Self> {
        Ok(Self { unet: self.unet.fold()?, heads: self.heads.fold()? })
    }
}

#[cfg(test)]
mod tests {
    use candle_core::{DType, Tensor, Var};
    use candle_nn::VarBuilder;

    use super::{HeadSizes, Levels, Pass, UNetConfig};
    use crate::gaussians::NUM_ATTRIBUTES;
    use crate::network::heads::Outputs;
    use crate::network::weights::RandomWeights;
    use crate::ops::DEVICE;

    /// A refinement pass, points of one voxel with gradients of their own: with running statistics and folded.
    #[test]
    fn folded_features_are_the_same_to_the_bit() {
        let config = UNetConfig { stem: 8, encoder: vec![8], decoder: vec![30] };
        let vb = VarBuilder::from_backend(Box::new(RandomWeights { seed: 3 }), DType::F32, DEVICE);
        let heads = HeadSizes { features: 30, point_inputs: 0, hidden: None, outputs: Outputs::Static };
        let pass = Pass::new(5, &config, &heads, &vb).unwrap();
        let voxels: Vec<[i32; 4]> = (0..60).map(|i| [0, i % 4, i / 7 % 3, i % 5 / 2]).collect();
        let levels = Levels::new(&voxels, config.num_levels()).unwrap();
        let value = |k: usize| ((k * 53 + 7) % 97) as f32 / 97.0 - 0.5;
        let tensor = |width: usize, factor: f32| {
            let values: Vec<f32> = (0..60 * width).map(|k| factor * value(k)).collect();
            Tensor::from_vec(values, (60, width), &DEVICE).unwrap()
        };
        let (rows, gradients) = (Var::from_tensor(&tensor(5, 1.0)).unwrap(), tensor(NUM_ATTRIBUTES, 3.0));
        // Batch statistics first, so that the running ones are none of which the affine is the identity.
        pass.gated_features(&rows, &gradients, &levels, true).unwrap();
        let features = |pass: &Pass, rows: &Tensor| {
            pass.gated_features(rows, &gradients, &levels, false).unwrap().to_vec2::<f32>().unwrap()
        };
        let got = features(&pass.fold().unwrap(), &rows.as_detached_tensor());
        assert_eq!(got, features(&pass, &rows));
        assert_ne!(got[0], got[20], "points of one voxel differ");
    }
}
