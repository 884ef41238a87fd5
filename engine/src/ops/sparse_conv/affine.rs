//! A sparse convolution whose outputs are scaled and shifted by channel and may be rectified, as one operation.
//!
//! What training would otherwise do in passes over memory of their own, forward and backward, is folded into the weights.

use std::sync::Arc;

use candle_core::{CpuStorage, CustomOp2, CustomOp3, DType, Layout, Result, Shape, Tensor};
use rayon::prelude::*;

use super::kernel::{Epilogue, PackedWeights, convolve_into};
use super::map::KernelMap;
use super::op::by_features;
use super::weight_gradient::by_weights;
use crate::ops::tensors::{slice, with_values};

/// Rows of one piece of work: fixed, so that results do not depend on the number of threads.
const PIECE: usize = 1 << 12;

/// The convolution, scaled and shifted by output channel, negative results zero where `relu`.
///
/// # Shapes
/// `features` `[map.num_inputs, cin]`, `weight` `[cout, k, k, k, cin]`, `affine` `[2, cout]` (factors, then shifts), all f32; result
/// `[map.num_outputs, cout]`.
///
/// # Formula
/// `factor conv(features) + shift`, then `max(0, .)`
///
/// # Gradient
/// By all three tensors; the map is constant. Sums over rows in f64.
///
/// # Errors
/// When a shape or dtype does not fit the map.
pub fn convolve_affine(
    features: &Tensor,
    weight: &Tensor,
    affine: &Tensor,
    map: &Arc<KernelMap>,
    relu: bool,
) -> Result<Tensor> {
    let ((rows, cin), (cout, k0, k1, k2, weight_cin)) = (features.dims2()?, weight.dims5()?);
    let fits = rows == map.num_inputs() && cin == weight_cin && k0 * k1 * k2 == map.num_offsets();
    if !fits || affine.dims() != [2, cout] || [features, weight, affine].iter().any(|t| t.dtype() != DType::F32) {
        let (inputs, offsets) = (map.num_inputs(), map.num_offsets());
        candle_core::bail!(
            "affine convolution: expected f32 [{inputs}, {weight_cin}], {offsets} offsets, [2, {cout}], found {:?}, {:?}, {:?}",
            features.dims(),
            weight.dims(),
            affine.dims()
        );
    }
    let op = AffineConvolution { map: map.clone(), cin, cout, relu };
    features.contiguous()?.apply_op3(&weight.contiguous()?, &affine.contiguous()?, op)
}

/// `max(0, a + b)` as one operation, with its gradient by both.
///
/// # Errors
/// When the shapes differ, or the values are not f32 on the host.
pub fn add_relu(a: &Tensor, b: &Tensor) -> Result<Tensor> {
    if a.dims() != b.dims() {
        candle_core::bail!("rectified sum: expected equal shapes, found {:?} and {:?}", a.dims(), b.dims());
    }
    a.contiguous()?.apply_op2(&b.contiguous()?, AddRelu)
}

struct AffineConvolution {
    map: Arc<KernelMap>,
    cin: usize,
    cout: usize,
    relu: bool,
}

impl AffineConvolution {
    /// The weights times the factors of their output channels.
    fn scaled(&self, weight: &[f32], affine: &[f32]) -> Vec<f32> {
        let mut scaled = weight.to_vec();
        let per_output = self.map.num_offsets() * self.cin;
        for (row, factor) in scaled.chunks_exact_mut(per_output.max(1)).zip(affine) {
            row.iter_mut().for_each(|w| *w *= factor);
        }
        scaled
    }

    /// Gradients by weights and affine from that by the scaled weights: the scaled weight is `factor w`.
    fn by_parameters(
        &self,
        mut v_scaled: Vec<f32>,
        weight: &[f32],
        affine: &[f32],
        v_shift: Vec<f32>,
    ) -> [Vec<f32>; 2] {
        let per_output = (self.map.num_offsets() * self.cin).max(1);
        let mut v_affine = Vec::with_capacity(2 * self.cout);
        for ((v, w), factor) in v_scaled.chunks_exact_mut(per_output).zip(weight.chunks_exact(per_output)).zip(affine) {
            v_affine.push(single(v.iter().zip(w).map(|(v, w)| f64::from(*v) * f64::from(*w)).sum()));
            v.iter_mut().for_each(|v| *v *= factor);
        }
        v_affine.extend(v_shift);
        [v_scaled, v_affine]
    }
}

