//! Kernel maps: which input row meets which output row under which kernel offset.

mod build;

use std::sync::{Arc, OnceLock};

pub use build::Halving;

use super::sites::index32;

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
    /// Not known to be.
    None,
}

impl KernelMap {
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
    pub(crate) fn num_outputs(&self) -> usize {
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

#[expect(clippy::cast_possible_truncation, reason = "below BLOCK")]
fn local(row: usize) -> u16 {
    row as u16
}
