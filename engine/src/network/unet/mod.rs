//! The sparse U-Net.
//!
//! Stem of two 3^3 submanifold convolutions; encoder levels of a 2^3 convolution with stride 2 and two residual blocks; decoder levels of
//! a transposed 2^3 convolution, the encoder's features beside it, and two residual blocks. Convolutions have no bias; each is
//! followed by batch normalisation and a rectifier.
//!
//! # Source
//! Tang et al., `TorchSparse`, 2022 (the "42" layout: 42 convolutions deep).

mod folded;

use candle_core::{Result, Tensor};
use candle_nn::VarBuilder;

pub use folded::FoldedUNet;

use super::layers::ConvNorm;
use super::levels::{Level, Levels};
use crate::ops::sparse_conv::add_relu;

/// Channels of a U-Net.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UNetConfig {
    /// Channels of the stem.
    pub stem: usize,
    /// Channels of the encoder levels, finest first.
    pub encoder: Vec<usize>,
    /// Channels of the decoder levels, coarsest first; as many as the encoder has.
    pub decoder: Vec<usize>,
}

impl UNetConfig {
    /// Channels of the result.
    pub fn width(&self) -> usize {
        self.decoder.last().copied().unwrap_or(self.stem)
    }

    /// Levels of the voxel pyramid that the network needs.
    pub fn num_levels(&self) -> usize {
        self.encoder.len() + 1
    }
}

/// The trainable network.
#[derive(Clone, Debug)]
pub struct UNet {
    stem: [ConvNorm; 2],
    encoder: Vec<Stage>,
    decoder: Vec<Stage>,
}

/// A change of level and two residual blocks.
#[derive(Clone, Debug)]
struct Stage {
    resample: ConvNorm,
    blocks: [ResidualBlock; 2],
}

/// `relu(conv(relu(conv(x))) + shortcut(x))`.
#[derive(Clone, Debug)]
struct ResidualBlock {
    first: ConvNorm,
    second: ConvNorm,
    /// A 1^3 convolution where the number of channels changes.
    shortcut: Option<ConvNorm>,
}

impl UNet {
    /// Makes or loads the network: `stem.{0,1}`, `encoder.L.{down, blocks.B}`, `decoder.L.{up, blocks.B}`.
    ///
    /// # Errors
    /// When the builder has no such tensor.
    pub fn new(cin: usize, config: &UNetConfig, vb: &VarBuilder<'_>) -> Result<Self> {
        let stem = vb.pp("stem");
        let stem = [
            ConvNorm::new(3, cin, config.stem, &stem.pp(0))?,
            ConvNorm::new(3, config.stem, config.stem, &stem.pp(1))?,
        ];
        let mut skips = vec![config.stem];
        let mut encoder = Vec::new();
        let mut width = config.stem;
        for (level, &channels) in config.encoder.iter().enumerate() {
            let vb = vb.pp("encoder").pp(level);
            let resample = ConvNorm::new(2, width, width, &vb.pp("down"))?;
            encoder.push(Stage { resample, blocks: ResidualBlock::pair(width, channels, &vb)? });
            width = channels;
            skips.push(width);
        }
        skips.pop();
        let mut decoder = Vec::new();
        for (level, &channels) in config.decoder.iter().enumerate() {
            let vb = vb.pp("decoder").pp(level);
            let resample = ConvNorm::new(2, width, channels, &vb.pp("up"))?;
            let skip = skips.pop().unwrap_or(0);
            decoder.push(Stage { resample, blocks: ResidualBlock::pair(channels + skip, channels, &vb)? });
            width = channels;
        }
        Ok(Self { stem, encoder, decoder })
    }

    /// Features of the finest sites, differentiable.
    ///
    /// # Shapes
    /// `features` `[M, cin]`; result `[M, width]`.
    ///
    /// # Gradient
    /// By the features and all parameters; the pyramid is constant.
    ///
    /// # Errors
    /// When a shape does not fit the pyramid.
    pub fn forward(&self, features: &Tensor, levels: &Levels, train: bool) -> Result<Tensor> {
        let finest = &levels.levels[0];
        let mut x = self.stem[0].forward(features, &finest.submanifold, train, true)?;
        x = self.stem[1].forward(&x, &finest.submanifold, train, true)?;
        let mut skips = Vec::new();
        for (stage, pair) in self.encoder.iter().zip(levels.levels.windows(2)) {
            let Some([down, _]) = &pair[0].halving else { continue };
            skips.push(x.clone());
            x = stage.resample.forward(&x, down, train, true)?;
            x = stage.forward(&x, &pair[1], train)?;
        }
        for (stage, level) in self.decoder.iter().zip(levels.levels[..self.encoder.len()].iter().rev()) {
            let (Some([_, up]), Some(skip)) = (&level.halving, skips.pop()) else { continue };
            x = stage.resample.forward(&x, up, train, true)?;
            x = stage.forward(&Tensor::cat(&[&x, &skip], 1)?, level, train)?;
        }
        Ok(x)
    }
}

impl Stage {
    fn forward(&self, x: &Tensor, level: &Level, train: bool) -> Result<Tensor> {
        self.blocks.iter().try_fold(x.clone(), |x, block| block.forward(&x, level, train))
    }
}

impl ResidualBlock {
    fn pair(cin: usize, cout: usize, vb: &VarBuilder<'_>) -> Result<[Self; 2]> {
        let vb = vb.pp("blocks");
        Ok([Self::new(cin, cout, &vb.pp(0))?, Self::new(cout, cout, &vb.pp(1))?])
    }

    fn new(cin: usize, cout: usize, vb: &VarBuilder<'_>) -> Result<Self> {
        let shortcut = (cin != cout).then(|| ConvNorm::new(1, cin, cout, &vb.pp("shortcut"))).transpose()?;
        Ok(Self {
            first: ConvNorm::new(3, cin, cout, &vb.pp("first"))?,
            second: ConvNorm::new(3, cout, cout, &vb.pp("second"))?,
            shortcut,
        })
    }

    fn forward(&self, x: &Tensor, level: &Level, train: bool) -> Result<Tensor> {
        let inner = self.first.forward(x, &level.submanifold, train, true)?;
        let inner = self.second.forward(&inner, &level.submanifold, train, false)?;
        match &self.shortcut {
            Some(shortcut) => add_relu(&inner, &shortcut.forward(x, &level.pointwise, train, false)?),
            None => add_relu(&inner, x),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{UNet, UNetConfig};
    use crate::network::weights::Recorder;

    /// The total that the paper's sizes follow from.
    #[test]
    fn parameters_of_the_full_size() {
        let config = UNetConfig { stem: 32, encoder: vec![32, 64, 128, 256], decoder: vec![256, 128, 96, 96] };
        for cin in [14, 15, 29, 35] {
            let specs = Recorder::list(|vb| UNet::new(cin, &config, vb)).unwrap();
            let total: usize =
                specs.iter().filter(|s| s.is_parameter()).map(super::super::weights::TensorSpec::len).sum();
            assert_eq!(total, 21_718_016 + 864 * cin);
        }
    }
}
