//! Kernel maps: which input row meets which output row under which kernel offset.

use std::sync::{Arc, OnceLock};

use rayon::prelude::*;

use super::sites::{Sites, index32, key_step};
use crate::error::{EngineError, Result};

/// Output rows of a block: its accumulators stay in the second-level cache.
pub(super) const BLOCK: usize = 512;

/// Pairs of rows, by block of output rows, then by kernel offset, then by output row.
#[derive(Debug)]
pub struct KernelMap {
    pub(super) num_inputs: usize,
    pub(super) num_outputs: usize,
    pub(super) num_offsets: usize,
    /// `[blocks * num_offsets + 1]`: where the pairs of a block and an offset start.
    pub(super) first_pair: Vec<u32>,
    /// Input rows of the pairs.
    pub(super) inputs: Vec<u32>,
    /// Output rows of the pairs, within their block.
    pub(super) outputs: Vec<u16>,
    pub(super) symmetry: Symmetry,
    reversed: OnceLock<Arc<KernelMap>>,
}

/// Whether a map is its own reverse.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Symmetry {
    /// The pairs of offset `o` are those of offset `num_offsets - 1 - o` with inputs and outputs exchanged.
    Mirrored,
    /// Nothing is known.
    None,
}

/// A grid halved: the coarse sites and the maps down to them and back up.
#[derive(Clone, Debug)]
pub struct Halving {
    /// Occupied voxels of the coarse grid.
    pub coarse: Sites,
    /// Convolution with kernel 2 and stride 2.
    pub down: Arc<KernelMap>,
    /// Its transposed.
    pub up: Arc<KernelMap>,
}

/// The pairs of one block: ends by offset, input rows, output rows in the block.
struct BlockPairs {
    ends: Vec<u32>,
    inputs: Vec<u32>,
    outputs: Vec<u16>,
}

impl KernelMap {
    /// The map of a submanifold convolution with an odd kernel: outputs are the inputs' sites.
    ///
    /// # Errors
    /// When the kernel is even, zero, or wider than 15.
    pub fn submanifold(sites: &Sites, kernel: usize) -> Result<Self> {
        let radius = radius_of(kernel)?;
        let keys = sites.keys();
        let blocks = keys
            .par_chunks(BLOCK)
            .map_init(Vec::new, |rows, block| {
                rows.clear();
                rows.resize(kernel.pow(3) * block.len(), NONE);
                for (line, (dx, dy)) in lines(radius).enumerate() {
                    let rows = &mut rows[line * kernel * block.len()..(line + 1) * kernel * block.len()];
                    join_line(keys, block, key_step(dx, dy, -radius), kernel, rows);
                }
                BlockPairs::of_rows(rows, block.len())
            })
            .collect();
        let mut map = Self::of_blocks(blocks, [keys.len(), keys.len()], kernel.pow(3));
        map.symmetry = Symmetry::Mirrored;
        Ok(map)
    }

    /// The map of a layer that treats every row alone.
    pub fn identity(rows: usize) -> Self {
        let inputs = (0..index32(rows)).collect();
        let outputs = (0..rows).map(|i| local(i % BLOCK)).collect();
        let first_pair = (0..=rows.div_ceil(BLOCK)).map(|block| index32((block * BLOCK).min(rows))).collect();
        Self {
            num_inputs: rows,
            num_outputs: rows,
            num_offsets: 1,
            first_pair,
            inputs,
            outputs,
            symmetry: Symmetry::Mirrored,
            reversed: OnceLock::new(),
        }
    }

    /// The maps between sites and those of the grid that is coarser by 2.
    ///
    /// # Errors
    /// As [`Sites::unique`].
    pub fn halving(sites: &Sites) -> Result<Halving> {
        let (coarse, parent) = sites.halved()?;
        let blocks = sites
            .coords()
            .par_chunks(BLOCK)
            .zip(parent.par_chunks(BLOCK))
            .map(|(coords, parents)| {
                let mut rows = vec![NONE; 8 * coords.len()];
                for (i, (&[_, x, y, z], &parent)) in coords.iter().zip(parents).enumerate() {
                    let odd = |v: i32| usize::from(v & 1 == 1);
                    let offset = (odd(x) * 2 + odd(y)) * 2 + odd(z);
                    rows[offset * coords.len() + i] = parent;
                }
                BlockPairs::of_rows(&rows, coords.len())
            })
            .collect();
        let up = Arc::new(Self::of_blocks(blocks, [coarse.len(), sites.len()], 8));
        let down = up.reversed();
        Ok(Halving { coarse, down, up })
    }

