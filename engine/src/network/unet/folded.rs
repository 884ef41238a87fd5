//! The U-Net as inference runs it: batch normalisation folded away, plain slices, buffers used again.

use candle_core::Result;

use super::{ResidualBlock, Stage, UNet};
use crate::network::buffers::Buffers;
use crate::network::layers::FoldedConv;
use crate::network::levels::{Level, Levels};

/// The network without anything that only training needs.
#[derive(Clone, Debug)]
pub struct FoldedUNet {
    stem: [FoldedConv; 2],
    encoder: Vec<FoldedStage>,
    decoder: Vec<FoldedStage>,
}

#[derive(Clone, Debug)]
struct FoldedStage {
    resample: FoldedConv,
    blocks: [FoldedBlock; 2],
}

#[derive(Clone, Debug)]
struct FoldedBlock {
    first: FoldedConv,
    second: FoldedConv,
    shortcut: Option<FoldedConv>,
}

impl UNet {
    /// The form that inference runs.
    ///
    /// # Errors
    /// When a tensor cannot be read.
    pub fn fold(&self) -> Result<FoldedUNet> {
        let stages = |stages: &[Stage]| stages.iter().map(Stage::fold).collect::<Result<Vec<_>>>();
        Ok(FoldedUNet {
            stem: [self.stem[0].fold()?, self.stem[1].fold()?],
            encoder: stages(&self.encoder)?,
            decoder: stages(&self.decoder)?,
        })
    }
}

impl Stage {
    fn fold(&self) -> Result<FoldedStage> {
        let blocks = [self.blocks[0].fold()?, self.blocks[1].fold()?];
        Ok(FoldedStage { resample: self.resample.fold()?, blocks })
    }
}

impl ResidualBlock {
    fn fold(&self) -> Result<FoldedBlock> {
        Ok(FoldedBlock {
            first: self.first.fold()?,
            second: self.second.fold()?,
            shortcut: self.shortcut.as_ref().map(super::ConvNorm::fold).transpose()?,
        })
    }
}

impl FoldedUNet {
    /// Features of the finest sites.
    ///
    /// # Shapes
    /// `features` `[M, cin]`; result `[M, width]`, a buffer of `buffers` that the caller may give back.
    pub fn forward(&self, features: &[f32], levels: &Levels, buffers: &mut Buffers) -> Vec<f32> {
        let finest = &levels.levels[0];
        let mut x = buffers.take(finest.num_sites * self.stem[0].cout());
        self.stem[0].forward(features, &finest.submanifold, None, true, &mut x);
        let mut y = buffers.take(finest.num_sites * self.stem[1].cout());
        self.stem[1].forward(&x, &finest.submanifold, None, true, &mut y);
        buffers.give(std::mem::replace(&mut x, y));
        let mut skips = Vec::new();
        for (stage, pair) in self.encoder.iter().zip(levels.levels.windows(2)) {
            let Some([down, _]) = &pair[0].halving else { continue };
            let mut y = buffers.take(pair[1].num_sites * stage.resample.cout());
            stage.resample.forward(&x, down, None, true, &mut y);
            skips.push(x);
            x = stage.forward(y, &pair[1], buffers);
        }
        for (stage, level) in self.decoder.iter().zip(levels.levels[..self.encoder.len()].iter().rev()) {
            let (Some([_, up]), Some(skip)) = (&level.halving, skips.pop()) else { continue };
            let mut y = buffers.take(level.num_sites * stage.resample.cout());
            stage.resample.forward(&x, up, None, true, &mut y);
            buffers.give(x);
            let joined = beside(&y, &skip, level.num_sites, buffers);
            buffers.give(y);
            buffers.give(skip);
            x = stage.forward(joined, level, buffers);
        }
        x
    }
}

impl FoldedStage {
    fn forward(&self, x: Vec<f32>, level: &Level, buffers: &mut Buffers) -> Vec<f32> {
        self.blocks.iter().fold(x, |x, block| block.forward(x, level, buffers))
    }
}

impl FoldedBlock {
    fn forward(&self, x: Vec<f32>, level: &Level, buffers: &mut Buffers) -> Vec<f32> {
        let mut inner = buffers.take(level.num_sites * self.first.cout());
        self.first.forward(&x, &level.submanifold, None, true, &mut inner);
        let residual = match &self.shortcut {
            None => x,
            Some(shortcut) => {
                let mut projected = buffers.take(level.num_sites * shortcut.cout());
                shortcut.forward(&x, &level.pointwise, None, false, &mut projected);
                buffers.give(x);
                projected
            }
        };
        let mut out = buffers.take(level.num_sites * self.second.cout());
        self.second.forward(&inner, &level.submanifold, Some(&residual), true, &mut out);
        buffers.give(inner);
        buffers.give(residual);
        out
    }
}

/// `[M, a]` and `[M, b]` as `[M, a + b]`.
fn beside(a: &[f32], b: &[f32], rows: usize, buffers: &mut Buffers) -> Vec<f32> {
    use rayon::prelude::*;
    let (wa, wb) = (a.len() / rows.max(1), b.len() / rows.max(1));
    let mut joined = buffers.take(a.len() + b.len());
    if wa > 0 && wb > 0 {
        let parts = a.par_chunks_exact(wa).zip(b.par_chunks_exact(wb));
        joined.par_chunks_exact_mut(wa + wb).zip(parts).with_min_len(1024).for_each(|(row, (a, b))| {
            row[..wa].copy_from_slice(a);
            row[wa..].copy_from_slice(b);
        });
    }
    joined
}
