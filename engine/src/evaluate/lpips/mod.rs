//! LPIPS: perceptual distance of two images by the features of a network.
//!
//! # Source
//! Zhang, Isola, Efros, Shechtman, Wang: The unreasonable effectiveness of deep features as a perceptual metric (2018),
//! version 0.1 with the `SqueezeNet` 1.1 trunk. Users bring the weights as one safetensors file: trunk in torchvision's names
//! (`features.N...`), heads `lin0..6.model.1.weight`, `scaling_layer.{shift,scale}`, all f32.

mod weights;

use std::path::Path;

use candle_core::Tensor;
use lgs_formats::image::RgbImage;

use crate::{
    error::{EngineError, Result},
    ops::DEVICE,
    parallel,
};
use weights::WeightReader;

/// Smallest side of an image, pixels, for which the third pooling of the trunk still has an input.
pub(crate) const MIN_SIDE: usize = 17;

/// Fire modules of the trunk: index in `features`, channels in, squeezed, expanded (each of the two expansions).
const FIRES: [(usize, usize, usize, usize); 8] = [
    (3, 64, 16, 64),
    (4, 128, 16, 64),
    (6, 128, 32, 128),
    (7, 256, 32, 128),
    (9, 256, 48, 192),
    (10, 384, 48, 192),
    (11, 384, 64, 256),
    (12, 512, 64, 256),
];
/// Modules before which the trunk pools.
const POOL_BEFORE: [usize; 3] = [3, 6, 9];
/// Modules after which features are compared; the first convolution's are compared as well.
const TAPS: [usize; 6] = [4, 7, 9, 10, 11, 12];
/// Channels of the compared features.
const TAP_CHANNELS: [usize; 7] = [64, 128, 256, 384, 384, 512, 512];
/// Keeps the norm of an all-zero feature vector away from 0.
const NORM_EPSILON: f32 = 1e-10;

/// The metric's network.
#[derive(Clone, Debug)]
pub struct Lpips {
    shift: Vec<f32>,
    scale: Vec<f32>,
    first: Convolution,
    fires: Vec<Fire>,
    heads: Vec<Vec<f32>>,
}

/// A convolution with bias.
#[derive(Clone, Debug)]
struct Convolution {
    /// `[out, in, k, k]`.
    weight: Tensor,
    /// `[1, out, 1, 1]`.
    bias: Tensor,
    padding: usize,
    stride: usize,
}

impl Convolution {
    /// `[B, in, H, W]` to `[B, out, H', W']`, rectified.
    fn rectified(&self, input: &Tensor) -> Result<Tensor> {
        let linear = input.conv2d(&self.weight, self.padding, self.stride, 1, 1)?;
        Ok(linear.broadcast_add(&self.bias)?.relu()?)
    }
}

/// `SqueezeNet`'s fire module: squeeze by 1x1, expand by 1x1 and by 3x3, side by side.
#[derive(Clone, Debug)]
struct Fire {
    index: usize,
    squeeze: Convolution,
    expand1x1: Convolution,
    expand3x3: Convolution,
}

impl Fire {
    fn forward(&self, input: &Tensor) -> Result<Tensor> {
        let squeezed = self.squeeze.rectified(input)?;
        Ok(Tensor::cat(&[self.expand1x1.rectified(&squeezed)?, self.expand3x3.rectified(&squeezed)?], 1)?)
    }
}

impl Lpips {
    /// The network of a weights file.
    ///
    /// # Errors
    /// A file that cannot be read or is no safetensors file; all tensors that are missing, of another type or shape, or not
    /// finite, by name, in one [`EngineError::Weights`].
    pub fn load(path: &Path) -> Result<Self> {
        let bytes = weights::read(path)?;
        let mut reader = WeightReader::new(path, &bytes)?;
        let shift = reader.values("scaling_layer.shift", &[1, 3, 1, 1]);
        let scale = reader.values("scaling_layer.scale", &[1, 3, 1, 1]);
        let first = convolution(&mut reader, "features.0", [64, 3, 3], 2)?;
        let fire = |(index, input, squeezed, expanded)| read_fire(&mut reader, index, [input, squeezed, expanded]);
        let fires = FIRES.map(fire).into_iter().collect::<Result<_>>()?;
        let heads = TAP_CHANNELS.iter().enumerate();
        let heads = heads.map(|(i, &c)| reader.values(&format!("lin{i}.model.1.weight"), &[1, c, 1, 1])).collect();
        reader.finish()?;
        Ok(Self { shift, scale, first, fires, heads })
    }

    /// Distance of two images, 0 for identical ones.
    ///
    /// # Shapes
    /// Both `[H, W, 3]`, values in 0..=1, H and W at least `MIN_SIDE`.
    ///
    /// # Formula
    /// Sum over seven layers of the mean over positions of `sum_c w_c (a_c / |a| - b_c / |b|)^2`.
    ///
    /// # Errors
    /// Images of different or too small size, a value that is not finite, a failed tensor operation.
    pub fn distance(&self, a: &RgbImage, b: &RgbImage) -> Result<f64> {
        check_images(a, b)?;
        let features = self.features(self.input(a, b)?)?;
        let layers = features.iter().zip(&self.heads).map(|(features, head)| layer_distance(features, head));
        layers.sum()
    }

