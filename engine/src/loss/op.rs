//! The image loss as a candle operation, for training.

use std::sync::Arc;

use candle_core::{CpuStorage, CustomOp1, Layout, Shape, Tensor};

use super::{LossWeights, image_loss};
use crate::ops::tensors::slice;
use crate::render::Rendered;
use crate::render::constants::EXPECTED_DEPTH_EPS;
use crate::render::op::CHANNELS;
use crate::views::View;

/// The loss of a packed image against the truth of its view.
#[derive(Clone, Debug)]
pub struct LossOp {
    /// The truth.
    pub view: Arc<View>,
    /// Weights of the terms.
    pub weights: LossWeights,
}

impl LossOp {
    /// The loss of `image`, a scalar; the velocity term is not part of it.
    ///
    /// # Shapes
    /// `image` `[H, W, 5]` f32 as [`crate::render::op::RenderOp::render`] packs it, of the view's size.
    ///
    /// # Gradient
    /// By the image, exact; the truth is constant.
    ///
    /// # Errors
    /// When the shape does not fit the view.
    pub fn loss(self, image: &Tensor) -> candle_core::Result<Tensor> {
        let want = (self.view.pinhole.height, self.view.pinhole.width, CHANNELS);
        if image.dims3()? != want {
            candle_core::bail!("loss: expected an image of shape {want:?}, found {:?}", image.dims());
        }
        image.contiguous()?.apply_op1(self)
    }

    fn rendered(&self, packed: &[f32]) -> Rendered {
        let pixels = packed.as_chunks::<CHANNELS>().0;
        Rendered {
            width: self.view.pinhole.width,
            height: self.view.pinhole.height,
            rgb: pixels.iter().flat_map(|p| [p[0], p[1], p[2]]).collect(),
            alpha: pixels.iter().map(|p| p[3]).collect(),
            depth: pixels.iter().map(|p| p[4]).collect(),
        }
    }
}

impl CustomOp1 for LossOp {
    fn name(&self) -> &'static str {
        "image-loss"
    }

    #[expect(clippy::cast_possible_truncation, reason = "tensors are f32")]
    fn cpu_fwd(&self, storage: &CpuStorage, layout: &Layout) -> candle_core::Result<(CpuStorage, Shape)> {
        let rendered = self.rendered(slice(storage, layout)?);
        let (terms, _) = image_loss(&rendered, &self.view, &self.weights);
        Ok((CpuStorage::F32(vec![terms.total as f32]), Shape::from(())))
    }

    fn bwd(&self, image: &Tensor, _loss: &Tensor, gradient: &Tensor) -> candle_core::Result<Option<Tensor>> {
        let scale = gradient.to_scalar::<f32>()?;
        let rendered = self.rendered(&image.flatten_all()?.to_vec1::<f32>()?);
        let (_, by_image) = image_loss(&rendered, &self.view, &self.weights);
        let mut packed = vec![0.0_f32; rendered.alpha.len() * CHANNELS];
        for (i, pixel) in packed.as_chunks_mut::<CHANNELS>().0.iter_mut().enumerate() {
            for (slot, v) in pixel.iter_mut().zip(&by_image.rgb[3 * i..3 * i + 3]) {
                *slot = scale * v;
            }
            let v_expected = by_image.expected_depth.get(i).map_or(0.0, |v| scale * v);
            let alpha = rendered.alpha[i];
            pixel[4] = v_expected / alpha.max(EXPECTED_DEPTH_EPS);
            if alpha > EXPECTED_DEPTH_EPS {
                pixel[3] = -v_expected * (rendered.depth[i] / alpha / alpha);
            }
        }
        Ok(Some(Tensor::from_vec(packed, image.shape(), image.device())?))
    }
}
