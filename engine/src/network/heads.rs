//! The heads of a pass: from the features of a Gaussian, and what only it knows, to its residuals.

use candle_core::{Result, Tensor};
use candle_nn::VarBuilder;
use rayon::prelude::*;

use super::buffers::Buffers;
use super::linear::{Linear, PackedLinear};
use crate::gaussians::NUM_ATTRIBUTES;
use crate::ops::sparse_conv::KernelMap;

/// Rows of one piece of work: fixed, so that results do not depend on the number of threads.
const PIECE: usize = 1024;

/// What the heads of a pass predict.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outputs {
    /// Attribute residuals and velocities (or their residuals): the `LiDAR` branch.
    Moving,
    /// Attribute residuals: the background.
    Static,
}

/// What the heads of a pass read and predict.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HeadSizes {
    /// Width of the features.
    pub features: usize,
    /// Values of every Gaussian's own that a hidden layer reads beside them.
    pub own: usize,
    /// Width of the hidden layer; `None`: linear heads on the features.
    pub hidden: Option<usize>,
    /// What is predicted.
    pub outputs: Outputs,
}

/// The trainable heads.
#[derive(Clone, Debug)]
pub struct Heads {
    hidden: Option<Linear>,
    gaussian: Linear,
    velocity: Option<Linear>,
}

/// The heads as inference runs them.
#[derive(Clone, Debug)]
pub struct FoldedHeads {
    hidden: Option<PackedLinear>,
    gaussian: PackedLinear,
    velocity: Option<PackedLinear>,
    width: usize,
}

impl Heads {
    /// Makes or loads `gaussian` and, where things move, `velocity`, which start at zero, and, where there is a hidden layer, `hidden`.
    ///
    /// # Errors
    /// When the builder has no such tensor.
    pub fn new(sizes: &HeadSizes, vb: &VarBuilder<'_>) -> Result<Self> {
        let HeadSizes { features, own, hidden, outputs } = *sizes;
        let layer = |width| Linear::new(features + own, width, &vb.pp("hidden"));
        let width = hidden.map_or(features, |hidden| hidden + own);
        let head = |name: &str, cout: usize| Linear::zero(width, cout, &vb.pp(name));
        Ok(Self {
            hidden: hidden.map(layer).transpose()?,
            gaussian: head("gaussian", NUM_ATTRIBUTES)?,
            velocity: (outputs == Outputs::Moving).then(|| head("velocity", 3)).transpose()?,
        })
    }

    /// Whether a hidden layer reads each Gaussian's own state.
    pub const fn read_own(&self) -> bool {
        self.hidden.is_some()
    }

    /// The outputs, differentiable: `[N, 17]`, or `[N, 14]` for what does not move.
    ///
    /// # Shapes
    /// `features` `[N, width]`, `own` `[N, own]`, which heads without a hidden layer do not read.
    ///
    /// # Formula
    /// `W [relu(H [features, own] + h), own] + b`, or `W features + b`.
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn forward(&self, features: &Tensor, own: &Tensor) -> Result<Tensor> {
        let hidden = match &self.hidden {
            Some(layer) => Tensor::cat(&[&layer.forward(&Tensor::cat(&[features, own], 1)?)?.relu()?, own], 1)?,
            None => features.clone(),
        };
        let gaussian = self.gaussian.forward(&hidden)?;
        match &self.velocity {
            Some(head) => Tensor::cat(&[gaussian, head.forward(&hidden)?], 1),
            None => Ok(gaussian),
        }
    }

    /// The form that inference runs.
    ///
    /// # Errors
    /// When a tensor cannot be read.
    pub fn fold(&self) -> Result<FoldedHeads> {
        let gaussian = self.gaussian.pack()?;
        let velocity = self.velocity.as_ref().map(Linear::pack).transpose()?;
        let width = gaussian.cout() + velocity.as_ref().map_or(0, PackedLinear::cout);
        Ok(FoldedHeads { hidden: self.hidden.as_ref().map(Linear::pack).transpose()?, gaussian, velocity, width })
    }
}

impl FoldedHeads {
    /// Number of outputs.
    pub const fn num_outputs(&self) -> usize {
        self.width
    }

    /// Whether a hidden layer reads each Gaussian's own state: else the outputs are the same for equal features.
    pub const fn read_own(&self) -> bool {
        self.hidden.is_some()
    }

    /// The outputs `[rows, outputs]`, a buffer of `buffers`.
    ///
    /// Piece by piece, so that what lies between the layers stays in the caches and takes no memory worth mention.
    ///
    /// # Shapes
    /// As [`Heads::forward`].
    pub fn forward(&self, features: &[f32], own: &[f32], rows: usize, buffers: &mut Buffers) -> Vec<f32> {
        let mut outputs = buffers.take(rows * self.width);
        let widths = [features, own].map(|values| values.len() / rows.max(1));
        let pieces = outputs.par_chunks_mut((PIECE * self.width).max(1)).enumerate();
        pieces.for_each_init(Buffers::default, |scratch, (k, out)| {
            let rows = out.len() / self.width;
            let of = |width: usize| k * PIECE * width..(k * PIECE + rows) * width;
            let parts = [&features[of(widths[0])], &own[of(widths[1])]];
            self.piece(parts, &KernelMap::identity(rows), out, scratch);
        });
        outputs
    }