    /// `[2, 3, H, W]`: both images in -1..=1, shifted and scaled per channel.
    fn input(&self, a: &RgbImage, b: &RgbImage) -> Result<Tensor> {
        let channel = |image: &RgbImage, c: usize| -> Vec<f32> {
            let values = image.data.iter().skip(c).step_by(3);
            values.map(|v| (2.0 * v - 1.0 - self.shift[c]) / self.scale[c]).collect()
        };
        let planes: Vec<f32> = [a, b].into_iter().flat_map(|i| (0..3).flat_map(move |c| channel(i, c))).collect();
        Ok(Tensor::from_vec(planes, (2, 3, a.height, a.width), &DEVICE)?)
    }

    /// The seven compared features, each `[2, C, h, w]`.
    fn features(&self, input: Tensor) -> Result<Vec<Tensor>> {
        let mut features = vec![self.first.rectified(&input)?];
        let mut current = features[0].clone();
        for fire in &self.fires {
            if POOL_BEFORE.contains(&fire.index) {
                current = pool(&current)?;
            }
            current = fire.forward(&current)?;
            if TAPS.contains(&fire.index) {
                features.push(current.clone());
            }
        }
        Ok(features)
    }
}

fn convolution(
    reader: &mut WeightReader,
    name: &str,
    [out, input, side]: [usize; 3],
    stride: usize,
) -> Result<Convolution> {
    let weight = reader.values(&format!("{name}.weight"), &[out, input, side, side]);
    let bias = reader.values(&format!("{name}.bias"), &[out]);
    let padding = if stride == 1 { side / 2 } else { 0 };
    Ok(Convolution {
        weight: Tensor::from_vec(weight, (out, input, side, side), &DEVICE)?,
        bias: Tensor::from_vec(bias, (1, out, 1, 1), &DEVICE)?,
        padding,
        stride,
    })
}

fn read_fire(reader: &mut WeightReader, index: usize, [input, squeezed, expanded]: [usize; 3]) -> Result<Fire> {
    let name = format!("features.{index}");
    Ok(Fire {
        index,
        squeeze: convolution(reader, &format!("{name}.squeeze"), [squeezed, input, 1], 1)?,
        expand1x1: convolution(reader, &format!("{name}.expand1x1"), [expanded, squeezed, 1], 1)?,
        expand3x3: convolution(reader, &format!("{name}.expand3x3"), [expanded, squeezed, 3], 1)?,
    })
}

/// Maximum over 3x3, stride 2, the last window cut off at the edge (`ceil_mode`). Features are never negative, so zeros
/// beyond the edge change no maximum.
fn pool(input: &Tensor) -> Result<Tensor> {
    let (_, _, height, width) = input.dims4()?;
    let beyond = |side: usize| usize::from(side.is_multiple_of(2));
    let padded = input.pad_with_zeros(2, 0, beyond(height))?.pad_with_zeros(3, 0, beyond(width))?;
    Ok(padded.max_pool2d_with_stride(3, 2)?)
}

/// Mean over positions of the weighted squared difference of the two unit feature vectors.
///
/// # Shapes
/// `features` `[2, C, h, w]`, `head` `[C]`.
fn layer_distance(features: &Tensor, head: &[f32]) -> Result<f64> {
    let (_, channels, height, width) = features.dims4()?;
    let positions = height * width;
    let values = features.flatten_all()?.to_vec1::<f32>()?;
    let (a, b) = values.split_at(channels * positions);
    let rows = parallel::map(height, 1, &|row| {
        let at = |image: &[f32], channel: usize, x: usize| image[channel * positions + row * width + x];
        let mut norms = vec![[0.0_f32; 2]; width];
        for channel in 0..channels {
            for (x, norm) in norms.iter_mut().enumerate() {
                norm[0] += at(a, channel, x).powi(2);
                norm[1] += at(b, channel, x).powi(2);
            }
        }
        let inverse: Vec<[f32; 2]> = norms.iter().map(|n| n.map(|sum| 1.0 / (sum.sqrt() + NORM_EPSILON))).collect();
        let mut sum = 0.0_f64;
        for (channel, &weight) in head.iter().enumerate() {
            let differences =
                inverse.iter().enumerate().map(|(x, i)| at(a, channel, x) * i[0] - at(b, channel, x) * i[1]);
            sum += f64::from(weight) * f64::from(differences.map(|d| d * d).sum::<f32>());
        }
        sum
    });
    Ok(rows.iter().sum::<f64>() / positions as f64)
}

fn check_images(a: &RgbImage, b: &RgbImage) -> Result<()> {
    let size = |image: &RgbImage| format!("{}x{}", image.height, image.width);
    let wrong =
        |expected: String, found| Err(EngineError::Setting { setting: "image size for LPIPS", expected, found });
    if (a.width, a.height, a.data.len()) != (b.width, b.height, b.data.len()) {
        return wrong(format!("two images of one size, {}", size(a)), size(b));
    }
    if a.width.min(a.height) < MIN_SIDE {
        return wrong(format!("at least {MIN_SIDE}x{MIN_SIDE}"), size(a));
    }
    match a.data.iter().chain(&b.data).position(|v| !v.is_finite()) {
        Some(index) => {
            let found = a.data.iter().chain(&b.data).nth(index).copied().unwrap_or(f32::NAN);
            Err(EngineError::NonFinite { what: format!("value {index} of two images for LPIPS"), found })
        }
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests;
