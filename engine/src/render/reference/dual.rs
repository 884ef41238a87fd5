//! Numbers that carry their derivatives by the parameters of one Gaussian.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// Parameters that the footprint's place and shape depend on: mean 3, quaternion 4, scale 3.
pub(super) const NUM_PARAMETERS: usize = 10;

/// A value and its derivative by each parameter.
#[derive(Clone, Copy, Debug)]
pub(super) struct Dual {
    pub(super) value: f64,
    pub(super) slope: [f64; NUM_PARAMETERS],
}

impl Dual {
    /// A number that depends on no parameter.
    pub(super) const fn constant(value: f64) -> Self {
        Self { value, slope: [0.0; NUM_PARAMETERS] }
    }

    /// The parameter itself.
    pub(super) fn parameter(value: f64, index: usize) -> Self {
        let mut slope = [0.0; NUM_PARAMETERS];
        slope[index] = 1.0;
        Self { value, slope }
    }

    /// The square root; its slope is that of a positive argument.
    pub(super) fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        self.map(root, 0.5 / root)
    }

    /// The number kept within `low..=high`; a constant where it lies outside.
    pub(super) fn clamp(self, low: f64, high: f64) -> Self {
        if (low..=high).contains(&self.value) { self } else { Self::constant(self.value.clamp(low, high)) }
    }

    /// `f(self)` from its value and `f'`.
    fn map(self, value: f64, derivative: f64) -> Self {
        Self { value, slope: self.slope.map(|s| derivative * s) }
    }

    /// `f(self, other)` from its value and both partial derivatives.
    fn zip(self, other: Self, value: f64, by_self: f64, by_other: f64) -> Self {
        let slope = std::array::from_fn(|k| by_self * self.slope[k] + by_other * other.slope[k]);
        Self { value, slope }
    }
}

impl Add for Dual {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        self.zip(other, self.value + other.value, 1.0, 1.0)
    }
}

impl Sub for Dual {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self.zip(other, self.value - other.value, 1.0, -1.0)
    }
}

impl Mul for Dual {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        self.zip(other, self.value * other.value, other.value, self.value)
    }
}

impl Div for Dual {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let value = self.value / other.value;
        self.zip(other, value, 1.0 / other.value, -value / other.value)
    }
}

impl Neg for Dual {
    type Output = Self;
    fn neg(self) -> Self {
        self.map(-self.value, -1.0)
    }
}

impl Mul<Dual> for f64 {
    type Output = Dual;
    fn mul(self, dual: Dual) -> Dual {
        dual.map(self * dual.value, self)
    }
}

impl Add<Dual> for f64 {
    type Output = Dual;
    fn add(self, dual: Dual) -> Dual {
        dual.map(self + dual.value, 1.0)
    }
}
