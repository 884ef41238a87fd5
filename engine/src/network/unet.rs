//! The sparse U-Net.
//!
//! Stem of two 3^3 submanifold convolutions; encoder levels of a 2^3 convolution with stride 2 and two residual blocks; decoder levels of
//! a transposed 2^3 convolution, the encoder's features beside it, and two residual blocks. Convolutions have no bias; each is
//! followed by batch normalisation and a rectifier.
//!
//! # Source
//! Tang et al., `TorchSparse`, 2022 (the "42" layout: 42 convolutions deep).

use candle_core::{Result, Tensor};
use candle_nn::{Init, VarBuilder};

use super::conv::{ConvNorm, ConvSize};
use super::levels::{Level, Levels};

/// Added to the variance (`PyTorch`'s default).
const NORM_EPS: f64 = 1e-5;

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

/// The network.
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
        let stem = [conv(3, cin, config.stem, &stem.pp(0))?, conv(3, config.stem, config.stem, &stem.pp(1))?];
        let mut skips = vec![config.stem];
        let mut encoder = Vec::new();
        let mut width = config.stem;
        for (level, &channels) in config.encoder.iter().enumerate() {
            let vb = vb.pp("encoder").pp(level);
            let resample = conv(2, width, width, &vb.pp("down"))?;
            encoder.push(Stage { resample, blocks: ResidualBlock::pair(width, channels, &vb)? });
            width = channels;
            skips.push(width);
        }
        skips.pop();
        let mut decoder = Vec::new();
        for (level, &channels) in config.decoder.iter().enumerate() {
            let vb = vb.pp("decoder").pp(level);
            let resample = conv(2, width, channels, &vb.pp("up"))?;
            let skip = skips.pop().unwrap_or(0);
            decoder.push(Stage { resample, blocks: ResidualBlock::pair(channels + skip, channels, &vb)? });
            width = channels;
        }
        Ok(Self { stem, encoder, decoder })
    }

    /// Features of the finest sites.
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
        let mut x = self.stem[0].forward(features, None, &finest.submanifold, train, true)?;
        x = self.stem[1].forward(&x, None, &finest.submanifold, train, true)?;
        let mut skips = Vec::new();
        for (stage, pair) in self.encoder.iter().zip(levels.levels.windows(2)) {
            let Some([down, _]) = &pair[0].halving else { continue };
            let halved = stage.resample.forward(&x, None, down, train, true)?;
            skips.push(x);
            x = stage.forward(halved, &pair[1], train)?;
        }
        for (stage, level) in self.decoder.iter().zip(levels.levels[..self.encoder.len()].iter().rev()) {
            let (Some([_, up]), Some(skip)) = (&level.halving, skips.pop()) else { continue };
            x = stage.resample.forward(&x, None, up, train, true)?;
            x = Tensor::cat(&[&x, &skip], 1)?;
            drop(skip);
            x = stage.forward(x, level, train)?;
        }
        Ok(x)
    }

    /// The network as inference runs it: normalisation folded into the convolutions.
    ///
    /// # Errors
    /// When a tensor cannot be read.
    pub fn fold(&self) -> Result<Self> {
        let stages = |stages: &[Stage]| stages.iter().map(Stage::fold).collect::<Result<Vec<_>>>();
        Ok(Self {
            stem: [self.stem[0].fold()?, self.stem[1].fold()?],
            encoder: stages(&self.encoder)?,
            decoder: stages(&self.decoder)?,
        })
    }
}

/// A normalised convolution as the network starts with it.
fn conv(kernel: usize, cin: usize, cout: usize, vb: &VarBuilder<'_>) -> Result<ConvNorm> {
    let size = ConvSize { kernel, cin, cout };
    ConvNorm::new(size, Init::Randn { mean: 0.0, stdev: (2.0 / size.fan_in()).sqrt() }, NORM_EPS, vb)
}

// Features are given away, so that their memory is free as soon as the last layer has read them.
impl Stage {
    fn forward(&self, x: Tensor, level: &Level, train: bool) -> Result<Tensor> {
        self.blocks.iter().try_fold(x, |x, block| block.forward(x, level, train))
    }

    fn fold(&self) -> Result<Self> {
        let blocks = [self.blocks[0].fold()?, self.blocks[1].fold()?];
        Ok(Self { resample: self.resample.fold()?, blocks })
    }
}

impl ResidualBlock {
    fn pair(cin: usize, cout: usize, vb: &VarBuilder<'_>) -> Result<[Self; 2]> {
        let vb = vb.pp("blocks");
        Ok([Self::new(cin, cout, &vb.pp(0))?, Self::new(cout, cout, &vb.pp(1))?])
    }

    fn new(cin: usize, cout: usize, vb: &VarBuilder<'_>) -> Result<Self> {
        let shortcut = (cin != cout).then(|| conv(1, cin, cout, &vb.pp("shortcut"))).transpose()?;
        Ok(Self {
            first: conv(3, cin, cout, &vb.pp("first"))?,
            second: conv(3, cout, cout, &vb.pp("second"))?,
            shortcut,
        })
    }

    fn forward(&self, x: Tensor, level: &Level, train: bool) -> Result<Tensor> {
        let inner = self.first.forward(&x, None, &level.submanifold, train, true)?;
        let residual = match &self.shortcut {
            Some(shortcut) => {
                let projected = shortcut.forward(&x, None, &level.pointwise, train, false)?;
                drop(x);
                projected
            }
            None => x,
        };
        self.second.forward(&inner, Some(&residual), &level.submanifold, train, true)
    }

    fn fold(&self) -> Result<Self> {
        Ok(Self {
            first: self.first.fold()?,
            second: self.second.fold()?,
            shortcut: self.shortcut.as_ref().map(ConvNorm::fold).transpose()?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::{UNet, UNetConfig};
    use crate::network::weights::{Recorder, TensorSpec};

    /// The total that the paper's sizes follow from.
    #[test]
    fn parameters_of_the_full_size() {
        let config = UNetConfig { stem: 32, encoder: vec![32, 64, 128, 256], decoder: vec![256, 128, 96, 96] };
        for cin in [14, 15, 29, 35] {
            let specs = Recorder::list(|vb| UNet::new(cin, &config, vb)).unwrap();
            let total: usize = specs.iter().filter(|s| s.is_parameter()).map(TensorSpec::len).sum();
            assert_eq!(total, 21_718_016 + 864 * cin);
        }
    }
}
