//! A small generator of repeatable numbers.

/// `SplitMix64` (Steele, Lea, Flood 2014).
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    /// The generator with this seed.
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next 64 bits.
    pub const fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in `low..high`, and a value of f32 so that both precisions can hold it.
    #[expect(clippy::cast_possible_truncation, reason = "rounding to f32 is the point")]
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        let unit = (self.bits() >> 11) as f64 / (1_u64 << 53) as f64;
        f64::from((low + (high - low) * unit) as f32)
    }

    /// `N` draws of [`Random::uniform`].
    pub fn uniforms<const N: usize>(&mut self, low: f64, high: f64) -> [f64; N] {
        std::array::from_fn(|_| self.uniform(low, high))
    }

    /// Standard normal.
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform(0.0, 0.999_999)).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform(0.0, 1.0)).cos()
    }

    /// [`Random::uniform`] as the f32 that it is.
    #[expect(clippy::cast_possible_truncation, reason = "the value is one of f32")]
    pub fn uniform_single(&mut self, low: f64, high: f64) -> f32 {
        self.uniform(low, high) as f32
    }

    /// [`Random::normal`], rounded.
    #[expect(clippy::cast_possible_truncation, reason = "rounding to f32 is the point")]
    pub fn normal_single(&mut self) -> f32 {
        self.normal() as f32
    }

    /// A random order of `0..len`.
    pub fn order(&mut self, len: usize) -> Vec<usize> {
        let mut keyed: Vec<(u64, usize)> = (0..len).map(|i| (self.bits(), i)).collect();
        keyed.sort_unstable();
        keyed.into_iter().map(|(_, i)| i).collect()
    }
}
