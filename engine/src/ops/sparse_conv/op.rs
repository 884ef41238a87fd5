//! Sparse convolution as a candle operation: bias, residual and rectifier in the same pass over memory.

use std::sync::Arc;

use candle_core::{CpuStorage, CustomOp2, CustomOp3, DType, Layout, Result, Shape, Tensor};

use super::kernel::{Epilogue, convolve_into};
use super::map::{KernelMap, Symmetry};
use super::pack::{ConvWeights, PackedWeights, WeightShape, single};
use super::weight_gradient::by_weights;
use crate::ops::tensors::{slice, with_values};
use crate::parallel;

/// Rows of one piece of work: fixed, so that results do not depend on the number of threads.
const PIECE: usize = 1 << 12;

/// The sparse convolution of features by a kernel map, `residual` added where there is one, negative results zero where `relu`.
///
/// # Shapes
/// `features` `[map.num_inputs, cin]`, `residual` and result `[map.num_outputs, cout]`, all f32.
///
/// # Formula
/// `max(0, W * features + b + residual)`
///
/// # Gradient
/// By all tensors; the map is constant. Sums over rows in f64.
///
/// # Errors
/// When a shape or dtype does not fit the map.
pub fn convolve(
    features: &Tensor,
    weights: &ConvWeights,
    residual: Option<&Tensor>,
    map: &Arc<KernelMap>,
    relu: bool,
) -> Result<Tensor> {
    let shape = weights.shape;
    let (inputs, outputs) = ([map.num_inputs(), shape.cin], [map.num_outputs(), shape.cout]);
    let misfit = features.dims() != inputs || residual.is_some_and(|residual| residual.dims() != outputs);
    let given = [Some(features), residual];
    if misfit || shape.num_offsets != map.num_offsets() || given.iter().flatten().any(|t| t.dtype() != DType::F32) {
        candle_core::bail!(
            "sparse convolution: expected f32 features {inputs:?}, residual {outputs:?}, {} kernel offsets, found {:?} {:?}, \
             {:?}, {}",
            map.num_offsets(),
            features.dtype(),
            features.dims(),
            residual.map(Tensor::dims),
            shape.num_offsets
        );
    }
    let op = Convolution { map: map.clone(), shape, relu };
    match residual {
        None => features.contiguous()?.apply_op2(&weights.values, op),
        Some(residual) => features.contiguous()?.apply_op3(&weights.values, &residual.contiguous()?, op),
    }
}

/// Gradient of a scalar by the features, from its gradient by the output rows.
///
/// # Shapes
/// `v_out` `[map.num_outputs, cout]`; result `[map.num_inputs, cin]` in `v_features`.
pub fn by_features(v_out: &[f32], weights: &PackedWeights<'_>, map: &KernelMap, v_features: &mut [f32]) {
    // A map that is its own reverse but for the order of the offsets serves with the weights in that order.
    let mirrored = map.symmetry == Symmetry::Mirrored;
    let (shape, packed) = weights.transposed(|o| if mirrored { map.num_offsets() - 1 - o } else { o });
    let packed = PackedWeights::new(shape, &packed);
    if mirrored {
        convolve_into(v_out, &packed, map, &Epilogue::default(), v_features);
    } else {
        convolve_into(v_out, &packed, &map.reversed(), &Epilogue::default(), v_features);
    }
}

struct Convolution {
    map: Arc<KernelMap>,
    shape: WeightShape,
    relu: bool,
}

impl Convolution {
    fn forward(&self, features: &[f32], values: &[f32], residual: Option<&[f32]>) -> (CpuStorage, Shape) {
        let weights = PackedWeights::new(self.shape, values);
        let epilogue = Epilogue { bias: Some(&values[self.shape.num_packed()..]), residual, relu: self.relu };
        let mut out = vec![0.0_f32; self.map.num_outputs() * self.shape.cout];
        convolve_into(features, &weights, &self.map, &epilogue, &mut out);
        (CpuStorage::F32(out), Shape::from((self.map.num_outputs(), self.shape.cout)))
    }

    /// Gradients by features, packed values and residual.
    fn backward(&self, features: &Tensor, values: &Tensor, result: &Tensor, v_out: &Tensor) -> Result<[Tensor; 3]> {
        let shape = self.shape;
        let given = [features, values, result, v_out];
        let (v_features, v_values, masked) = with_values(given, |[inputs, values, result, v_out]| {
            let (masked, v_bias) = rectified(result, v_out, shape.cout, self.relu);
            let v_sums = if self.relu { masked.as_slice() } else { v_out };
            let mut v_features = vec![0.0_f32; inputs.len()];
            by_features(v_sums, &PackedWeights::new(shape, values), &self.map, &mut v_features);
            let mut v_values = shape.pack(&by_weights(inputs, v_sums, &self.map, shape.cin, shape.cout));
            v_values.extend(v_bias);
            Ok((v_features, v_values, masked))
        })?;
        let made = |values: Vec<f32>, like: &Tensor| Tensor::from_vec(values, like.shape(), like.device());
        let v_residual = if self.relu { made(masked, result)? } else { v_out.clone() };
        Ok([made(v_features, features)?, made(v_values, values)?, v_residual])
    }
}

