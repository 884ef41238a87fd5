//! Gaussian Densify Policy: a Point Transformer V3 over the voxels and two heads that score pruning and adding.
//!
//! Made of operations with exact gradients. Folded, normalisation is part of the weights and each block runs in two passes over memory, to the
//! bit the same. Tensor names are those of the reference implementation.
//!
//! # Source
//! Wu et al., Point Transformer V3, CVPR 2024: without flash attention, orders not shuffled. The paper, section 3.2.

mod block;
mod config;
mod geometry;
mod heads;
mod resample;

use candle_core::{Result, Tensor};
use candle_nn::VarBuilder;

pub use config::{Cycle, PolicyConfig, StageConfig};
pub use geometry::Geometry;

use crate::ops::segment::add_gathered;
use block::Block;
use geometry::Stage;
use heads::Head;
use resample::{Down, Stem, Up};

/// Inputs beside the backbone's features: normalised position 3, rotation 4, scale 3, opacity 1, colour 3, voxel density 1.
pub const EXTRA_INPUTS: usize = 15;

/// The policy.
#[derive(Clone, Debug)]
pub struct Policy {
    stem: Stem,
    /// Finest first.
    encoder: Vec<(Option<Down>, Vec<Block>)>,
    /// Finest first.
    decoder: Vec<(Up, Vec<Block>)>,
    prune: Head,
    add: Head,
    plan: config::CurvePlan,
}

/// Told the features after every stage, for tests.
pub type Observer<'a> = &'a mut dyn FnMut(&str, &Tensor) -> Result<()>;

/// An [`Observer`] and where in the network it is.
struct Trace<'a> {
    observer: Option<Observer<'a>>,
    path: String,
}

impl Trace<'_> {
    fn note(&mut self, name: &str, features: &Tensor) -> Result<()> {
        match &mut self.observer {
            Some(observer) => observer(&format!("{}{name}", self.path), features),
            None => Ok(()),
        }
    }
}

