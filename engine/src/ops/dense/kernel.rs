//! The inner loops of matrix products.

use pulp::{Simd, WithSimd};

use crate::ops::lanes::Lines;

/// Columns of a panel.
pub(super) const PANEL: usize = 32;
/// Columns of a panel of matrices that have few.
const NARROW: usize = 16;

/// A matrix in the order in which the inner loop reads it: `[panels, depth, width of a panel]`, filled up with zeros.
#[derive(Clone, Debug, Default)]
pub struct Packed {
    depth: usize,
    columns: usize,
    /// [`PANEL`] or [`NARROW`].
    panel: usize,
    data: Lines,
}

/// What happens to what the output held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Store {
    /// It is replaced.
    Replace,
    /// The product is added to it.
    Add,
}

/// Rows of a larger matrix: row `r` starts at `r * stride`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rows<'a> {
    pub(crate) values: &'a [f32],
    pub(crate) stride: usize,
    pub(crate) count: usize,
}

/// `out = rows * packed + bias` for as many rows as there are.
///
/// # Shapes
/// `rows` `[count, depth]`, `out` `[count, columns]` with its own stride, `bias` `[columns]` or empty.
#[derive(Debug)]
pub(crate) struct Product<'a> {
    pub(crate) rows: Rows<'a>,
    pub(crate) packed: &'a Packed,
    pub(crate) bias: &'a [f32],
    pub(crate) out: &'a mut [f32],
    pub(crate) out_stride: usize,
    pub(crate) store: Store,
}

impl Packed {
    /// The columns of a matrix that `at(depth, column)` gives.
    pub(crate) fn new(depth: usize, columns: usize, at: impl Fn(usize, usize) -> f32) -> Self {
        let mut packed = Self::default();
        packed.fill(depth, columns, at);
        packed
    }

    /// A layer's weights `[outputs, inputs]`, as checkpoints hold them.
    ///
    /// # Shapes
    /// `weight.len() = outputs * inputs`, which the caller has checked.
    pub fn of_checkpoint(weight: &[f32], inputs: usize, outputs: usize) -> Self {
        Self::new(inputs, outputs, |i, o| weight[o * inputs + i])
    }

    /// As [`Packed::new`], in the memory at hand.
    #[inline(always)]
    pub(crate) fn fill(&mut self, depth: usize, columns: usize, at: impl Fn(usize, usize) -> f32) {
        let panel = if columns <= NARROW { NARROW } else { PANEL };
        (self.depth, self.columns, self.panel) = (depth, columns, panel);
        self.data.resize(columns.div_ceil(panel) * depth * panel);
        for (i, values) in self.data.chunks_exact_mut((depth * panel).max(1)).enumerate() {
            let first = i * panel;
            let width = panel.min(columns - first);
            for (k, row) in values.chunks_exact_mut(panel).enumerate() {
                for (c, value) in row[..width].iter_mut().enumerate() {
                    *value = at(k, first + c);
                }
                row[width..].fill(0.0);
            }
        }
    }

    /// Number of values that a row brings.
    pub fn depth(&self) -> usize {
        self.depth
    }

    /// Number of values that a row gets.
    pub fn columns(&self) -> usize {
        self.columns
    }
}

impl WithSimd for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        // Rows, vectors of a panel, panels: as many sums as the registers hold.
        match (S::F32_LANES, self.packed.panel) {
            (16, PANEL) => self.run::<S, 6, 2, 2>(simd),
            (16, _) => self.run::<S, 12, 1, 1>(simd),
            (8, PANEL) => self.run::<S, 3, 4, 1>(simd),
            (8, _) => self.run::<S, 6, 2, 1>(simd),
            (4, PANEL) => self.run::<S, 3, 8, 1>(simd),
            (4, _) => self.run::<S, 6, 4, 1>(simd),
            (_, PANEL) => self.run::<S, 1, PANEL, 1>(simd),
            _ => self.run::<S, 1, NARROW, 1>(simd),
        }
    }
}

