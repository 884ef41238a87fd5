//! Gradient by the weights: sums of outer products over the pairs of each offset.
//!
//! Block after block of output rows, so that the rows stay in cache for all offsets of a piece of work. A tile of the sums lies in registers
//! while the pairs of a block run through it; what a few blocks add up to in f32 is then added in f64.

use std::ops::Range;

use pulp::{Simd, WithSimd};

use super::map::{BLOCK, KernelMap};
use crate::ops::lanes::Lines;
use crate::parallel;

/// Pieces of blocks at most, and the fewest blocks of a piece: fixed, so that results do not depend on the number of threads.
const PIECES: usize = 16;
const BLOCKS_PER_PIECE: usize = 16;
/// Blocks whose products are summed in f32.
const SHORT: usize = 4;
/// Sums of the offsets that a piece of work handles: they stay in the second-level cache.
const SUMS: usize = 1 << 17;
/// Output channels are padded to a multiple of this.
const COLUMNS: usize = 32;

/// Gradient of a scalar by the weights, from its gradient by the output rows.
///
/// # Shapes
/// `features` `[num_inputs, cin]`, `v_out` `[num_outputs, cout]`; result `[cout, num_offsets, cin]`.
pub fn by_weights(features: &[f32], v_out: &[f32], map: &KernelMap, cin: usize, cout: usize) -> Vec<f32> {
    let columns = cout.next_multiple_of(COLUMNS);
    let size = cin * columns;
    let mut result = vec![0.0_f32; cout * map.num_offsets * cin];
    if result.is_empty() {
        return result;
    }
    let blocks = map.num_outputs.div_ceil(BLOCK);
    let per_piece = blocks.div_ceil(PIECES).max(BLOCKS_PER_PIECE);
    let pieces: Vec<Range<usize>> =
        (0..blocks).step_by(per_piece).map(|first| first..(first + per_piece).min(blocks)).collect();
    let together = (SUMS / size).clamp(1, map.num_offsets);
    let groups: Vec<Range<usize>> =
        (0..map.num_offsets).step_by(together).map(|o| o..(o + together).min(map.num_offsets)).collect();
    let arch = pulp::Arch::new();
    let work: Vec<(&Range<usize>, &Range<usize>)> =
        groups.iter().flat_map(|offsets| pieces.iter().map(move |piece| (offsets, piece))).collect();
    let sums = parallel::map(work.len(), 1, &|i| {
        let (offsets, blocks) = (work[i].0.clone(), work[i].1.clone());
        let mut sums = vec![0.0_f64; offsets.len() * size];
        arch.dispatch(Piece { features, v_out, map, cin, cout, offsets, blocks, sums: &mut sums });
        sums
    });
    let totals = parallel::map(map.num_offsets, 1, &|offset| {
        let first = offset / together * pieces.len();
        let at = offset % together * size;
        let mut total = vec![0.0_f64; size];
        for piece in &sums[first..first + pieces.len()] {
            total.iter_mut().zip(&piece[at..at + size]).for_each(|(sum, v)| *sum += v);
        }
        total
    });
    for (i, row) in result.chunks_exact_mut(cin).enumerate() {
        let (c, offset) = (i / map.num_offsets, i % map.num_offsets);
        row.iter_mut().zip(totals[offset][c..].iter().step_by(columns)).for_each(|(v, &sum)| *v = single(sum));
    }
    result
}

/// What some blocks add to the gradients of some offsets.
struct Piece<'a> {
    features: &'a [f32],
    v_out: &'a [f32],
    map: &'a KernelMap,
    cin: usize,
    cout: usize,
    offsets: Range<usize>,
    blocks: Range<usize>,
    /// `[offsets, cin, columns]`.
    sums: &'a mut [f64],
}

impl WithSimd for Piece<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        // Input channels of a tile: two vectors of sums for each, as many as the registers hold.
        match S::F32_LANES {
            16 => self.run::<S, 12>(simd),
            _ => self.run::<S, 6>(simd),
        }
    }
}

