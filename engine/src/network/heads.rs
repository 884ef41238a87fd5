//! The heads of a pass: from the features of a Gaussian, and what only it knows, to its residuals.

use candle_core::{Result, Tensor};
use candle_nn::VarBuilder;

use super::linear::{Linear, by_pieces};
use crate::gaussians::NUM_ATTRIBUTES;
use crate::ops::activation::relu;

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
    /// Inputs of every Gaussian that a hidden layer reads beside them.
    pub point_inputs: usize,
    /// Width of the hidden layer; `None`: linear heads on the features.
    pub hidden: Option<usize>,
    /// What is predicted.
    pub outputs: Outputs,
}

/// The heads.
#[derive(Clone, Debug)]
pub struct Heads {
    hidden: Option<Linear>,
    gaussian: Linear,
    velocity: Option<Linear>,
}

impl Heads {
    /// Makes or loads `gaussian` and, where things move, `velocity`, which start at zero, and, where there is a hidden layer, `hidden`.
    ///
    /// # Errors
    /// When the builder has no such tensor.
    pub fn new(sizes: &HeadSizes, vb: &VarBuilder<'_>) -> Result<Self> {
        let HeadSizes { features, point_inputs, hidden, outputs } = *sizes;
        let layer = |width| Linear::new(features + point_inputs, width, &vb.pp("hidden"));
        let width = hidden.map_or(features, |hidden| hidden + point_inputs);
        let head = |name: &str, cout: usize| Linear::zero(width, cout, &vb.pp(name));
        Ok(Self {
            hidden: hidden.map(layer).transpose()?,
            gaussian: head("gaussian", NUM_ATTRIBUTES)?,
            velocity: (outputs == Outputs::Moving).then(|| head("velocity", 3)).transpose()?,
        })
    }

    /// Whether a hidden layer reads the inputs of each Gaussian: else the outputs are the same for equal features.
    pub(crate) const fn read_point_inputs(&self) -> bool {
        self.hidden.is_some()
    }

    /// The outputs: `[N, 17]`, or `[N, 14]` for what does not move.
    ///
    /// # Shapes
    /// `features` `[N, width]`, `point_inputs` `[N, point_inputs]`, which heads without a hidden layer do not read.
    ///
    /// # Formula
    /// `W [relu(H [f, u] + h), u] + b` of features f and inputs u, or `W f + b`.
    ///
    /// # Gradient
    /// By all tensors; folded heads have none.
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn forward(&self, features: &Tensor, point_inputs: &Tensor) -> Result<Tensor> {
        let Some(hidden) = &self.hidden else { return by_pieces([features], |[features]| self.linear(features)) };
        by_pieces([features, point_inputs], |[features, inputs]| {
            let hidden = relu(&hidden.forward(&Tensor::cat(&[features, inputs], 1)?)?)?;
            self.linear(&Tensor::cat(&[&hidden, inputs], 1)?)
        })
    }

    fn linear(&self, read: &Tensor) -> Result<Tensor> {
        let gaussian = self.gaussian.forward(read)?;
        match &self.velocity {
            Some(head) => Tensor::cat(&[gaussian, head.forward(read)?], 1),
            None => Ok(gaussian),
        }
    }

    /// The heads as inference runs them.
    ///
    /// # Errors
    /// When a tensor cannot be read.
    pub fn fold(&self) -> Result<Self> {
        let fold = |layer: &Option<Linear>| layer.as_ref().map(Linear::fold).transpose();
        Ok(Self { hidden: fold(&self.hidden)?, gaussian: self.gaussian.fold()?, velocity: fold(&self.velocity)? })
    }
}

#[cfg(test)]
mod tests {
    use candle_core::{DType, Device, Tensor, Var};
    use candle_nn::VarBuilder;

    use super::{HeadSizes, Heads, Outputs};
    use crate::network::linear::Linear;

    const ROWS: usize = 9;
    const SIZES: HeadSizes = HeadSizes { features: 6, point_inputs: 5, hidden: Some(7), outputs: Outputs::Moving };

    fn values(len: usize, salt: usize) -> Vec<f32> {
        (0..len).map(|k| ((k * 53 + salt * 29 + 7) % 97) as f32 / 97.0 - 0.5).collect()
    }

    fn linear(weight: &Tensor, cout: usize, salt: usize) -> Linear {
        let bias = Tensor::from_vec(values(cout, salt), cout, &Device::Cpu).unwrap();
        Linear::of(weight.clone(), bias)
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

    fn inputs(rows: usize) -> [Tensor; 2] {
        [(6, 6), (5, 7)]
            .map(|(width, salt)| Tensor::from_vec(values(rows * width, salt), (rows, width), &Device::Cpu).unwrap())
    }

    /// Whole, as training runs them, and piece by piece.
    #[test]
    fn folded_heads_are_the_same_to_the_bit() {
        let heads = heads(&weight(7, 11, 8));
        for rows in [ROWS, 2500] {
            let [features, point_inputs] = inputs(rows);
            let tracked = Var::from_tensor(&features).unwrap();
            let want = heads.forward(&tracked, &point_inputs).unwrap();
            let got = heads.fold().unwrap().forward(&features, &point_inputs).unwrap();
            assert_eq!((got.dims(), got.to_vec2::<f32>().unwrap()), (&[rows, 17][..], want.to_vec2::<f32>().unwrap()));
        }
    }

    #[test]
    fn the_gradient_of_the_hidden_layer_is_the_finite_difference() {
        let (hidden, [features, point_inputs]) = (Var::from_tensor(&weight(7, 11, 8)).unwrap(), inputs(ROWS));
        let loss = |hidden: &Tensor| {
            heads(hidden).forward(&features, &point_inputs).unwrap().sqr().unwrap().sum_all().unwrap()
        };
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
        let [features, point_inputs] = inputs(ROWS);
        let sum = heads.forward(&features, &point_inputs).unwrap().abs().unwrap().sum_all().unwrap();
        assert_eq!(sum.to_scalar::<f32>().unwrap(), 0.0);
    }
}