    /// The map of a convolution with any odd kernel, stride 2 and padding `kernel / 2`, and its output sites: every coarse site
    /// that an input reaches.
    ///
    /// # Errors
    /// As [`KernelMap::submanifold`] and [`Sites::unique`].
    pub fn strided(sites: &Sites, kernel: usize) -> Result<(Sites, Self)> {
        let radius = radius_of(kernel)?;
        let mut reached = Vec::new();
        for &[b, x, y, z] in sites.coords() {
            let of = |v: i32| (-radius..=radius).filter(move |o| (v - o) & 1 == 0).map(move |o| (v - o) >> 1);
            reached.extend(of(x).flat_map(|x| of(y).flat_map(move |y| of(z).map(move |z| [b, x, y, z]))));
        }
        let (coarse, _) = Sites::unique(&reached)?;
        let blocks = coarse
            .coords()
            .par_chunks(BLOCK)
            .map(|block| {
                let mut rows = vec![NONE; kernel.pow(3) * block.len()];
                for (line, (dx, dy)) in lines(radius).enumerate() {
                    for (step, dz) in (-radius..=radius).enumerate() {
                        for (i, &[b, x, y, z]) in block.iter().enumerate() {
                            if let Some(row) = sites.find(&[b, 2 * x + dx, 2 * y + dy, 2 * z + dz]) {
                                rows[(line * kernel + step) * block.len() + i] = index32(row);
                            }
                        }
                    }
                }
                BlockPairs::of_rows(&rows, block.len())
            })
            .collect();
        let map = Self::of_blocks(blocks, [sites.len(), coarse.len()], kernel.pow(3));
        Ok((coarse, map))
    }

    /// The same pairs with inputs and outputs exchanged: the map of the transposed convolution and of the gradient by the
    /// features. Built once.
    pub fn reversed(&self) -> Arc<Self> {
        self.reversed.get_or_init(|| Arc::new(self.reverse())).clone()
    }

    /// Number of pairs of an input and an output row.
    pub fn num_pairs(&self) -> usize {
        self.inputs.len()
    }

    /// Number of input rows.
    pub fn num_inputs(&self) -> usize {
        self.num_inputs
    }

    /// Number of output rows.
    pub fn num_outputs(&self) -> usize {
        self.num_outputs
    }

    /// Number of kernel offsets.
    pub fn num_offsets(&self) -> usize {
        self.num_offsets
    }

    /// The pairs of a block of output rows under one offset: input rows, output rows within the block.
    #[inline(always)]
    pub(super) fn pairs(&self, block: usize, offset: usize) -> (&[u32], &[u16]) {
        let at = block * self.num_offsets + offset;
        let range = self.first_pair[at] as usize..self.first_pair[at + 1] as usize;
        (&self.inputs[range.clone()], &self.outputs[range])
    }

    fn of_blocks(blocks: Vec<BlockPairs>, [num_inputs, num_outputs]: [usize; 2], num_offsets: usize) -> Self {
        let total = blocks.iter().map(|b| b.inputs.len()).sum();
        let mut first_pair = Vec::with_capacity(blocks.len() * num_offsets + 1);
        let (mut inputs, mut outputs) = (Vec::with_capacity(total), Vec::with_capacity(total));
        first_pair.push(0);
        for block in &blocks {
            let base = index32(inputs.len());
            first_pair.extend(block.ends.iter().map(|end| base + end));
            inputs.extend_from_slice(&block.inputs);
            outputs.extend_from_slice(&block.outputs);
        }
        Self {
            num_inputs,
            num_outputs,
            num_offsets,
            first_pair,
            inputs,
            outputs,
            symmetry: Symmetry::None,
            reversed: OnceLock::new(),
        }
    }