impl Piece<'_> {
    #[inline(always)]
    fn run<S: Simd, const ROWS: usize>(&mut self, simd: S) {
        let (mut rows, mut short) = (Lines::default(), Lines::default());
        short.resize(self.sums.len());
        short.fill(0.0);
        for (done, block) in self.blocks.clone().enumerate() {
            self.load(block, &mut rows);
            for (i, offset) in self.offsets.clone().enumerate() {
                let (inputs, outputs) = self.map.pairs(block, offset);
                if !inputs.is_empty() {
                    let size = self.cin * self.cout.next_multiple_of(COLUMNS);
                    let sums = &mut short[i * size..(i + 1) * size];
                    self.add_pairs::<S, ROWS>(simd, inputs, outputs, &rows, sums);
                }
            }
            if done % SHORT == SHORT - 1 {
                self.add_short(&mut short);
            }
        }
        self.add_short(&mut short);
    }

    /// Copies a block's rows of `v_out`, filled up with zeros.
    #[inline(always)]
    fn load(&self, block: usize, rows: &mut Lines) {
        let columns = self.cout.next_multiple_of(COLUMNS);
        rows.resize(BLOCK * columns);
        let from = self.v_out[block * BLOCK * self.cout..].chunks_exact(self.cout);
        for (to, from) in rows.chunks_exact_mut(columns).zip(from) {
            to[..self.cout].copy_from_slice(from);
            to[self.cout..].fill(0.0);
        }
    }

    #[inline(always)]
    fn add_short(&mut self, short: &mut Lines) {
        for (sum, part) in self.sums.iter_mut().zip(short.iter_mut()) {
            *sum += f64::from(*part);
            *part = 0.0;
        }
    }

    /// Adds the pairs of one block and offset to `sums` `[cin, columns]`.
    #[inline(always)]
    fn add_pairs<S: Simd, const ROWS: usize>(
        &self,
        simd: S,
        inputs: &[u32],
        outputs: &[u16],
        rows: &Lines,
        sums: &mut [f32],
    ) {
        let vectors = self.cout.next_multiple_of(COLUMNS) / S::F32_LANES;
        let pairs =
            Pairs { inputs, outputs, features: self.features, cin: self.cin, rows: S::as_simd_f32s(rows).0, vectors };
        let sums = S::as_mut_simd_f32s(sums).0;
        for column in (0..vectors).step_by(2) {
            let mut first = 0;
            while first + ROWS <= self.cin {
                pairs.tile::<S, ROWS>(simd, first, column, sums);
                first += ROWS;
            }
            if ROWS > 8 && first + 8 <= self.cin {
                pairs.tile::<S, 8>(simd, first, column, sums);
                first += 8;
            }
            if first + 4 <= self.cin {
                pairs.tile::<S, 4>(simd, first, column, sums);
                first += 4;
            }
            if first + 2 <= self.cin {
                pairs.tile::<S, 2>(simd, first, column, sums);
                first += 2;
            }
            if first < self.cin {
                pairs.tile::<S, 1>(simd, first, column, sums);
            }
        }
    }
}

/// The pairs of one block and offset, and the rows that they name.
struct Pairs<'a, V> {
    inputs: &'a [u32],
    outputs: &'a [u16],
    features: &'a [f32],
    cin: usize,
    /// `[BLOCK, vectors]`.
    rows: &'a [V],
    vectors: usize,
}

impl<V: Copy> Pairs<'_, V> {
    /// Adds to the sums of `ROWS` input channels from `first` on and two vectors of output channels from `column` on.
    #[inline(always)]
    fn tile<S: Simd<f32s = V>, const ROWS: usize>(&self, simd: S, first: usize, column: usize, sums: &mut [V]) {
        let mut acc = [[simd.splat_f32s(0.0); 2]; ROWS];
        for (&input, &output) in self.inputs.iter().zip(self.outputs) {
            let values = &self.features[input as usize * self.cin + first..][..ROWS];
            let row = &self.rows[usize::from(output) * self.vectors + column..][..2];
            for r in 0..ROWS {
                let value = simd.splat_f32s(values[r]);
                acc[r][0] = simd.mul_add_f32s(value, row[0], acc[r][0]);
                acc[r][1] = simd.mul_add_f32s(value, row[1], acc[r][1]);
            }
        }
        for (r, acc) in acc.iter().enumerate() {
            let sums = &mut sums[(first + r) * self.vectors + column..][..2];
            sums[0] = simd.add_f32s(sums[0], acc[0]);
            sums[1] = simd.add_f32s(sums[1], acc[1]);
        }
    }
}

#[expect(clippy::cast_possible_truncation, reason = "gradients are stored in f32")]
fn single(value: f64) -> f32 {
    value as f32
}