impl CustomOp3 for AffineConvolution {
    fn name(&self) -> &'static str {
        "affine-sparse-convolution"
    }

    fn cpu_fwd(
        &self,
        features: &CpuStorage,
        features_layout: &Layout,
        weight: &CpuStorage,
        weight_layout: &Layout,
        affine: &CpuStorage,
        affine_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let (weight, affine) = (slice(weight, weight_layout)?, slice(affine, affine_layout)?);
        let scaled = self.scaled(weight, affine);
        let packed = PackedWeights::of_checkpoint(&scaled, self.map.num_offsets(), self.cin, self.cout);
        let mut out = vec![0.0_f32; self.map.num_outputs() * self.cout];
        let epilogue = Epilogue { bias: Some(&affine[self.cout..]), residual: None, relu: self.relu };
        convolve_into(slice(features, features_layout)?, &packed, &self.map, &epilogue, &mut out);
        Ok((CpuStorage::F32(out), Shape::from((self.map.num_outputs(), self.cout))))
    }

    fn bwd(
        &self,
        features: &Tensor,
        weight: &Tensor,
        affine: &Tensor,
        result: &Tensor,
        v_out: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let given = [features, weight, affine, result, v_out];
        let (v_features, [v_weight, v_affine]) = with_values(given, |[inputs, weight, affine, result, v_out]| {
            let (masked, v_shift) = rectified(result, v_out, self.cout, self.relu);
            let v_sums = if self.relu { masked.as_slice() } else { v_out };
            let mut v_features = vec![0.0_f32; inputs.len()];
            by_features(v_sums, &self.scaled(weight, affine), &self.map, self.cin, &mut v_features);
            let v_scaled = by_weights(inputs, v_sums, &self.map, self.cin, self.cout);
            Ok((v_features, self.by_parameters(v_scaled, weight, affine, v_shift)))
        })?;
        let made = |values: Vec<f32>, like: &Tensor| Tensor::from_vec(values, like.shape(), like.device()).map(Some);
        Ok((made(v_features, features)?, made(v_weight, weight)?, made(v_affine, affine)?))
    }
}

/// The gradient where the result is above zero (everywhere, and empty, without `relu`), and its sums by column.
fn rectified(result: &[f32], v_out: &[f32], width: usize, relu: bool) -> (Vec<f32>, Vec<f32>) {
    let mut masked = vec![0.0_f32; if relu { v_out.len() } else { 0 }];
    let mut sums = vec![0.0_f64; width];
    let size = PIECE * width.max(1);
    let add = |sums: &mut [f64], rows: &[f32]| {
        for row in rows.chunks_exact(width.max(1)) {
            sums.iter_mut().zip(row).for_each(|(sum, &v)| *sum += f64::from(v));
        }
    };
    let parts: Vec<Vec<f64>> = if relu {
        let pieces = masked.par_chunks_mut(size).zip(result.par_chunks(size).zip(v_out.par_chunks(size)));
        let of = |(masked, (result, v_out)): (&mut [f32], (&[f32], &[f32]))| {
            masked_values(masked, result, v_out);
            let mut sums = vec![0.0; width];
            add(&mut sums, masked);
            sums
        };
        pieces.map(of).collect()
    } else {
        let of = |v_out: &[f32]| {
            let mut sums = vec![0.0; width];
            add(&mut sums, v_out);
            sums
        };
        v_out.par_chunks(size).map(of).collect()
    };
    for part in parts {
        sums.iter_mut().zip(part).for_each(|(sum, v)| *sum += v);
    }
    (masked, sums.into_iter().map(single).collect())
}

fn masked_values(out: &mut [f32], result: &[f32], v_out: &[f32]) {
    let values = result.iter().zip(v_out);
    out.iter_mut().zip(values).for_each(|(out, (&result, &v))| *out = if result > 0.0 { v } else { 0.0 });
}

struct AddRelu;