    /// Counting sort of the pairs by (block of the input row, offset); within it by input row, as each input row has at most one
    /// output under an offset and outputs ascend.
    fn reverse(&self) -> Self {
        let num_blocks = self.num_inputs.div_ceil(BLOCK);
        let mut first_pair = vec![0_u32; num_blocks * self.num_offsets + 1];
        let bucket = |input: u32, offset: usize| input as usize / BLOCK * self.num_offsets + offset;
        self.for_each_pair(|offset, input, _| first_pair[bucket(input, offset) + 1] += 1);
        for i in 1..first_pair.len() {
            first_pair[i] += first_pair[i - 1];
        }
        let mut next = first_pair.clone();
        let (mut inputs, mut outputs) = (vec![0_u32; self.inputs.len()], vec![0_u16; self.inputs.len()]);
        self.for_each_pair(|offset, input, output| {
            let place = &mut next[bucket(input, offset)];
            inputs[*place as usize] = output;
            outputs[*place as usize] = local(input as usize % BLOCK);
            *place += 1;
        });
        Self {
            num_inputs: self.num_outputs,
            num_outputs: self.num_inputs,
            num_offsets: self.num_offsets,
            first_pair,
            inputs,
            outputs,
            symmetry: Symmetry::None,
            reversed: OnceLock::new(),
        }
    }

    fn for_each_pair(&self, mut visit: impl FnMut(usize, u32, u32)) {
        for block in 0..self.num_outputs.div_ceil(BLOCK) {
            for offset in 0..self.num_offsets {
                let (inputs, outputs) = self.pairs(block, offset);
                for (&input, &output) in inputs.iter().zip(outputs) {
                    visit(offset, input, index32(block * BLOCK) + u32::from(output));
                }
            }
        }
    }
}

/// No input row.
const NONE: u32 = u32::MAX;

impl BlockPairs {
    /// From a table `[num_offsets, len]` of input rows, [`NONE`] where there is none.
    fn of_rows(rows: &[u32], len: usize) -> Self {
        let num_pairs = rows.iter().filter(|&&input| input != NONE).count();
        let (mut inputs, mut outputs) = (Vec::with_capacity(num_pairs), Vec::with_capacity(num_pairs));
        let mut ends = Vec::with_capacity(rows.len() / len);
        for row in rows.chunks_exact(len) {
            for (i, &input) in row.iter().enumerate() {
                if input != NONE {
                    inputs.push(input);
                    outputs.push(local(i));
                }
            }
            ends.push(index32(inputs.len()));
        }
        Self { ends, inputs, outputs }
    }
}

/// Finds, for every key of the block, the rows at `key + step`, `+ 1`, .. `+ kernel - 1`: one merge of two sorted lists.
fn join_line(keys: &[u64], block: &[u64], step: u64, kernel: usize, rows: &mut [u32]) {
    let mut at = keys.partition_point(|&k| k < block[0].wrapping_add(step));
    for (i, key) in block.iter().enumerate() {
        let start = key.wrapping_add(step);
        while at < keys.len() && keys[at] < start {
            at += 1;
        }
        for (k, &candidate) in keys[at..].iter().take(kernel).enumerate() {
            let Ok(place) = usize::try_from(candidate - start) else { break };
            if place >= kernel {
                break;
            }
            rows[place * block.len() + i] = index32(at + k);
        }
    }
}

/// Offsets (dx, dy) in kernel order.
fn lines(radius: i32) -> impl Iterator<Item = (i32, i32)> {
    (-radius..=radius).flat_map(move |dx| (-radius..=radius).map(move |dy| (dx, dy)))
}

fn radius_of(kernel: usize) -> Result<i32> {
    match i32::try_from(kernel / 2) {
        Ok(radius) if kernel % 2 == 1 && kernel <= 15 => Ok(radius),
        _ => Err(EngineError::Setting {
            setting: "kernel",
            expected: "an odd width up to 15".to_owned(),
            found: kernel.to_string(),
        }),
    }
}

#[expect(clippy::cast_possible_truncation, reason = "below BLOCK")]
fn local(row: usize) -> u16 {
    row as u16
}
