//! Seeded weights, for size and speed work and for the start of training.

use candle_core::{DType, Device, Result, Shape, Tensor};
use candle_nn::Init;
use candle_nn::var_builder::SimpleBackend;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use sha2::{Digest, Sha256};

/// Draws every tensor from a generator keyed by (seed, name): the same values in any order of construction.
#[derive(Clone, Copy, Debug)]
pub struct RandomWeights {
    /// The seed.
    pub seed: u64,
}

impl SimpleBackend for RandomWeights {
    fn get(&self, shape: Shape, name: &str, init: Init, dtype: DType, device: &Device) -> Result<Tensor> {
        let mut key = Sha256::new();
        key.update(self.seed.to_le_bytes());
        key.update(name.as_bytes());
        let mut rng = ChaCha8Rng::from_seed(key.finalize().into());
        let count = shape.elem_count();
        let values: Vec<f32> = match init {
            Init::Const(value) => vec![single(value); count],
            Init::Uniform { lo, up } => (0..count).map(|_| single(lo + (up - lo) * unit(&mut rng))).collect(),
            Init::Randn { mean, stdev } => (0..count).map(|_| single(mean + stdev * normal(&mut rng))).collect(),
            Init::Kaiming { .. } => {
                candle_core::bail!("tensor {name}: expected an explicit spread, found a Kaiming rule")
            }
        };
        Tensor::from_vec(values, shape, device)?.to_dtype(dtype)
    }

    fn get_unchecked(&self, name: &str, _dtype: DType, _device: &Device) -> Result<Tensor> {
        candle_core::bail!("tensor {name}: asked for without a shape")
    }

    fn contains_tensor(&self, _name: &str) -> bool {
        true
    }
}

/// Uniform in 0..1, never 0.
fn unit(rng: &mut ChaCha8Rng) -> f64 {
    (f64::from(rng.next_u32()) + 0.5) / 4_294_967_296.0
}

/// Standard normal (Box and Muller).
fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let (radius, angle) = ((-2.0 * unit(rng).ln()).sqrt(), std::f64::consts::TAU * unit(rng));
    radius * angle.cos()
}

#[expect(clippy::cast_possible_truncation, reason = "weights are stored in f32")]
fn single(value: f64) -> f32 {
    value as f32
}
