//! Reductions of rows over the segment that each belongs to, and the way back: every row its segment's.

mod gate;
pub mod reference;
mod sum;

use std::sync::Arc;

use candle_core::{CpuStorage, CustomOp1, Layout, Result, Shape, Tensor};

pub(crate) use gate::gather_gated;
pub(crate) use sum::add_gathered;

use super::tensors::{slice, with_values};
use crate::parallel;

/// Rows or segments of one piece of work.
const PIECE: usize = 512;

/// Which segment every row belongs to, and the rows of every segment.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Segments {
    /// `[N]` segment of every row.
    segment_of: Vec<u32>,
    /// `[M + 1]` where the members of a segment start.
    first_member: Vec<u32>,
    /// `[N]` rows by segment, ascending in each.
    members: Vec<u32>,
}

impl Segments {
    /// Segments from the segment of every row; a segment may have no row.
    ///
    /// # Errors
    /// When a segment is not below `num_segments`.
    #[expect(clippy::cast_possible_truncation, reason = "a scene holds fewer than 2^32 rows")]
    pub fn new(segment_of: Vec<u32>, num_segments: usize) -> Result<Self> {
        let mut first_member = vec![0_u32; num_segments + 1];
        for (row, &segment) in segment_of.iter().enumerate() {
            match first_member.get_mut(segment as usize + 1) {
                Some(count) => *count += 1,
                None => candle_core::bail!("row {row}: expected a segment below {num_segments}, found {segment}"),
            }
        }
        for i in 0..num_segments {
            first_member[i + 1] += first_member[i];
        }
        let mut next = first_member.clone();
        let mut members = vec![0; segment_of.len()];
        for (row, &segment) in segment_of.iter().enumerate() {
            members[next[segment as usize] as usize] = row as u32;
            next[segment as usize] += 1;
        }
        Ok(Self { segment_of, first_member, members })
    }

    /// Number of rows, N.
    pub fn num_rows(&self) -> usize {
        self.segment_of.len()
    }

    /// Number of segments, M.
    pub(crate) fn num_segments(&self) -> usize {
        self.first_member.len() - 1
    }

    /// `[N]` segment of every row.
    pub fn segment_of(&self) -> &[u32] {
        &self.segment_of
    }

    /// The rows of a segment, ascending.
    pub fn members(&self, segment: usize) -> &[u32] {
        &self.members[self.first_member[segment] as usize..self.first_member[segment + 1] as usize]
    }
}

/// The largest value of every column over each segment; 0 for a segment without rows.
///
/// # Shapes
/// `x` `[N, C]` f32; result `[M, C]`.
///
/// # Gradient
/// Goes to the first row that has the largest value.
///
/// # Errors
/// When the number of rows does not fit.
pub(crate) fn max_pool(x: &Tensor, segments: &Arc<Segments>) -> Result<Tensor> {
    Reduction::Max.apply(x, segments)
}

/// The mean of every column over each segment, summed in f64; 0 for a segment without rows.
///
/// # Shapes
/// `x` `[N, C]` f32; result `[M, C]`.
///
/// # Gradient
/// Exact.
///
/// # Errors
/// When the number of rows does not fit.
pub fn mean_pool(x: &Tensor, segments: &Arc<Segments>) -> Result<Tensor> {
    Reduction::Mean.apply(x, segments)
}

/// The row of each row's segment.
///
/// # Shapes
/// `x` `[M, C]` f32; result `[N, C]`.
///
/// # Gradient
/// The sum over each segment's rows, in f64.
///
/// # Errors
/// When the number of segments does not fit.
pub fn gather(x: &Tensor, segments: &Arc<Segments>) -> Result<Tensor> {
    Reduction::Gather.apply(x, segments)
}

/// [`max_pool`] on slices: `x` `[N, width]`, `out` `[M, width]`.
pub(crate) fn max_pool_into(x: &[f32], segments: &Segments, width: usize, out: &mut [f32]) {
    by_rows(out, width, |segment, out| {
        let mut members = segments.members(segment).iter().map(|&row| &x[row as usize * width..][..width]);
        match members.next() {
            Some(first) => out.copy_from_slice(first),
            None => out.fill(0.0),
        }
        for row in members {
            // NaN wins: it must not be lost.
            out.iter_mut().zip(row).for_each(|(out, &v)| *out = if *out >= v || out.is_nan() { *out } else { v });
        }
    });
}

/// [`gather`] on slices: `x` `[M, width]`, `out` `[N, width]`.
pub(crate) fn gather_into(x: &[f32], segments: &Segments, width: usize, out: &mut [f32]) {
    by_rows(out, width, |row, out| {
        out.copy_from_slice(&x[segments.segment_of[row] as usize * width..][..width]);
    });
}