impl CustomOp2 for AddRelu {
    fn name(&self) -> &'static str {
        "rectified-sum"
    }

    fn cpu_fwd(
        &self,
        a: &CpuStorage,
        a_layout: &Layout,
        b: &CpuStorage,
        b_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let (a, b) = (slice(a, a_layout)?, slice(b, b_layout)?);
        let mut out = vec![0.0_f32; a.len()];
        out.par_chunks_mut(PIECE).zip(a.par_chunks(PIECE).zip(b.par_chunks(PIECE))).for_each(|(out, (a, b))| {
            out.iter_mut().zip(a.iter().zip(b)).for_each(|(out, (a, b))| {
                let sum = a + b;
                // Written so that what is no number stays none.
                *out = if sum < 0.0 { 0.0 } else { sum };
            });
        });
        Ok((CpuStorage::F32(out), a_layout.shape().clone()))
    }

    fn bwd(
        &self,
        a: &Tensor,
        _b: &Tensor,
        result: &Tensor,
        v_out: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>)> {
        let masked = with_values([result, v_out], |[result, v_out]| {
            let mut masked = vec![0.0_f32; v_out.len()];
            let pieces = result.par_chunks(PIECE).zip(v_out.par_chunks(PIECE));
            masked.par_chunks_mut(PIECE).zip(pieces).for_each(|(m, (result, v))| masked_values(m, result, v));
            Ok(masked)
        })?;
        let masked = Tensor::from_vec(masked, a.shape(), a.device())?;
        Ok((Some(masked.clone()), Some(masked)))
    }
}

#[expect(clippy::cast_possible_truncation, reason = "gradients are stored in f32")]
fn single(value: f64) -> f32 {
    value as f32
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use candle_core::{Device, Tensor, Var};

    use super::{add_relu, convolve_affine};
    use crate::ops::sparse_conv::{KernelMap, Sites, convolve};
    use crate::ops::test_support::{assert_close, doubles, values};

    fn var(shape: &[usize], seed: u64) -> Var {
        Var::from_vec(values(shape.iter().product(), seed), shape, &Device::Cpu).unwrap()
    }

    /// The same by separate operations, for a map that is its own reverse and for one that is not.
    #[test]
    fn it_is_the_sum_of_its_parts() {
        let voxels: Vec<[i32; 4]> = (0..700).map(|i| [0, i % 9, i / 9 % 7, i % 5 - i / 63]).collect();
        let sites = Sites::unique(&voxels).unwrap().0;
        let halved = KernelMap::halving(&sites).unwrap();
        let maps = [(Arc::new(KernelMap::submanifold(&sites, 3).unwrap()), 3), (halved.down, 2), (halved.up, 2)];
        for (map, kernel) in maps {
            for relu in [true, false] {
                let (cin, cout) = (5, 7);
                let x = var(&[map.num_inputs(), cin], 1);
                let weight = var(&[cout, kernel, kernel, kernel, cin], 2);
                let affine = var(&[2, cout], 3);
                let upstream =
                    Tensor::from_vec(values(map.num_outputs() * cout, 4), (map.num_outputs(), cout), &Device::Cpu)
                        .unwrap();
                let parts = convolve(&x, &weight, &map)
                    .unwrap()
                    .broadcast_mul(&affine.get(0).unwrap())
                    .unwrap()
                    .broadcast_add(&affine.get(1).unwrap())
                    .unwrap();
                let parts = if relu { parts.relu().unwrap() } else { parts };
                let whole = convolve_affine(&x, &weight, &affine, &map, relu).unwrap();
                let list = |t: &Tensor| doubles(&t.flatten_all().unwrap().to_vec1::<f32>().unwrap());
                assert_close("result", &whole, &list(&parts), 1e-6);
                let gradients = |out: &Tensor| (out * &upstream).unwrap().sum_all().unwrap().backward().unwrap();
                let (want, got) = (gradients(&parts), gradients(&whole));
                for (name, var) in [("features", &x), ("weight", &weight), ("affine", &affine)] {
                    assert_close(name, got.get(var).unwrap(), &list(want.get(var).unwrap()), 3e-6);
                }
            }
        }
    }

    #[test]
    fn a_rectified_sum_and_its_slope() {
        let [a, b] = [1, 2].map(|seed| var(&[300, 4], seed));
        let out = add_relu(&a, &b).unwrap();
        let want = (a.as_tensor() + b.as_tensor()).unwrap().relu().unwrap();
        assert_eq!(out.to_vec2::<f32>().unwrap(), want.to_vec2::<f32>().unwrap());
        let (got, want) = (out.sum_all().unwrap().backward().unwrap(), want.sum_all().unwrap().backward().unwrap());
        for var in [&a, &b] {
            assert_eq!(
                got.get(var).unwrap().to_vec2::<f32>().unwrap(),
                want.get(var).unwrap().to_vec2::<f32>().unwrap()
            );
        }
        assert!(add_relu(&a, &var(&[4, 300], 1)).is_err());
    }
}