/// The gradient where the result is above zero (everywhere, and empty, without `relu`), and its sums by column.
fn rectified(result: &[f32], v_out: &[f32], width: usize, relu: bool) -> (Vec<f32>, Vec<f32>) {
    let mut masked = vec![0.0_f32; if relu { v_out.len() } else { 0 }];
    let size = PIECE * width.max(1);
    parallel::for_chunks(&mut masked, size, &|piece, masked| {
        let values = result[piece * size..].iter().zip(&v_out[piece * size..]);
        masked.iter_mut().zip(values).for_each(|(out, (&result, &v))| *out = if result > 0.0 { v } else { 0.0 });
    });
    let rows = if relu { masked.as_slice() } else { v_out };
    let parts = parallel::map(rows.len().div_ceil(size), 1, &|piece| {
        let mut sums = vec![0.0_f64; width];
        for row in rows[piece * size..].chunks_exact(width.max(1)).take(PIECE) {
            sums.iter_mut().zip(row).for_each(|(sum, &v)| *sum += f64::from(v));
        }
        sums
    });
    let mut sums = vec![0.0_f64; width];
    for part in parts {
        sums.iter_mut().zip(part).for_each(|(sum, v)| *sum += v);
    }
    (masked, sums.into_iter().map(single).collect())
}

impl CustomOp2 for Convolution {
    fn name(&self) -> &'static str {
        "sparse-convolution"
    }

    fn cpu_fwd(
        &self,
        features: &CpuStorage,
        features_layout: &Layout,
        values: &CpuStorage,
        values_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        Ok(self.forward(slice(features, features_layout)?, slice(values, values_layout)?, None))
    }

    fn bwd(
        &self,
        features: &Tensor,
        values: &Tensor,
        result: &Tensor,
        v_out: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>)> {
        let [v_features, v_values, _] = self.backward(features, values, result, v_out)?;
        Ok((Some(v_features), Some(v_values)))
    }
}

impl CustomOp3 for Convolution {
    fn name(&self) -> &'static str {
        "residual-sparse-convolution"
    }

    fn cpu_fwd(
        &self,
        features: &CpuStorage,
        features_layout: &Layout,
        values: &CpuStorage,
        values_layout: &Layout,
        residual: &CpuStorage,
        residual_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let residual = slice(residual, residual_layout)?;
        Ok(self.forward(slice(features, features_layout)?, slice(values, values_layout)?, Some(residual)))
    }

    fn bwd(
        &self,
        features: &Tensor,
        values: &Tensor,
        _residual: &Tensor,
        result: &Tensor,
        v_out: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let [v_features, v_values, v_residual] = self.backward(features, values, result, v_out)?;
        Ok((Some(v_features), Some(v_values), Some(v_residual)))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use candle_core::{Device, Tensor, Var};

    use super::convolve;
    use crate::ops::sparse_conv::{ConvWeights, KernelMap, Sites};
    use crate::ops::test_support::{assert_close, doubles, values};

    fn var(shape: &[usize], seed: u64) -> Var {
        Var::from_vec(values(shape.iter().product(), seed), shape, &Device::Cpu).unwrap()
    }

    /// The same by separate operations, for a map that is its own reverse and for two that are not.
    #[test]
    fn it_is_the_sum_of_its_parts() {
        let voxels: Vec<[i32; 4]> = (0..700).map(|i| [0, i % 9, i / 9 % 7, i % 5 - i / 63]).collect();
        let sites = Sites::unique(&voxels).unwrap().0;
        let halved = KernelMap::halving(&sites).unwrap();
        let maps = [(Arc::new(KernelMap::submanifold(&sites, 3).unwrap()), 3), (halved.down, 2), (halved.up, 2)];
        let list = |t: &Tensor| doubles(&t.flatten_all().unwrap().to_vec1::<f32>().unwrap());
        for ((map, kernel), relu, with_residual) in
            maps.iter().flat_map(|map| [(map, true, true), (map, false, true), (map, true, false), (map, false, false)])
        {
            let (cin, cout) = (5, 7);
            let x = var(&[map.num_inputs(), cin], 1);
            let weight = var(&[cout, *kernel, *kernel, *kernel, cin], 2);
            let (affine, residual) = (var(&[2, cout], 3), var(&[map.num_outputs(), cout], 5));
            let upstream = var(&[map.num_outputs(), cout], 4);
            let plain = ConvWeights::without_bias(&weight).unwrap();
            let mut parts = convolve(&x, &plain, None, map, false)
                .unwrap()
                .broadcast_mul(&affine.get(0).unwrap())
                .unwrap()
                .broadcast_add(&affine.get(1).unwrap())
                .unwrap();
            if with_residual {
                parts = (parts + residual.as_tensor()).unwrap();
            }
            let parts = if relu { parts.relu().unwrap() } else { parts };
            let weights = ConvWeights::new(&weight, &affine).unwrap();
            let residual_given = with_residual.then_some(residual.as_tensor());
            let whole = convolve(&x, &weights, residual_given, map, relu).unwrap();
            assert_close("result", &whole, &list(&parts), 1e-6);
            let gradients = |out: &Tensor| (out * upstream.as_tensor()).unwrap().sum_all().unwrap().backward().unwrap();
            let (want, got) = (gradients(&parts), gradients(&whole));
            for (name, var) in [("features", &x), ("weight", &weight), ("affine", &affine), ("residual", &residual)] {
                if with_residual || name != "residual" {
                    assert_close(name, got.get(var).unwrap(), &list(want.get(var).unwrap()), 3e-6);
                }
            }
            assert!(convolve(&x, &weights, Some(&x.narrow(1, 0, 2).unwrap()), map, relu).is_err());
        }
    }
}
