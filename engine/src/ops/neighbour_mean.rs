//! Mean of the rows of neighbours, with its gradient.

use std::sync::Arc;

use candle_core::{CpuStorage, CustomOp1, Layout, Shape, Tensor};
use rayon::prelude::*;

use super::knn::NO_NEIGHBOUR;
use super::tensors::{slice, with_values};

/// Mean over the existing neighbours of every row; zeros where there is none.
///
/// # Shapes
/// `features` `[N, width]`, `neighbours` `[N, k]`; result `[N, width]` in `out`.
pub fn neighbour_mean_into(features: &[f32], neighbours: &[u32], k: usize, width: usize, out: &mut [f32]) {
    if k == 0 || width == 0 {
        out.fill(0.0);
        return;
    }
    let rows = out.par_chunks_exact_mut(width).zip(neighbours.par_chunks_exact(k));
    rows.with_min_len(256).for_each(|(mean, neighbours)| {
        mean.fill(0.0);
        let mut count = 0.0_f32;
        for &j in neighbours.iter().filter(|&&j| j != NO_NEIGHBOUR) {
            let row = &features[j as usize * width..][..width];
            mean.iter_mut().zip(row).for_each(|(m, v)| *m += v);
            count += 1.0;
        }
        if count > 0.0 {
            mean.iter_mut().for_each(|m| *m /= count);
        }
    });
}

/// As [`neighbour_mean_into`], differentiable by the features.
///
/// # Shapes
/// `features` `[N, width]` f32, `neighbours` `[N * k]` row indices below N or [`NO_NEIGHBOUR`]; result `[N, width]`.
///
/// # Errors
/// When the lengths do not fit or an index is out of range.
pub fn neighbour_mean(features: &Tensor, neighbours: &Arc<Vec<u32>>, k: usize) -> candle_core::Result<Tensor> {
    let (rows, width) = features.dims2()?;
    if neighbours.len() != rows * k {
        candle_core::bail!("neighbour mean: expected {rows} x {k} indices, found {}", neighbours.len());
    }
    if let Some(j) = neighbours.iter().find(|&&j| j != NO_NEIGHBOUR && j as usize >= rows) {
        candle_core::bail!("neighbour mean: expected indices below {rows}, found {j}");
    }
    features.contiguous()?.apply_op1(NeighbourMean { neighbours: neighbours.clone(), k, width })
}

struct NeighbourMean {
    neighbours: Arc<Vec<u32>>,
    k: usize,
    width: usize,
}

impl CustomOp1 for NeighbourMean {
    fn name(&self) -> &'static str {
        "neighbour-mean"
    }

    fn cpu_fwd(&self, storage: &CpuStorage, layout: &Layout) -> candle_core::Result<(CpuStorage, Shape)> {
        let features = slice(storage, layout)?;
        let mut out = vec![0.0_f32; features.len()];
        neighbour_mean_into(features, &self.neighbours, self.k, self.width, &mut out);
        Ok((CpuStorage::F32(out), layout.shape().clone()))
    }

    /// Every row gathers from the rows whose mean it took part in, in their order.
    fn bwd(&self, features: &Tensor, _mean: &Tensor, gradient: &Tensor) -> candle_core::Result<Option<Tensor>> {
        let rows = features.dim(0)?;
        let mut first = vec![0_usize; rows + 1];
        for &j in self.neighbours.iter().filter(|&&j| j != NO_NEIGHBOUR) {
            first[j as usize + 1] += 1;
        }
        for i in 0..rows {
            first[i + 1] += first[i];
        }
        let mut next = first.clone();
        let mut users = vec![(0_usize, 0.0_f32); first[rows]];
        for (i, neighbours) in self.neighbours.chunks_exact(self.k.max(1)).enumerate() {
            let existing = || neighbours.iter().filter(|&&j| j != NO_NEIGHBOUR);
            let share = 1.0 / existing().count().max(1) as f32;
            for &j in existing() {
                users[next[j as usize]] = (i, share);
                next[j as usize] += 1;
            }
        }
        let v_features = with_values([gradient], |[v_mean]| {
            let mut v_features = vec![0.0_f32; v_mean.len()];
            v_features.par_chunks_exact_mut(self.width.max(1)).enumerate().for_each(|(j, row)| {
                for &(i, share) in &users[first[j]..first[j + 1]] {
                    let v = &v_mean[i * self.width..][..self.width];
                    row.iter_mut().zip(v).for_each(|(r, v)| *r += share * v);
                }
            });
            Ok(v_features)
        })?;
        Ok(Some(Tensor::from_vec(v_features, features.shape(), features.device())?))
    }
}

#[cfg(test)]
mod tests {
    use super::{NO_NEIGHBOUR, neighbour_mean};
    use candle_core::{Device, Tensor, Var};
    use std::sync::Arc;

    #[test]
    fn mean_and_gradient() {
        let features = Var::from_slice(&[1.0_f32, 2.0, 3.0, 4.0, 5.0, 6.0], (3, 2), &Device::Cpu).unwrap();
        let neighbours = Arc::new(vec![1, 2, 0, NO_NEIGHBOUR, NO_NEIGHBOUR, NO_NEIGHBOUR]);
        let mean = neighbour_mean(&features, &neighbours, 2).unwrap();
        assert_eq!(mean.to_vec2::<f32>().unwrap(), [[4.0, 5.0], [1.0, 2.0], [0.0, 0.0]]);
        let weight = Tensor::from_slice(&[1.0_f32, 10.0, 100.0, 1000.0, 7.0, 7.0], (3, 2), &Device::Cpu).unwrap();
        let gradients = (mean * weight).unwrap().sum_all().unwrap().backward().unwrap();
        let gradient = gradients.get(&features).unwrap().to_vec2::<f32>().unwrap();
        assert_eq!(gradient, [[100.0, 1000.0], [0.5, 5.0], [0.5, 5.0]]);
        assert!(neighbour_mean(&features, &Arc::new(vec![9, 0, 0, 0, 0, 0]), 2).is_err());
    }
}