impl Product<'_> {
    /// With `R` rows of `P` panels of `V` vectors at a time.
    #[inline(always)]
    fn run<S: Simd, const R: usize, const V: usize, const P: usize>(mut self, simd: S) {
        if self.packed.depth == 0 {
            return self.only_bias();
        }
        let panels = self.packed.columns.div_ceil(V * S::F32_LANES);
        let together = panels - panels % P;
        for panel in (0..together).step_by(P) {
            self.columns_of::<S, R, V, P>(simd, panel);
        }
        for panel in together..panels {
            self.columns_of::<S, R, V, 1>(simd, panel);
        }
    }

    /// Columns of `P` panels for all rows.
    #[inline(always)]
    fn columns_of<S: Simd, const R: usize, const V: usize, const P: usize>(&mut self, simd: S, panel: usize) {
        let Packed { depth, columns, ref data, .. } = *self.packed;
        let width = V * S::F32_LANES;
        let weights: [&[[S::f32s; V]]; P] = std::array::from_fn(|p| {
            S::as_simd_f32s(&data[(panel + p) * depth * width..][..depth * width]).0.as_chunks::<V>().0
        });
        let bias: [Lane; P] = std::array::from_fn(|p| Lane::of(self.bias, (panel + p) * width, width));
        for first in (0..self.rows.count).step_by(R) {
            let count = R.min(self.rows.count - first);
            // The last group repeats its last row, without storing it twice.
            let rows: [&[f32]; R] =
                std::array::from_fn(|r| &self.rows.values[(first + r.min(count - 1)) * self.rows.stride..][..depth]);
            let sums = tile::<S, R, V, P>(simd, &rows, &weights);
            for (r, sums) in sums.iter().enumerate().take(count) {
                for (p, sums) in sums.iter().enumerate() {
                    let column = (panel + p) * width;
                    let width = width.min(columns - column);
                    let out = &mut self.out[(first + r) * self.out_stride + column..][..width];
                    put(simd, sums, &bias[p], out, self.store);
                }
            }
        }
    }

    fn only_bias(self) {
        for out in self.out.chunks_mut(self.out_stride.max(1)).take(self.rows.count) {
            for (c, out) in out[..self.packed.columns].iter_mut().enumerate() {
                let bias = self.bias.get(c).copied().unwrap_or(0.0);
                *out = if self.store == Store::Add { *out + bias } else { bias };
            }
        }
    }
}

/// Values of one panel's width at most.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct Lane([f32; PANEL]);

impl Lane {
    /// `width` values from `first` on, filled up with zeros.
    #[inline(always)]
    fn of(values: &[f32], first: usize, width: usize) -> Self {
        let mut lane = Self([0.0; PANEL]);
        if let Some(values) = values.get(first..) {
            let width = width.min(values.len());
            lane.0[..width].copy_from_slice(&values[..width]);
        }
        lane
    }
}

#[inline(always)]
fn put<S: Simd, const V: usize>(simd: S, sums: &[S::f32s; V], bias: &Lane, out: &mut [f32], store: Store) {
    let bias = S::as_simd_f32s(&bias.0).0;
    if out.len() == V * S::F32_LANES {
        for ((out, &sum), &bias) in S::as_mut_simd_f32s(out).0.iter_mut().zip(sums).zip(bias) {
            let value = simd.add_f32s(sum, bias);
            *out = if store == Store::Add { simd.add_f32s(*out, value) } else { value };
        }
    } else {
        let mut lane = Lane([0.0; PANEL]);
        for ((out, &sum), &bias) in S::as_mut_simd_f32s(&mut lane.0).0.iter_mut().zip(sums).zip(bias) {
            *out = simd.add_f32s(sum, bias);
        }
        for (out, value) in out.iter_mut().zip(lane.0) {
            *out = if store == Store::Add { *out + value } else { value };
        }
    }
}

/// `R` rows times `P` panels, with all sums in registers.
#[inline(always)]
fn tile<S: Simd, const R: usize, const V: usize, const P: usize>(
    simd: S,
    rows: &[&[f32]; R],
    weights: &[&[[S::f32s; V]]; P],
) -> [[[S::f32s; V]; P]; R] {
    let depth = weights[0].len();
    let weights: [&[[S::f32s; V]]; P] = std::array::from_fn(|p| &weights[p][..depth]);
    let rows: [&[f32]; R] = std::array::from_fn(|r| &rows[r][..depth]);
    let mut sums = [[[simd.splat_f32s(0.0); V]; P]; R];
    for k in 0..depth {
        let weights: [&[S::f32s; V]; P] = std::array::from_fn(|p| &weights[p][k]);
        for r in 0..R {
            let value = simd.splat_f32s(rows[r][k]);
            for p in 0..P {
                for v in 0..V {
                    sums[r][p][v] = simd.mul_add_f32s(value, weights[p][v], sums[r][p][v]);
                }
            }
        }
    }
    sums
}