impl Policy {
    /// Makes or loads the policy for features of `inputs` channels.
    ///
    /// # Errors
    /// When the builder has no such tensor.
    pub fn new(inputs: usize, config: &PolicyConfig, vb: &VarBuilder<'_>) -> Result<Self> {
        let channels = |stage: Option<&StageConfig>| stage.map_or(0, |stage| stage.channels);
        let blocks = |stage: &StageConfig, vb: &VarBuilder<'_>| {
            (0..stage.blocks)
                .map(|i| Block::new(stage, config.mlp_ratio, &vb.pp(format!("block{i}"))))
                .collect::<Result<Vec<_>>>()
        };
        let mut encoder = Vec::new();
        for (s, stage) in config.encoder.iter().enumerate() {
            let vb = vb.pp("enc").pp(format!("enc{s}"));
            let down = (s > 0).then(|| Down::new(config.encoder[s - 1].channels, stage.channels, &vb.pp("down")));
            encoder.push((down.transpose()?, blocks(stage, &vb)?));
        }
        let mut decoder = Vec::new();
        for (s, stage) in config.decoder.iter().enumerate() {
            let vb = vb.pp("dec").pp(format!("dec{s}"));
            let coarse = channels(config.decoder.get(s + 1).or(config.encoder.last()));
            let up = Up::new(coarse, config.encoder[s].channels, stage.channels, &vb.pp("up"))?;
            decoder.push((up, blocks(stage, &vb)?));
        }
        let heads = vb.pp("heads");
        Ok(Self {
            stem: Stem::new(inputs, channels(config.encoder.first()), &vb.pp("embedding"))?,
            encoder,
            decoder,
            prune: Head::new(config, &heads.pp("prune"))?,
            add: Head::new(config, &heads.pp("add"))?,
            plan: config.curve_plan(),
        })
    }

    /// Scores of the voxels: the probabilities of pruning and of adding.
    ///
    /// # Shapes
    /// `features` `[M, inputs]` of the finest voxels; result `[M, 2]`, each in 0..1.
    ///
    /// # Gradient
    /// By the features and all parameters; the geometry is constant. A folded policy has none.
    ///
    /// # Errors
    /// When a shape does not fit the geometry.
    pub fn scores(&self, features: &Tensor, geometry: &Geometry, train: bool) -> Result<Tensor> {
        let features = self.features(features, geometry, train, None)?;
        let logits = Tensor::cat(&[self.prune.forward(&features)?, self.add.forward(&features)?], 1)?;
        candle_nn::ops::sigmoid(&logits)
    }

    /// Features of the finest voxels; `observer` is told those of every stage on the way.
    ///
    /// # Shapes
    /// `features` `[M, inputs]`; result `[M, channels of the finest stage]`.
    ///
    /// # Errors
    /// When a shape does not fit the geometry.
    pub fn features(
        &self,
        features: &Tensor,
        geometry: &Geometry,
        train: bool,
        observer: Option<Observer<'_>>,
    ) -> Result<Tensor> {
        self.check(features.dim(0)?, geometry)?;
        let mut trace = Trace { observer, path: String::new() };
        let mut x = self.stem.forward(features, &geometry.stem, train)?;
        trace.note("embedding", &x)?;
        let mut skips = Vec::new();
        for (s, ((down, blocks), stage)) in self.encoder.iter().zip(&geometry.stages).enumerate() {
            if let Some(down) = down {
                skips.push(x.clone());
                x = down.forward(&x, geometry.stages[s - 1].parents()?, train)?;
                trace.note(&format!("enc{s}.down"), &x)?;
            }
            x = StageBlocks { name: &format!("enc{s}"), blocks, curves: &self.plan.encoder[s] }
                .run(x, None, stage, &mut trace)?;
        }
        for (s, ((up, blocks), stage)) in self.decoder.iter().zip(&geometry.stages).enumerate().rev() {
            let Some(skip) = skips.pop() else { continue };
            let [fine, coarse] = up.forward(&x, &skip, train)?;
            drop(skip);
            x = StageBlocks { name: &format!("dec{s}"), blocks, curves: &self.plan.decoder[s] }.run(
                fine,
                Some(coarse),
                stage,
                &mut trace,
            )?;
        }
        Ok(x)
    }

    /// # Errors
    /// When the geometry belongs to other voxels or to a policy with another number of stages.
    fn check(&self, rows: usize, geometry: &Geometry) -> Result<()> {
        let (found, expected) = ((rows, self.encoder.len()), (geometry.num_sites(), geometry.stages.len()));
        if found == expected {
            return Ok(());
        }
        candle_core::bail!("policy: expected (voxels, stages) as in the geometry, {expected:?}, found {found:?}")
    }

    /// The policy as inference runs it, to the bit what it is with running statistics.
    ///
    /// # Errors
    /// When a tensor cannot be read.
    pub fn fold(&self) -> Result<Self> {
        let blocks = |blocks: &[Block]| blocks.iter().map(Block::fold).collect::<Result<Vec<_>>>();
        let encoder =
            self.encoder.iter().map(|(down, stage)| Ok((down.as_ref().map(Down::fold).transpose()?, blocks(stage)?)));
        let decoder = self.decoder.iter().map(|(up, stage)| Ok((up.fold()?, blocks(stage)?)));
        Ok(Self {
            stem: self.stem.fold()?,
            encoder: encoder.collect::<Result<_>>()?,
            decoder: decoder.collect::<Result<_>>()?,
            prune: self.prune.fold()?,
            add: self.add.fold()?,
            plan: self.plan.clone(),
        })
    }
}

/// The blocks of a stage of the encoder or decoder.
struct StageBlocks<'a> {
    name: &'a str,
    blocks: &'a [Block],
    /// Which of the stage's curves each block runs along.
    curves: &'a [usize],
}

impl StageBlocks<'_> {
    /// The features behind the stage. `coarse` is added to its children's rows behind the first convolution: so the reference has it.
    fn run(&self, mut x: Tensor, mut coarse: Option<Tensor>, stage: &Stage, trace: &mut Trace<'_>) -> Result<Tensor> {
        let mut add_coarse = |x: Tensor| match coarse.take() {
            Some(coarse) => add_gathered(x, &coarse, stage.parents()?),
            None => Ok(x),
        };
        for (i, (block, &curve)) in self.blocks.iter().zip(self.curves).enumerate() {
            trace.path = format!("{}.block{i}.", self.name);
            let position = block.encode(&x, &stage.conv)?;
            x = add_coarse(x)?;
            x = block.finish(&x, position, stage.along(curve)?, trace)?;
            trace.path = format!("{}.", self.name);
            trace.note(&format!("block{i}"), &x)?;
        }
        x = add_coarse(x)?;
        trace.path.clear();
        trace.note(self.name, &x)?;
        Ok(x)
    }
}
