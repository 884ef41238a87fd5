//! How kernel maps are found.

use std::sync::{Arc, OnceLock};

use rayon::prelude::*;

use super::{BLOCK, KernelMap, Symmetry, local};
use crate::error::{EngineError, Result};
use crate::ops::sparse_conv::sites::{Sites, check_count, index32, key_step};
use crate::parallel;

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
    /// When the kernel is even, zero, or wider than 15, or there are more pairs than 32 bits count.
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
        let mut map = Self::of_blocks(blocks, [keys.len(), keys.len()], kernel.pow(3))?;
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
        let blocks = parallel::map(sites.len().div_ceil(BLOCK), 1, &|block| {
            let coords = block_of(sites.coords(), block);
            let mut rows = vec![NONE; 8 * coords.len()];
            for (i, (&[_, x, y, z], &parent)) in coords.iter().zip(&parent[block * BLOCK..]).enumerate() {
                let odd = |v: i32| usize::from(v & 1 == 1);
                let offset = (odd(x) * 2 + odd(y)) * 2 + odd(z);
                rows[offset * coords.len() + i] = parent;
            }
            BlockPairs::of_rows(&rows, coords.len())
        });
        let up = Arc::new(Self::of_blocks(blocks, [coarse.len(), sites.len()], 8)?);
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
            let coarse_of = |v: i32| (-radius..=radius).filter(move |o| (v - o) & 1 == 0).map(move |o| (v - o) >> 1);
            reached.extend(
                coarse_of(x).flat_map(|x| coarse_of(y).flat_map(move |y| coarse_of(z).map(move |z| [b, x, y, z]))),
            );
        }
        let (coarse, _) = Sites::unique(&reached)?;
        let blocks = parallel::map(coarse.len().div_ceil(BLOCK), 1, &|block| {
            let block = block_of(coarse.coords(), block);
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
        });
        let map = Self::of_blocks(blocks, [sites.len(), coarse.len()], kernel.pow(3))?;
        Ok((coarse, map))
    }

    /// # Errors
    /// More pairs than 32 bits count.
    fn of_blocks(blocks: Vec<BlockPairs>, [num_inputs, num_outputs]: [usize; 2], num_offsets: usize) -> Result<Self> {
        let total = blocks.iter().map(|b| b.inputs.len()).sum();
        check_count("pairs of neighbouring voxels", total)?;
        let mut first_pair = Vec::with_capacity(blocks.len() * num_offsets + 1);
        let (mut inputs, mut outputs) = (Vec::with_capacity(total), Vec::with_capacity(total));
        first_pair.push(0);
        for block in &blocks {
            let base = index32(inputs.len());
            first_pair.extend(block.ends.iter().map(|end| base + end));
            inputs.extend_from_slice(&block.inputs);
            outputs.extend_from_slice(&block.outputs);
        }
        Ok(Self {
            num_inputs,
            num_outputs,
            num_offsets,
            first_pair,
            inputs,
            outputs,
            symmetry: Symmetry::None,
            reversed: OnceLock::new(),
        })
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

/// The coordinates of a block.
fn block_of(coords: &[[i32; 4]], block: usize) -> &[[i32; 4]] {
    &coords[block * BLOCK..coords.len().min((block + 1) * BLOCK)]
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
