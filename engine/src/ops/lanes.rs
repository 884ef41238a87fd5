//! Vector arithmetic and aligned memory that the operations share.

use pulp::Simd;

/// Floats that start on a cache line, so that no vector lies across two.
#[derive(Clone, Debug, Default)]
pub(crate) struct Lines {
    lines: Vec<Line>,
    len: usize,
}

#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C, align(64))]
struct Line([f32; 16]);

impl Lines {
    /// Makes room for `len` values of any content.
    pub(crate) fn resize(&mut self, len: usize) {
        self.lines.resize(len.div_ceil(16), Line([0.0; 16]));
        self.len = len;
    }
}

impl std::ops::Deref for Lines {
    type Target = [f32];

    #[inline(always)]
    fn deref(&self) -> &[f32] {
        &bytemuck::cast_slice(&self.lines)[..self.len]
    }
}

impl std::ops::DerefMut for Lines {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [f32] {
        &mut bytemuck::cast_slice_mut(&mut self.lines)[..self.len]
    }
}

/// `2^x` for `x <= 1`, relative error below 2.5e-7; what is below 2^-126 becomes about 2^-126.
///
/// # Source
/// Round to the nearest integer by adding 1.5 * 2^23; minimax polynomial of degree 5 for 2^f, |f| <= 1/2 (Remez, 7.5e-8).
#[inline(always)]
pub(crate) fn exp2<S: Simd>(simd: S, x: S::f32s) -> S::f32s {
    const ROUNDER: f32 = 12_582_912.0;
    const COEFFICIENTS: [f32; 6] =
        [1.000_000_1, 0.693_146_97, 0.240_221_2, 0.055_507_13, 0.009_675_541, 0.001_327_647_2];
    // The second argument of the maximum is returned when it is NaN.
    let x = simd.max_f32s(simd.splat_f32s(-126.0), x);
    let rounder = simd.splat_f32s(ROUNDER);
    let shifted = simd.add_f32s(x, rounder);
    let f = simd.sub_f32s(x, simd.sub_f32s(shifted, rounder));
    let p = polynomial(simd, f, &COEFFICIENTS);
    let exponent = simd.wrapping_dyn_shl_u32s(simd.transmute_u32s_f32s(shifted), simd.splat_u32s(23));
    let scale = simd.add_u32s(exponent, simd.splat_u32s(1.0_f32.to_bits()));
    simd.mul_f32s(p, simd.transmute_f32s_u32s(scale))
}

/// Beyond this the cumulative normal distribution is 0 or 1 to f32 precision.
pub(crate) const CDF_REACH: f32 = 5.3;

/// Probability that a standard normal value is below `x`, absolute error below 1.1e-7.
///
/// # Source
/// `1/2 + x p(x^2)`; p of degree 14 fitted to `erf(x / sqrt 2) / 2x` on [0, 5.3] for the smallest error of `x^2 p`.
#[inline(always)]
pub(crate) fn normal_cdf<S: Simd>(simd: S, x: S::f32s) -> S::f32s {
    const COEFFICIENTS: [f32; 15] = [
        0.133_392_56,
        -0.066_518_51,
        0.049_264_174,
        -0.039_588_753,
        0.032_079_23,
        -0.025_300_046,
        0.018_928_275,
        -0.013_178_238,
        0.008_818_926,
        -0.005_863_896_6,
        0.003_152_260_6,
        -0.001_082_48,
        0.000_716_410_05,
        -0.000_769_372_74,
        0.000_289_074_93,
    ];
    let x = simd.min_f32s(simd.splat_f32s(CDF_REACH), simd.max_f32s(simd.splat_f32s(-CDF_REACH), x));
    let scale = simd.splat_f32s(2.0 / (CDF_REACH * CDF_REACH));
    let s = simd.mul_add_f32s(simd.mul_f32s(x, x), scale, simd.splat_f32s(-1.0));
    simd.mul_add_f32s(x, polynomial(simd, s, &COEFFICIENTS), simd.splat_f32s(0.5))
}

/// `c[0] + c[1] x + c[2] x^2 + ..`.
#[inline(always)]
fn polynomial<S: Simd, const N: usize>(simd: S, x: S::f32s, coefficients: &[f32; N]) -> S::f32s {
    let mut sum = simd.splat_f32s(coefficients[N - 1]);
    for k in (0..N - 1).rev() {
        sum = simd.mul_add_f32s(sum, x, simd.splat_f32s(coefficients[k]));
    }
    sum
}

#[cfg(test)]
mod tests {
    use pulp::{Simd, WithSimd};

    use super::{exp2, normal_cdf};

    struct Both<'a>(&'a [f32], &'a mut [f32], &'a mut [f32]);

    impl WithSimd for Both<'_> {
        type Output = ();

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            let outputs = S::as_mut_simd_f32s(self.1).0.iter_mut().zip(S::as_mut_simd_f32s(self.2).0);
            for (&x, (power, cdf)) in S::as_simd_f32s(self.0).0.iter().zip(outputs) {
                *power = exp2(simd, x);
                *cdf = normal_cdf(simd, x);
            }
        }
    }

    #[test]
    fn errors_are_as_small_as_said() {
        let x: Vec<f32> = (0..160_000).map(|i| (i as f32 - 150_000.0) / 10_000.0).collect();
        let (mut power, mut cdf) = (vec![0.0; x.len()], vec![0.0; x.len()]);
        pulp::Arch::new().dispatch(Both(&x, &mut power, &mut cdf));
        for (i, &x) in x.iter().enumerate() {
            let x = f64::from(x);
            let want = 0.5 * (1.0 + candle_core::cpu::erf::erf_f64(x / std::f64::consts::SQRT_2));
            assert!((f64::from(cdf[i]) - want).abs() < 1.1e-7, "cdf of {x}: got {}, want {want}", cdf[i]);
            assert!((f64::from(power[i]) / x.exp2() - 1.0).abs() < 2.5e-7, "2^{x}: got {}", power[i]);
        }
    }

    #[test]
    fn what_is_no_number_stays_none() {
        let x = [f32::NAN; 16];
        let (mut power, mut cdf) = ([0.0; 16], [0.0; 16]);
        pulp::Arch::new().dispatch(Both(&x, &mut power, &mut cdf));
        assert!(power.iter().chain(&cdf).all(|v| v.is_nan()));
    }
}
