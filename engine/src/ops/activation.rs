//! Activations with exact gradients.

use candle_core::{CpuStorage, CustomOp1, InplaceOp1, Layout, Result, Shape, Tensor};
use pulp::{Simd, WithSimd};

use super::lanes::{CDF_REACH, exp2, normal_cdf};
use super::tensors::{slice, slice_mut, with_values};
use crate::parallel;

/// Values of one piece of work.
const PIECE: usize = 1 << 14;

/// `x` times the probability that a standard normal value is below x.
///
/// # Formula
/// `x (1 + erf(x / sqrt 2)) / 2`, absolute error below 1e-6.
///
/// # Gradient
/// `Phi(x) + x phi(x)`
///
/// # Errors
/// When the values are not f32 on the host.
pub(crate) fn gelu(x: &Tensor) -> Result<Tensor> {
    x.contiguous()?.apply_op1(Activation::Gelu)
}

/// [`gelu`] of a tensor that nobody else holds: in its memory where no gradient is asked for.
///
/// # Errors
/// As [`gelu`].
pub(crate) fn gelu_owned(x: Tensor) -> Result<Tensor> {
    if x.track_op() {
        return gelu(&x);
    }
    let x = x.contiguous()?;
    x.inplace_op1(&Activation::Gelu)?;
    Ok(x)
}

/// `max(x, 0)`.
///
/// # Gradient
/// 1 above 0, else 0.
///
/// # Errors
/// When the values are not f32 on the host.
pub(crate) fn relu(x: &Tensor) -> Result<Tensor> {
    x.contiguous()?.apply_op1(Activation::Relu)
}

/// [`gelu`] in place.
#[inline(always)]
pub(crate) fn gelu_in_place<S: Simd>(simd: S, values: &mut [f32]) {
    in_place::<S, VALUE>(simd, values);
}

#[derive(Clone, Copy, Debug)]
enum Activation {
    Gelu,
    Relu,
}

#[inline(always)]
fn gelu_lanes<S: Simd>(simd: S, x: S::f32s) -> S::f32s {
    // Below the reach the product would grow with x; the second argument of the maximum is returned when it is NaN.
    simd.mul_f32s(simd.max_f32s(simd.splat_f32s(-CDF_REACH), x), normal_cdf(simd, x))
}

#[inline(always)]
fn gelu_slope<S: Simd>(simd: S, x: S::f32s) -> S::f32s {
    const HALF_LOG2_E: f32 = std::f32::consts::LOG2_E * 0.5;
    // 1 / sqrt(2 pi)
    const PEAK: f32 = 0.398_942_3;
    let power = simd.mul_f32s(simd.mul_f32s(x, x), simd.splat_f32s(-HALF_LOG2_E));
    let density = simd.mul_f32s(exp2(simd, power), simd.splat_f32s(PEAK));
    simd.mul_add_f32s(x, density, normal_cdf(simd, x))
}

/// What replaces a value.
const VALUE: bool = false;
const SLOPE: bool = true;

/// The function is chosen by a constant: through a closure or a pointer it would be called, value by value, without vector registers.
#[inline(always)]
fn in_place<S: Simd, const WHAT: bool>(simd: S, values: &mut [f32]) {
    let (head, tail) = S::as_mut_simd_f32s(values);
    for v in head {
        *v = if WHAT == SLOPE { gelu_slope(simd, *v) } else { gelu_lanes(simd, *v) };
    }
    if !tail.is_empty() {
        let v = simd.partial_load_f32s(tail);
        simd.partial_store_f32s(tail, if WHAT == SLOPE { gelu_slope(simd, v) } else { gelu_lanes(simd, v) });
    }
}

struct InPlace<'a, const WHAT: bool>(&'a mut [f32]);

impl<const WHAT: bool> WithSimd for InPlace<'_, WHAT> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        in_place::<S, WHAT>(simd, self.0);
    }
}

impl Activation {
    /// Replaces the values of one piece.
    fn replace(self, arch: pulp::Arch, values: &mut [f32]) {
        match self {
            Self::Gelu => arch.dispatch(InPlace::<VALUE>(values)),
            Self::Relu => values.iter_mut().for_each(|v| *v = if *v < 0.0 { 0.0 } else { *v }),
        }
    }
}

impl InplaceOp1 for Activation {
    fn name(&self) -> &'static str {
        CustomOp1::name(self)
    }

    fn cpu_fwd(&self, storage: &mut CpuStorage, layout: &Layout) -> Result<()> {
        let arch = pulp::Arch::new();
        parallel::for_chunks(slice_mut(storage, layout)?, PIECE, &|_, values| self.replace(arch, values));
        Ok(())
    }
}

