//! The inner loops: features times weights over the pairs of a kernel map.
//!
//! A block of output rows keeps its accumulators in cache. For each offset, groups of pairs are multiplied straight from the neighbours' rows:
//! no gather buffer, no scatter buffer. The weights lie in panels of [`PANEL`] output channels, so that one input value feeds a whole
//! panel row of registers.

use pulp::{Simd, WithSimd};
use rayon::prelude::*;

use super::map::{BLOCK, KernelMap};
use super::pack::{PANEL, PackedWeights};

/// Vectors of a panel that are summed together.
const PART: usize = 2;

/// What is done to the sums before they are stored.
#[derive(Clone, Copy, Debug, Default)]
pub struct Epilogue<'a> {
    /// `[cout]` added to every row.
    pub bias: Option<&'a [f32]>,
    /// `[num_outputs, cout]` added.
    pub residual: Option<&'a [f32]>,
    /// Whether negative results become zero.
    pub relu: bool,
}

/// Convolves features into `out`.
///
/// # Shapes
/// `features` `[map.num_inputs, cin]`, `out` `[map.num_outputs, cout]`; lengths are checked by the callers.
pub fn convolve_into(
    features: &[f32],
    weights: &PackedWeights<'_>,
    map: &KernelMap,
    epilogue: &Epilogue<'_>,
    out: &mut [f32],
) {
    if out.is_empty() {
        return;
    }
    let stride = weights.shape.panels() * PANEL;
    let zeros = vec![0.0_f32; weights.shape.cin];
    let arch = pulp::Arch::new();
    out.par_chunks_mut(BLOCK * weights.shape.cout).enumerate().for_each_init(
        || vec![0.0_f32; (BLOCK + 1) * stride],
        |sums, (block, out)| {
            sums.fill(0.0);
            arch.dispatch(BlockSums { features, zeros: &zeros, weights, map, block, epilogue, sums, out });
        },
    );
}

struct BlockSums<'a> {
    features: &'a [f32],
    zeros: &'a [f32],
    weights: &'a PackedWeights<'a>,
    map: &'a KernelMap,
    block: usize,
    epilogue: &'a Epilogue<'a>,
    /// `[BLOCK + 1, cout]` padded to whole panels; the last row takes what belongs nowhere.
    sums: &'a mut [f32],
    out: &'a mut [f32],
}

impl WithSimd for BlockSums<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        // Vectors of a panel; rows of a group times two vectors: as many sums as the registers hold.
        match S::F32_LANES {
            16 => self.run::<S, 2, 6>(simd),
            8 => self.run::<S, 4, 6>(simd),
            4 => self.run::<S, 8, 6>(simd),
            _ => self.run_by_value(),
        }
        self.store();
    }
}

impl BlockSums<'_> {
    #[inline(always)]
    fn store(&mut self) {
        let cout = self.weights.shape.cout;
        let stride = cout.div_ceil(PANEL) * PANEL;
        let Epilogue { bias, residual, relu } = *self.epilogue;
        for (i, (row, sums)) in self.out.chunks_exact_mut(cout).zip(self.sums.chunks_exact(stride)).enumerate() {
            row.copy_from_slice(&sums[..cout]);
            if let Some(bias) = bias {
                row.iter_mut().zip(bias).for_each(|(v, b)| *v += b);
            }
            if let Some(residual) = residual {
                let residual = &residual[(self.block * BLOCK + i) * cout..][..cout];
                row.iter_mut().zip(residual).for_each(|(v, r)| *v += r);
            }
            if relu {
                row.iter_mut().for_each(|v| *v = v.max(0.0));
            }
        }
    }

    #[inline(always)]
    fn run<S: Simd, const VECTORS: usize, const ROWS: usize>(&mut self, simd: S) {
        let stride = self.weights.shape.panels() * VECTORS;
        let sums = S::as_mut_simd_f32s(self.sums).0;
        for offset in 0..self.weights.shape.num_offsets {
            let (inputs, outputs) = self.map.pairs(self.block, offset);
            if inputs.is_empty() {
                continue;
            }
            for panel in 0..self.weights.shape.panels() {
                let weights = S::as_simd_f32s(self.weights.panel(offset, panel)).0.as_chunks::<VECTORS>().0;
                for part in (0..VECTORS).step_by(PART) {
                    let column = panel * VECTORS + part;
                    for (inputs, outputs) in inputs.chunks(ROWS).zip(outputs.chunks(ROWS)) {
                        // Missing rows of the last group read zeros and add to a row that is never stored.
                        let mut rows = [self.zeros; ROWS];
                        let mut places = [BLOCK * stride + column; ROWS];
                        for (r, (&input, &output)) in inputs.iter().zip(outputs).enumerate() {
                            rows[r] =
                                &self.features[input as usize * self.weights.shape.cin..][..self.weights.shape.cin];
                            places[r] = usize::from(output) * stride + column;
                        }
                        multiply::<S, VECTORS, ROWS>(simd, &rows, weights, part, &places, sums);
                    }
                }
            }
        }
    }

    /// Where there are no vectors.
    fn run_by_value(&mut self) {
        let stride = self.weights.shape.panels() * PANEL;
        for offset in 0..self.weights.shape.num_offsets {
            let (inputs, outputs) = self.map.pairs(self.block, offset);
            for panel in 0..self.weights.shape.panels() {
                let weights = self.weights.panel(offset, panel);
                for (&input, &output) in inputs.iter().zip(outputs) {
                    let row = &self.features[input as usize * self.weights.shape.cin..][..self.weights.shape.cin];
                    let sums = &mut self.sums[usize::from(output) * stride + panel * PANEL..][..PANEL];
                    for (value, weights) in row.iter().zip(weights.chunks_exact(PANEL)) {
                        sums.iter_mut().zip(weights).for_each(|(s, w)| *s += value * w);
                    }
                }
            }
        }
    }
}

/// Adds `rows * weights` to the sums at `places`: `ROWS` rows times the vectors of a panel from `part` on.
#[inline(always)]
fn multiply<S: Simd, const VECTORS: usize, const ROWS: usize>(
    simd: S,
    rows: &[&[f32]; ROWS],
    weights: &[[S::f32s; VECTORS]],
    part: usize,
    places: &[usize; ROWS],
    sums: &mut [S::f32s],
) {
    let mut acc = [[simd.splat_f32s(0.0); PART]; ROWS];
    let rows: [&[f32]; ROWS] = std::array::from_fn(|r| &rows[r][..weights.len()]);
    for (k, panel) in weights.iter().enumerate() {
        let panel = &panel[part..part + PART];
        for r in 0..ROWS {
            let value = simd.splat_f32s(rows[r][k]);
            for v in 0..PART {
                acc[r][v] = simd.mul_add_f32s(value, panel[v], acc[r][v]);
            }
        }
    }
    for r in 0..ROWS {
        for (sum, value) in sums[places[r]..places[r] + PART].iter_mut().zip(acc[r]) {
            *sum = simd.add_f32s(*sum, value);
        }
    }
}
