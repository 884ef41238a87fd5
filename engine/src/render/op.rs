//! The rasteriser as a candle operation, for training.

use candle_core::{CpuStorage, CustomOp2, Layout, Shape, Tensor};

use super::{ImageGradient, backward, render_for_gradient};
use crate::gaussians::physical::{to_physical, to_raw_gradient};
use crate::gaussians::{GaussianSet, NUM_ATTRIBUTES};
use crate::ops::tensors::slice;
use crate::views::PinholeView;

/// Channels of the packed image: red, green, blue, alpha, accumulated depth.
pub const CHANNELS: usize = 5;

/// Renders one view of raw Gaussians.
#[derive(Clone, Debug)]
pub struct RenderOp {
    /// The camera.
    pub view: PinholeView,
    /// `[N]` moment at which each Gaussian stands at its mean, seconds.
    pub times: std::sync::Arc<Vec<f32>>,
    /// Number of leading rows that belong to the `LiDAR` branch.
    pub num_lidar: usize,
    /// Colour behind the Gaussians.
    pub background: [f32; 3],
}

impl RenderOp {
    /// The packed image of raw attributes `[N, 14]` and velocities `[N, 3]`, both f32.
    ///
    /// # Shapes
    /// Result `[H, W, 5]`: red, green, blue, accumulated alpha, accumulated depth (metres).
    ///
    /// # Gradient
    /// By both tensors, exact; the camera, the times and the background colour are constants.
    ///
    /// # Errors
    /// When a shape, the number of times or the dtype does not fit.
    pub fn render(self, attributes: &Tensor, velocities: &Tensor) -> candle_core::Result<Tensor> {
        attributes.contiguous()?.apply_op2(&velocities.contiguous()?, self)
    }

    fn gaussians(&self, attributes: &[f32], velocities: &[f32]) -> candle_core::Result<GaussianSet> {
        let (attributes, rest) = attributes.as_chunks::<NUM_ATTRIBUTES>();
        let (velocities, rest_v) = velocities.as_chunks::<3>();
        let n = self.times.len();
        if !rest.is_empty() || !rest_v.is_empty() || attributes.len() != n || velocities.len() != n {
            candle_core::bail!(
                "render: expected [{n}, 14] and [{n}, 3] values, found {} and {} rows",
                attributes.len(),
                velocities.len()
            );
        }
        Ok(GaussianSet {
            attributes: attributes.to_vec(),
            times: self.times.as_ref().clone(),
            frames: vec![0; n],
            velocities: velocities.to_vec(),
            num_lidar: self.num_lidar,
        })
    }
}

impl CustomOp2 for RenderOp {
    fn name(&self) -> &'static str {
        "render-gaussians"
    }

    fn cpu_fwd(
        &self,
        attributes: &CpuStorage,
        attributes_layout: &Layout,
        velocities: &CpuStorage,
        velocities_layout: &Layout,
    ) -> candle_core::Result<(CpuStorage, Shape)> {
        let set = self.gaussians(slice(attributes, attributes_layout)?, slice(velocities, velocities_layout)?)?;
        let images = super::render(&to_physical(&set), &self.view, self.background);
        let pixels = images.rgb.as_chunks::<3>().0.iter().zip(&images.alpha).zip(&images.depth);
        let packed = pixels.flat_map(|((rgb, &alpha), &depth)| [rgb[0], rgb[1], rgb[2], alpha, depth]).collect();
        Ok((CpuStorage::F32(packed), Shape::from((images.height, images.width, CHANNELS))))
    }

    fn bwd(
        &self,
        attributes: &Tensor,
        velocities: &Tensor,
        _image: &Tensor,
        gradient: &Tensor,
    ) -> candle_core::Result<(Option<Tensor>, Option<Tensor>)> {
        let flat = |tensor: &Tensor| tensor.flatten_all()?.to_vec1::<f32>();
        let set = self.gaussians(&flat(attributes)?, &flat(velocities)?)?;
        let splats = to_physical(&set);
        let state = render_for_gradient(&splats, &self.view, self.background);
        let packed = flat(gradient)?;
        let pixels = packed.as_chunks::<CHANNELS>().0;
        let by_image = ImageGradient {
            rgb: pixels.iter().flat_map(|p| [p[0], p[1], p[2]]).collect(),
            alpha: pixels.iter().map(|p| p[3]).collect(),
            depth: pixels.iter().map(|p| p[4]).collect(),
            expected_depth: Vec::new(),
        };
        let (by_attributes, by_velocities) = to_raw_gradient(&set, &backward(&splats, &self.view, &state, &by_image));
        let device = attributes.device();
        Ok((
            Some(Tensor::from_vec(by_attributes.into_flattened(), attributes.shape(), device)?),
            Some(Tensor::from_vec(by_velocities.into_flattened(), velocities.shape(), device)?),
        ))
    }
}
