//! Rows times packed weights.

use pulp::{Simd, WithSimd};

use crate::ops::lanes::Lines;

/// Output channels of a panel.
pub(crate) const PANEL: usize = 32;

/// A matrix in the order in which the inner loop reads it: `[panels, inputs, PANEL]`, padded with zeros.
#[derive(Clone, Debug)]
pub(crate) struct Packed {
    pub(crate) inputs: usize,
    pub(crate) outputs: usize,
    data: Lines,
    bias: Lines,
}

impl Packed {
    pub(crate) fn new(weight: &[f32], inputs: usize, outputs: usize, bias: Option<&[f32]>) -> Self {
        let panels = outputs.div_ceil(PANEL);
        let mut data = Lines::zeros(panels * inputs * PANEL);
        for o in 0..outputs {
            for i in 0..inputs {
                data[((o / PANEL) * inputs + i) * PANEL + o % PANEL] = weight[o * inputs + i];
            }
        }
        let mut b = Lines::zeros(panels * PANEL);
        if let Some(bias) = bias {
            b[..outputs].copy_from_slice(bias);
        }
        Self { inputs, outputs, data, bias: b }
    }
}

/// `out = a packed + bias`, row by row.
pub(crate) struct Product<'a> {
    pub(crate) a: &'a [f32],
    pub(crate) a_stride: usize,
    pub(crate) packed: &'a Packed,
    pub(crate) out: &'a mut [f32],
    pub(crate) out_stride: usize,
    pub(crate) rows: usize,
}

impl WithSimd for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match S::F32_LANES {
            16 => self.run::<S, 6, 2, 2>(simd),
            8 => self.run::<S, 3, 4, 1>(simd),
            4 => self.run::<S, 3, 8, 1>(simd),
            _ => {}
        }
    }
}

impl Product<'_> {
    #[inline(always)]
    fn run<S: Simd, const R: usize, const V: usize, const P: usize>(self, simd: S) {
        let panels = self.packed.outputs.div_ceil(PANEL);
        let size = self.packed.inputs * PANEL;
        let mut panel = 0;
        while panel < panels {
            let step = if P == 2 && panel + 1 < panels { 2 } else { 1 };
            let w = S::as_simd_f32s(&self.packed.data[panel * size..(panel + step) * size]).0;
            let b = S::as_simd_f32s(&self.packed.bias[panel * PANEL..(panel + step) * PANEL]).0;
            let mut row = 0;
            while row < self.rows {
                let n = R.min(self.rows - row);
                let rows: [&[f32]; R] = std::array::from_fn(|r| &self.a[(row + r.min(n - 1)) * self.a_stride..][..self.packed.inputs]);
                let out = &mut self.out[row * self.out_stride + panel * PANEL..];
                if step == 2 {
                    let (w0, w1) = w.split_at(w.len() / 2);
                    let acc = tile2::<S, R, V>(simd, &rows, w0, w1);
                    for r in 0..n {
                        let o = S::as_mut_simd_f32s(&mut out[r * self.out_stride..][..2 * PANEL]).0;
                        for v in 0..V {
                            o[v] = simd.add_f32s(acc[r][0][v], b[v]);
                            o[v + V] = simd.add_f32s(acc[r][1][v], b[v + V]);
                        }
                    }
                } else {
                    let acc = tile1::<S, R, V>(simd, &rows, w);
                    for r in 0..n {
                        let o = S::as_mut_simd_f32s(&mut out[r * self.out_stride..][..PANEL]).0;
                        for v in 0..V {
                            o[v] = simd.add_f32s(acc[r][v], b[v]);
                        }
                    }
                }
                row += n;
            }
            panel += step;
        }
    }
}

#[inline(always)]
fn tile1<S: Simd, const R: usize, const V: usize>(simd: S, rows: &[&[f32]; R], w: &[S::f32s]) -> [[S::f32s; V]; R] {
    let mut acc = [[simd.splat_f32s(0.0); V]; R];
    let w = w.as_chunks::<V>().0;
    let rows: [&[f32]; R] = std::array::from_fn(|r| &rows[r][..w.len()]);
    for (k, w) in w.iter().enumerate() {
        for r in 0..R {
            let a = simd.splat_f32s(rows[r][k]);
            for v in 0..V {
                acc[r][v] = simd.mul_add_f32s(a, w[v], acc[r][v]);
            }
        }
    }
    acc
}

#[inline(always)]
fn tile2<S: Simd, const R: usize, const V: usize>(simd: S, rows: &[&[f32]; R], w0: &[S::f32s], w1: &[S::f32s]) -> [[[S::f32s; V]; 2]; R] {
    let mut acc = [[[simd.splat_f32s(0.0); V]; 2]; R];
    let w0 = w0.as_chunks::<V>().0;
    let w1 = &w1.as_chunks::<V>().0[..w0.len()];
    let rows: [&[f32]; R] = std::array::from_fn(|r| &rows[r][..w0.len()]);
    for (k, w0) in w0.iter().enumerate() {
        let w1 = &w1[k];
        for r in 0..R {
            let a = simd.splat_f32s(rows[r][k]);
            for v in 0..V {
                acc[r][0][v] = simd.mul_add_f32s(a, w0[v], acc[r][0][v]);
                acc[r][1][v] = simd.mul_add_f32s(a, w1[v], acc[r][1][v]);
            }
        }
    }
    acc
}