fn by_rows(out: &mut [f32], width: usize, fill: impl Fn(usize, &mut [f32]) + Sync) {
    if width > 0 {
        parallel::for_chunks(out, PIECE * width, &|piece, out| {
            (piece * PIECE..).zip(out.chunks_exact_mut(width)).for_each(|(i, out)| fill(i, out));
        });
    }
}

/// Sums over segments in f64, each times `factor(segment)`.
#[expect(clippy::cast_possible_truncation, reason = "sums are stored in f32")]
fn sum_into(x: &[f32], segments: &Segments, width: usize, factor: impl Fn(usize) -> f64 + Sync, out: &mut [f32]) {
    by_rows(out, width, |segment, out| {
        let factor = factor(segment);
        for (c, out) in out.iter_mut().enumerate() {
            let column = segments.members(segment).iter().map(|&row| f64::from(x[row as usize * width + c]));
            *out = (column.sum::<f64>() * factor) as f32;
        }
    });
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Reduction {
    Max,
    Mean,
    Gather,
}

impl Reduction {
    fn apply(self, x: &Tensor, segments: &Arc<Segments>) -> Result<Tensor> {
        let (rows, width) = x.dims2()?;
        let expected = if self == Self::Gather { segments.num_segments() } else { segments.num_rows() };
        if rows != expected {
            candle_core::bail!("{self:?} over segments: expected {expected} rows, found {rows}");
        }
        x.contiguous()?.apply_op1(SegmentOp { reduction: self, segments: segments.clone(), width })
    }
}

struct SegmentOp {
    reduction: Reduction,
    segments: Arc<Segments>,
    width: usize,
}

impl SegmentOp {
    /// 1 / number of members.
    fn share(&self, segment: usize) -> f64 {
        1.0 / self.segments.members(segment).len().max(1) as f64
    }

    /// Gradient by `x` `[N, C]` of the largest values `[M, C]`.
    fn to_largest(&self, x: &[f32], largest: &[f32], v_out: &[f32], v_x: &mut [f32]) {
        let width = self.width;
        by_rows(v_x, width, |row, v_x| {
            let segment = self.segments.segment_of[row] as usize;
            for (c, v_x) in v_x.iter_mut().enumerate() {
                let top = largest[segment * width + c];
                let first = self.segments.members(segment).iter().find(|&&r| x[r as usize * width + c] == top);
                *v_x = if first.is_some_and(|&r| r as usize == row) { v_out[segment * width + c] } else { 0.0 };
            }
        });
    }
}

impl CustomOp1 for SegmentOp {
    fn name(&self) -> &'static str {
        match self.reduction {
            Reduction::Max => "segment-max",
            Reduction::Mean => "segment-mean",
            Reduction::Gather => "segment-gather",
        }
    }

    fn cpu_fwd(&self, storage: &CpuStorage, layout: &Layout) -> Result<(CpuStorage, Shape)> {
        let x = slice(storage, layout)?;
        let Self { reduction, ref segments, width } = *self;
        let rows = if reduction == Reduction::Gather { segments.num_rows() } else { segments.num_segments() };
        let mut out = vec![0.0_f32; rows * width];
        match reduction {
            Reduction::Max => max_pool_into(x, segments, width, &mut out),
            Reduction::Mean => sum_into(x, segments, width, |segment| self.share(segment), &mut out),
            Reduction::Gather => gather_into(x, segments, width, &mut out),
        }
        Ok((CpuStorage::F32(out), Shape::from((rows, width))))
    }

    fn bwd(&self, x: &Tensor, result: &Tensor, v_out: &Tensor) -> Result<Option<Tensor>> {
        let Self { reduction, ref segments, width } = *self;
        let v_x = with_values([x, result, v_out], |[x, result, v_out]| {
            let mut v_x = vec![0.0_f32; x.len()];
            match reduction {
                Reduction::Max => self.to_largest(x, result, v_out, &mut v_x),
                Reduction::Mean => {
                    let shares: Vec<f64> = (0..segments.num_segments()).map(|segment| self.share(segment)).collect();
                    mean_gradient(v_out, segments, &shares, width, &mut v_x);
                }
                Reduction::Gather => sum_into(v_out, segments, width, |_| 1.0, &mut v_x),
            }
            Ok(v_x)
        })?;
        Tensor::from_vec(v_x, x.shape(), x.device()).map(Some)
    }
}

#[expect(clippy::cast_possible_truncation, reason = "gradients are stored in f32")]
fn mean_gradient(v_out: &[f32], segments: &Segments, shares: &[f64], width: usize, v_x: &mut [f32]) {
    by_rows(v_x, width, |row, v_x| {
        let segment = segments.segment_of[row] as usize;
        let v_out = &v_out[segment * width..][..width];
        v_x.iter_mut().zip(v_out).for_each(|(v_x, &v)| *v_x = (f64::from(v) * shares[segment]) as f32);
    });
}

#[cfg(test)]
mod tests;
