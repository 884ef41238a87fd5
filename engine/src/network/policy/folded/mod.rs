//! The policy as inference runs it.

mod block;
mod heads;
mod resample;

use candle_core::Result;

use super::config::CurvePlan;
use super::geometry::{Geometry, Stage};
use super::layers::{Affine, LayerNorm, Linear, doubles, singles};
use super::{Block, Policy};
use crate::network::buffers::Buffers;
use crate::ops::dense::Packed;
use block::FoldedBlock;
use heads::FoldedHead;
use resample::{FoldedDown, FoldedStem, FoldedUp};

/// The policy with its weights packed and normalisation folded away where it can be.
#[derive(Clone, Debug)]
pub struct FoldedPolicy {
    stem: FoldedStem,
    encoder: Vec<(Option<FoldedDown>, Vec<FoldedBlock>)>,
    decoder: Vec<(FoldedUp, Vec<FoldedBlock>)>,
    prune: FoldedHead,
    add: FoldedHead,
    plan: CurvePlan,
}

/// A dense layer with its weights packed.
#[derive(Clone, Debug)]
struct PackedLinear {
    weights: Packed,
    bias: Vec<f32>,
}

/// Weight and bias of a normalisation of rows.
#[derive(Clone, Debug)]
struct Norm {
    weight: Vec<f32>,
    bias: Vec<f32>,
}

impl PackedLinear {
    fn new(linear: &Linear) -> Result<Self> {
        let (outputs, inputs) = linear.weight.dims2()?;
        let weights = Packed::of_checkpoint(&singles(&linear.weight)?, inputs, outputs);
        Ok(Self { weights, bias: singles(&linear.bias)? })
    }

    /// A dense layer followed by `x factor + shift`.
    fn with_affine(linear: &Linear, affine: &Affine) -> Result<Self> {
        let (outputs, inputs) = linear.weight.dims2()?;
        let (weight, bias) = (doubles(&linear.weight)?, doubles(&linear.bias)?);
        let scaled: Vec<f32> = weight.iter().enumerate().map(|(i, w)| single(w * affine.factor[i / inputs])).collect();
        let bias = bias.iter().zip(&affine.factor).zip(&affine.shift).map(|((b, f), s)| single(b * f + s)).collect();
        Ok(Self { weights: Packed::of_checkpoint(&scaled, inputs, outputs), bias })
    }
}

impl Norm {
    fn new(norm: &LayerNorm) -> Result<Self> {
        Ok(Self { weight: singles(&norm.weight)?, bias: singles(&norm.bias)? })
    }

    fn parameters(&self) -> [&[f32]; 2] {
        [&self.weight, &self.bias]
    }
}

/// Told the features after every stage, for tests.
pub type Observer<'a> = &'a mut dyn FnMut(&str, &[f32]);

impl FoldedPolicy {
    pub(super) fn new(policy: &Policy) -> Result<Self> {
        let blocks = |blocks: &[Block]| blocks.iter().map(FoldedBlock::new).collect::<Result<Vec<_>>>();
        let encoder = policy
            .encoder
            .iter()
            .map(|(down, stage)| Ok((down.as_ref().map(FoldedDown::new).transpose()?, blocks(stage)?)));
        let decoder = policy.decoder.iter().map(|(up, stage)| Ok((FoldedUp::new(up)?, blocks(stage)?)));
        Ok(Self {
            stem: FoldedStem::new(&policy.stem)?,
            encoder: encoder.collect::<Result<_>>()?,
            decoder: decoder.collect::<Result<_>>()?,
            prune: FoldedHead::new(&policy.prune)?,
            add: FoldedHead::new(&policy.add)?,
            plan: policy.plan.clone(),
        })
    }

    /// Scores of the voxels: the probabilities of pruning and of adding.
    ///
    /// # Shapes
    /// `features` `[M, inputs]` of the finest voxels; result `[M, 2]`, each in 0..1.
    ///
    /// # Errors
    /// When the geometry belongs to other voxels or to another config.
    pub fn scores(&self, features: &[f32], geometry: &Geometry, buffers: &mut Buffers) -> Result<Vec<[f32; 2]>> {
        let features = self.features(features, geometry, buffers, &mut |_, _| ())?;
        let scores = heads::scores(&features, [&self.prune, &self.add]);
        buffers.give(features);
        Ok(scores)
    }

    /// Features of the finest voxels, a buffer of `buffers`; `observer` is told those of every stage on the way.
    ///
    /// # Shapes
    /// `features` `[M, inputs]`; result `[M, channels of the finest stage]`.
    ///
    /// # Errors
    /// As [`FoldedPolicy::scores`].
    pub fn features(
        &self,
        features: &[f32],
        geometry: &Geometry,
        buffers: &mut Buffers,
        observer: Observer<'_>,
    ) -> Result<Vec<f32>> {
        let (expected, stages) = (geometry.num_sites() * self.stem.inputs(), geometry.stages.len());
        if features.len() != expected || stages != self.encoder.len() {
            let found = features.len();
            candle_core::bail!(
                "policy: expected {expected} values and {} stages, found {found} and {stages}",
                self.encoder.len()
            );
        }
        let mut x = self.stem.forward(features, &geometry.stem, buffers);
        observer("embedding", &x);
        let mut skips = Vec::new();
        for (s, ((down, blocks), stage)) in self.encoder.iter().zip(&geometry.stages).enumerate() {
            if let Some(down) = down {
                let coarse = down.forward(&x, geometry.stages[s - 1].parents()?, buffers);
                skips.push(std::mem::replace(&mut x, coarse));
                observer(&format!("enc{s}.down"), &x);
            }
            run((blocks, &self.plan.encoder[s]), &mut x, None, stage, buffers)?;
            observer(&format!("enc{s}"), &x);
        }
        for (s, ((up, blocks), stage)) in self.decoder.iter().zip(&geometry.stages).enumerate().rev() {
            let Some(skip) = skips.pop() else { continue };
            let [fine, coarse] = up.forward(&x, &skip, buffers);
            buffers.give(skip);
            buffers.give(std::mem::replace(&mut x, fine));
            run((blocks, &self.plan.decoder[s]), &mut x, Some(&coarse), stage, buffers)?;
            buffers.give(coarse);
            observer(&format!("dec{s}"), &x);
        }
        Ok(x)
    }
}

/// Runs the blocks of a stage in place. `coarse` is added to their parents' rows behind the first convolution: so the reference has it.
fn run(
    (blocks, curves): (&[FoldedBlock], &[usize]),
    x: &mut [f32],
    mut coarse: Option<&[f32]>,
    stage: &Stage,
    buffers: &mut Buffers,
) -> Result<()> {
    let mut add_coarse = |x: &mut [f32]| match coarse.take() {
        Some(coarse) => stage.parents().map(|parents| resample::add_parents(x, coarse, parents)),
        None => Ok(()),
    };
    let mut position = buffers.take(x.len());
    for (block, &curve) in blocks.iter().zip(curves) {
        block.convolve(x, &stage.conv, &mut position);
        add_coarse(x)?;
        block.finish(x, stage.along(curve)?, &position);
    }
    buffers.give(position);
    add_coarse(x)
}

#[expect(clippy::cast_possible_truncation, reason = "parameters are stored in f32")]
fn single(value: f64) -> f32 {
    value as f32
}
