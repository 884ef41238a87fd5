//! Rows plus the row of each row's segment.

use std::sync::Arc;

use candle_core::{CpuStorage, InplaceOp2, Layout, Result, Tensor};

use super::{Segments, by_rows, gather};
use crate::ops::tensors::{slice, slice_mut};

/// `x` plus the row of each row's segment, where nobody else holds `x`: in its memory where no gradient is asked for.
///
/// # Shapes
/// `x` `[N, C]`, `of_segments` `[M, C]`, both f32; result `[N, C]`.
///
/// # Gradient
/// By both, sums over segments in f64.
///
/// # Errors
/// When a shape does not fit.
pub(crate) fn add_gathered(x: Tensor, of_segments: &Tensor, segments: &Arc<Segments>) -> Result<Tensor> {
    let ((rows, width), found) = (x.dims2()?, of_segments.dims2()?);
    if rows != segments.num_rows() || found != (segments.num_segments(), width) {
        let expected = [(segments.num_rows(), width), (segments.num_segments(), width)];
        candle_core::bail!("sum of gathered rows: expected {expected:?}, found {:?}", [(rows, width), found]);
    }
    if x.track_op() || of_segments.track_op() {
        return x + gather(of_segments, segments)?;
    }
    let x = x.contiguous()?;
    x.inplace_op2(&of_segments.contiguous()?, &AddGathered { segments, width })?;
    Ok(x)
}

struct AddGathered<'a> {
    segments: &'a Segments,
    width: usize,
}

impl InplaceOp2 for AddGathered<'_> {
    fn name(&self) -> &'static str {
        "add-gathered"
    }

    fn cpu_fwd(
        &self,
        x: &mut CpuStorage,
        x_layout: &Layout,
        of_segments: &CpuStorage,
        of_segments_layout: &Layout,
    ) -> Result<()> {
        let of_segments = slice(of_segments, of_segments_layout)?;
        by_rows(slice_mut(x, x_layout)?, self.width, |row, x| {
            let added = &of_segments[self.segments.segment_of()[row] as usize * self.width..];
            x.iter_mut().zip(added).for_each(|(x, v)| *x += v);
        });
        Ok(())
    }
}
