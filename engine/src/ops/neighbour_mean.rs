//! Rows beside the mean of their neighbours' rows, with the gradient.

use std::sync::Arc;

use candle_core::{CpuStorage, CustomOp1, Layout, Shape, Tensor};

use super::knn::NO_NEIGHBOUR;
use super::tensors::{slice, with_values};
use crate::parallel;

/// Rows of one piece of work.
const PIECE: usize = 256;

/// Rows, and beside each the mean over its existing neighbours; zeros in place of both where there is no neighbour.
///
/// # Shapes
/// `features` `[N, width]` f32, `neighbours` `[N * k]` row indices below N or [`NO_NEIGHBOUR`]; result `[N, 2 width]`.
///
/// # Gradient
/// By the features; the neighbours are constant.
///
/// # Errors
/// When the lengths do not fit or an index is out of range.
pub(crate) fn with_neighbour_mean(
    features: &Tensor,
    neighbours: &Arc<Vec<u32>>,
    k: usize,
) -> candle_core::Result<Tensor> {
    let (rows, width) = features.dims2()?;
    if neighbours.len() != rows * k {
        candle_core::bail!("neighbour mean: expected {rows} x {k} indices, found {}", neighbours.len());
    }
    if let Some(j) = neighbours.iter().find(|&&j| j != NO_NEIGHBOUR && j as usize >= rows) {
        candle_core::bail!("neighbour mean: expected indices below {rows}, found {j}");
    }
    features.contiguous()?.apply_op1(WithNeighbourMean { neighbours: neighbours.clone(), k, width })
}

struct WithNeighbourMean {
    neighbours: Arc<Vec<u32>>,
    k: usize,
    width: usize,
}

fn existing(neighbours: &[u32]) -> impl Iterator<Item = usize> + '_ {
    neighbours.iter().filter(|&&j| j != NO_NEIGHBOUR).map(|&j| j as usize)
}

impl CustomOp1 for WithNeighbourMean {
    fn name(&self) -> &'static str {
        "with-neighbour-mean"
    }

    fn cpu_fwd(&self, storage: &CpuStorage, layout: &Layout) -> candle_core::Result<(CpuStorage, Shape)> {
        let (features, &Self { k, width, .. }) = (slice(storage, layout)?, self);
        let mut out = vec![0.0_f32; 2 * features.len()];
        if k > 0 && width > 0 {
            parallel::for_chunks(&mut out, PIECE * 2 * width, &|piece, out| {
                for (i, out) in (piece * PIECE..).zip(out.chunks_exact_mut(2 * width)) {
                    let neighbours = &self.neighbours[i * k..][..k];
                    let count = existing(neighbours).count() as f32;
                    if count > 0.0 {
                        let (same, mean) = out.split_at_mut(width);
                        same.copy_from_slice(&features[i * width..][..width]);
                        for j in existing(neighbours) {
                            mean.iter_mut().zip(&features[j * width..]).for_each(|(m, v)| *m += v);
                        }
                        mean.iter_mut().for_each(|m| *m /= count);
                    }
                }
            });
        }
        let rows = features.len() / width.max(1);
        Ok((CpuStorage::F32(out), Shape::from((rows, 2 * width))))
    }

    /// Every row gathers from the rows whose mean it took part in, in their order.
    fn bwd(&self, features: &Tensor, _result: &Tensor, gradient: &Tensor) -> candle_core::Result<Option<Tensor>> {
        let rows = features.dim(0)?;
        let mut first = vec![0_usize; rows + 1];
        existing(&self.neighbours).for_each(|j| first[j + 1] += 1);
        for i in 0..rows {
            first[i + 1] += first[i];
        }
        let mut next = first.clone();
        let mut users = vec![(0_usize, 0.0_f32); first[rows]];
        for (i, neighbours) in self.neighbours.chunks_exact(self.k.max(1)).enumerate() {
            let share = 1.0 / existing(neighbours).count().max(1) as f32;
            for j in existing(neighbours) {
                users[next[j]] = (i, share);
                next[j] += 1;
            }
        }
        let v_features = with_values([gradient], |[v_out]| {
            let (mut v_features, width) = (vec![0.0_f32; v_out.len() / 2], self.width);
            parallel::for_chunks(&mut v_features, width.max(1), &|j, row| {
                if existing(&self.neighbours[j * self.k..][..self.k]).next().is_some() {
                    row.copy_from_slice(&v_out[2 * j * width..][..width]);
                }
                for &(i, share) in &users[first[j]..first[j + 1]] {
                    let v = &v_out[(2 * i + 1) * width..][..width];
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
    use super::{NO_NEIGHBOUR, with_neighbour_mean};
    use candle_core::{Device, Tensor, Var};
    use std::sync::Arc;

    #[test]
    fn rows_means_and_gradient() {
        let features = Var::from_slice(&[1.0_f32, 2.0, 3.0, 4.0, 5.0, 6.0], (3, 2), &Device::Cpu).unwrap();
        let neighbours = Arc::new(vec![1, 2, 0, NO_NEIGHBOUR, NO_NEIGHBOUR, NO_NEIGHBOUR]);
        let out = with_neighbour_mean(&features, &neighbours, 2).unwrap();
        assert_eq!(out.to_vec2::<f32>().unwrap(), [[1.0, 2.0, 4.0, 5.0], [3.0, 4.0, 1.0, 2.0], [0.0; 4]]);
        let weight = [0.5_f32, 0.25, 1.0, 10.0, 2.0, 3.0, 100.0, 1000.0, 7.0, 7.0, 7.0, 7.0];
        let weight = Tensor::from_slice(&weight, (3, 4), &Device::Cpu).unwrap();
        let gradients = (out * weight).unwrap().sum_all().unwrap().backward().unwrap();
        let gradient = gradients.get(&features).unwrap().to_vec2::<f32>().unwrap();
        assert_eq!(gradient, [[100.5, 1000.25], [2.5, 8.0], [0.5, 5.0]]);
        assert!(with_neighbour_mean(&features, &Arc::new(vec![9, 0, 0, 0, 0, 0]), 2).is_err());
        let nobody = with_neighbour_mean(&features, &Arc::new(Vec::new()), 0).unwrap();
        assert_eq!(nobody.to_vec2::<f32>().unwrap(), [[0.0; 4]; 3]);
    }
}