    /// The outputs of some rows of the features and of what each Gaussian has of its own.
    fn piece(&self, [features, own]: [&[f32]; 2], map: &KernelMap, out: &mut [f32], scratch: &mut Buffers) {
        let Some(layer) = &self.hidden else { return self.linear(features, map, out, scratch) };
        let rows = map.num_outputs();
        let mut joined = scratch.take(features.len() + own.len());
        join(features, own, rows, &mut joined);
        let mut hidden = scratch.take(rows * layer.cout());
        layer.forward_relu(&joined, map, &mut hidden);
        let mut read = scratch.take(hidden.len() + own.len());
        join(&hidden, own, rows, &mut read);
        self.linear(&read, map, out, scratch);
        [joined, hidden, read].into_iter().for_each(|buffer| scratch.give(buffer));
    }

    fn linear(&self, features: &[f32], map: &KernelMap, out: &mut [f32], scratch: &mut Buffers) {
        let Some(head) = &self.velocity else { return self.gaussian.forward(features, map, None, out) };
        let rows = map.num_outputs();
        let mut gaussian = scratch.take(rows * self.gaussian.cout());
        self.gaussian.forward(features, map, None, &mut gaussian);
        let mut velocity = scratch.take(rows * head.cout());
        head.forward(features, map, None, &mut velocity);
        join(&gaussian, &velocity, rows, out);
        [gaussian, velocity].into_iter().for_each(|buffer| scratch.give(buffer));
    }
}

/// Nothing: `joined` holds the rows of both one after the other.
fn join(first: &[f32], second: &[f32], rows: usize, joined: &mut [f32]) {
    let [a, b] = [first, second].map(|values| values.len() / rows.max(1));
    if a > 0 && b > 0 {
        let parts = first.chunks_exact(a).zip(second.chunks_exact(b));
        joined.chunks_exact_mut(a + b).zip(parts).for_each(|(row, (first, second))| {
            row[..a].copy_from_slice(first);
            row[a..].copy_from_slice(second);
        });
    }
}

#[cfg(test)]
mod tests {
    use candle_core::{DType, Device, Tensor, Var};
    use candle_nn::VarBuilder;

    use super::{Buffers, HeadSizes, Heads, Outputs};
    use crate::network::linear::Linear;

    const ROWS: usize = 9;
    const SIZES: HeadSizes = HeadSizes { features: 6, own: 5, hidden: Some(7), outputs: Outputs::Moving };

    fn values(len: usize, salt: usize) -> Vec<f32> {
        (0..len).map(|k| ((k * 53 + salt * 29 + 7) % 97) as f32 / 97.0 - 0.5).collect()
    }

    fn linear(weight: &Tensor, cout: usize, salt: usize) -> Linear {
        let bias = Tensor::from_vec(values(cout, salt), cout, &Device::Cpu).unwrap();
        Linear { weight: weight.clone(), bias }
    }

    fn weight(cout: usize, cin: usize, salt: usize) -> Tensor {
        Tensor::from_vec(values(cout * cin, salt), (cout, cin), &Device::Cpu).unwrap()
    }

    fn heads(hidden: &Tensor) -> Heads {
        Heads {
            hidden: Some(linear(hidden, 7, 1)),
            gaussian: linear(&weight(14, 12, 2), 14, 3),
            velocity: Some(linear(&weight(3, 12, 4), 3, 5)),
        }
    }

    fn inputs() -> [Tensor; 2] {
        [(6, 6), (5, 7)]
            .map(|(width, salt)| Tensor::from_vec(values(ROWS * width, salt), (ROWS, width), &Device::Cpu).unwrap())
    }

    #[test]
    fn folded_heads_equal_the_trainable_ones() {
        let (heads, [features, own]) = (heads(&weight(7, 11, 8)), inputs());
        let flat = |t: &Tensor| t.flatten_all().unwrap().to_vec1::<f32>().unwrap();
        let want = flat(&heads.forward(&features, &own).unwrap());
        let folded = heads.fold().unwrap();
        let got = folded.forward(&flat(&features), &flat(&own), ROWS, &mut Buffers::default());
        assert_eq!((folded.num_outputs(), got.len()), (17, ROWS * 17));
        let worst = got.iter().zip(&want).map(|(g, w)| (g - w).abs()).fold(0.0, f32::max);
        assert!(worst < 1e-5, "{worst}");
    }

    #[test]
    fn the_gradient_of_the_hidden_layer_is_the_finite_difference() {
        let (hidden, [features, own]) = (Var::from_tensor(&weight(7, 11, 8)).unwrap(), inputs());
        let loss = |hidden: &Tensor| heads(hidden).forward(&features, &own).unwrap().sqr().unwrap().sum_all().unwrap();
        let store = loss(hidden.as_tensor()).backward().unwrap();
        let gradient = store.get(hidden.as_tensor()).unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap();
        let start = hidden.as_tensor().flatten_all().unwrap().to_vec1::<f32>().unwrap();
        for at in [0, 13, 40, 76] {
            let moved = |by: f32| {
                let mut values = start.clone();
                values[at] += by;
                let moved = Tensor::from_vec(values, (7, 11), &Device::Cpu).unwrap();
                f64::from(loss(&moved).to_scalar::<f32>().unwrap())
            };
            let want = (moved(5e-3) - moved(-5e-3)) / 1e-2;
            let got = f64::from(gradient[at]);
            assert!((got - want).abs() < 0.02 * want.abs().max(1.0), "{at}: {got} {want}");
        }
    }

    #[test]
    fn new_heads_say_nothing() {
        let vb = VarBuilder::zeros(DType::F32, &Device::Cpu);
        let heads = Heads::new(&SIZES, &vb).unwrap();
        let [features, own] = inputs();
        let sum = heads.forward(&features, &own).unwrap().abs().unwrap().sum_all().unwrap();
        assert_eq!(sum.to_scalar::<f32>().unwrap(), 0.0);
    }
}