impl CustomOp1 for Activation {
    fn name(&self) -> &'static str {
        match self {
            Self::Gelu => "gelu",
            Self::Relu => "relu",
        }
    }

    fn cpu_fwd(&self, storage: &CpuStorage, layout: &Layout) -> Result<(CpuStorage, Shape)> {
        let x = slice(storage, layout)?;
        let mut out = vec![0.0_f32; x.len()];
        let arch = pulp::Arch::new();
        parallel::for_chunks(&mut out, PIECE, &|piece, out| {
            out.copy_from_slice(&x[piece * PIECE..][..out.len()]);
            self.replace(arch, out);
        });
        Ok((CpuStorage::F32(out), layout.shape().clone()))
    }

    fn bwd(&self, x: &Tensor, _result: &Tensor, v_out: &Tensor) -> Result<Option<Tensor>> {
        let v_x = with_values([x, v_out], |[x, v_out]| {
            let mut v_x = vec![0.0_f32; x.len()];
            let arch = pulp::Arch::new();
            parallel::for_chunks(&mut v_x, PIECE, &|piece, v_x| {
                let [x, v_out] = [x, v_out].map(|values| &values[piece * PIECE..][..v_x.len()]);
                match self {
                    Self::Gelu => {
                        v_x.copy_from_slice(x);
                        arch.dispatch(InPlace::<SLOPE>(v_x));
                        v_x.iter_mut().zip(v_out).for_each(|(v_x, v)| *v_x *= v);
                    }
                    Self::Relu => {
                        let values = x.iter().zip(v_out);
                        v_x.iter_mut().zip(values).for_each(|(v_x, (&x, &v))| *v_x = if x > 0.0 { v } else { 0.0 });
                    }
                }
            });
            Ok(v_x)
        })?;
        Tensor::from_vec(v_x, x.shape(), x.device()).map(Some)
    }
}

#[cfg(test)]
mod tests {
    use candle_core::{Device, Tensor, Var};

    use super::{gelu, relu};
    use crate::ops::test_support::assert_close;

    fn twin(x: f64) -> f64 {
        0.5 * x * (1.0 + candle_core::cpu::erf::erf_f64(x / std::f64::consts::SQRT_2))
    }

    fn line() -> Vec<f32> {
        (-1003..=1003).map(|i| i as f32 * 0.011).collect()
    }

    #[test]
    fn gelu_and_its_slope() {
        let x = line();
        let var = Var::from_slice(&x, x.len(), &Device::Cpu).unwrap();
        let out = gelu(&var).unwrap();
        let owned = super::gelu_owned(var.as_tensor().copy().unwrap().detach()).unwrap();
        assert_eq!(owned.to_vec1::<f32>().unwrap(), out.to_vec1::<f32>().unwrap());
        let slope = out.sum_all().unwrap().backward().unwrap().get(&var).unwrap().to_vec1::<f32>().unwrap();
        for (i, out) in out.to_vec1::<f32>().unwrap().into_iter().enumerate() {
            let at = f64::from(x[i]);
            assert!((f64::from(out) - twin(at)).abs() < 1e-6, "gelu({at}): got {out}, want {}", twin(at));
            let want = (twin(at + 1e-5) - twin(at - 1e-5)) / 2e-5;
            assert!((f64::from(slope[i]) - want).abs() < 2e-6, "slope at {at}: got {}, want {want}", slope[i]);
        }
    }

    #[test]
    fn far_out_and_no_number() {
        let x = Tensor::new(&[-1e30_f32, -100.0, 100.0, f32::NAN], &Device::Cpu).unwrap();
        let out = gelu(&x).unwrap().to_vec1::<f32>().unwrap();
        assert!(out[0].abs() < 1e-6 && out[1].abs() < 1e-6 && out[2] == 100.0 && out[3].is_nan(), "{out:?}");
        assert!(relu(&x).unwrap().to_vec1::<f32>().unwrap()[3].is_nan());
    }

    #[test]
    fn relu_and_its_slope() {
        let x = line();
        let var = Var::from_slice(&x, x.len(), &Device::Cpu).unwrap();
        let out = relu(&var).unwrap();
        assert_close("relu", &out, &x.iter().map(|&x| f64::from(x).max(0.0)).collect::<Vec<f64>>(), 0.0);
        let grads = out.sum_all().unwrap().backward().unwrap();
        let want: Vec<f64> = x.iter().map(|&x| if x > 0.0 { 1.0 } else { 0.0 }).collect();
        assert_close("relu slope", grads.get(&var).unwrap(), &want, 0.0);
    }
}
