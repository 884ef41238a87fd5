//! Prefix sums, and the stable radix sort by keys of so many bits.

use wgpu::Buffer;

use super::error::GpuError;
use super::kernels::Kernel;
use super::work::Work;

const SCAN_BLOCKS: Kernel = Kernel::new("scan_blocks", &[include_str!("scan.wgsl")]);
const SCAN_ADD: Kernel = Kernel::new("scan_add", &[include_str!("scan.wgsl")]);
const SORT: &[&str] = &[include_str!("sort.wgsl")];
const SORT_COUNT: Kernel = Kernel::new("sort_count", SORT);
const SORT_SUM: Kernel = Kernel::new("sort_sum", SORT);
const SORT_SUM_FEW: Kernel = Kernel::new("sort_sum_few", SORT);
const SORT_SCATTER: Kernel = Kernel::new("sort_scatter", SORT);

/// Values of a block whose sum is taken, and elements of one that is sorted.
const SCANNED: u32 = 2048;
const SORTED: u32 = 1024;
/// Blocks up to which one group sums the counts of all.
const FEW: u32 = 32;
/// Bits of a digit, and digits.
const DIGIT_BITS: u32 = 8;
const DIGITS: u32 = 1 << DIGIT_BITS;
/// Names of the sums of blocks, of blocks of blocks and so on: 2048^3 values are more than 2^32.
const LEVELS: [&str; 3] = ["sums of blocks 1", "sums of blocks 2", "sums of blocks 3"];

/// Keys with their payloads.
#[derive(Clone, Debug)]
pub(super) struct Sorted {
    pub(super) keys: Buffer,
    pub(super) payloads: Buffer,
}

/// Makes the first `len` values the sums of those before each.
///
/// # Errors
/// As [`Work::buffer`].
pub(super) fn scan(work: &mut Work<'_>, values: &Buffer, len: u32) -> Result<(), GpuError> {
    scan_level(work, values, len, 0)
}

fn scan_level(work: &mut Work<'_>, values: &Buffer, len: u32, level: usize) -> Result<(), GpuError> {
    let blocks = len.div_ceil(SCANNED);
    let sums = work.buffer::<u32>(LEVELS[level], blocks as usize)?;
    let size = work.tell(&[len, blocks, 0, 0]);
    work.run(&SCAN_BLOCKS, &[&size], &[(1, values), (2, &sums)], blocks);
    if blocks > 1 {
        scan_level(work, &sums, blocks, level + 1)?;
        work.run(&SCAN_ADD, &[&size], &[(1, values), (2, &sums)], blocks - 1);
    }
    Ok(())
}

/// The first `len` keys and payloads, ascending by the lowest `bits` of the keys; equal ones keep their order. `spare` is overwritten.
///
/// # Errors
/// As [`Work::buffer`].
pub(super) fn sort(
    work: &mut Work<'_>,
    mut from: Sorted,
    mut spare: Sorted,
    len: u32,
    bits: u32,
) -> Result<Sorted, GpuError> {
    let blocks = len.div_ceil(SORTED);
    let digits = work.buffer::<u32>("digits", DIGITS as usize * blocks as usize)?;
    let totals = work.buffer::<u32>("digits in all", DIGITS as usize)?;
    for shift in (0..bits).step_by(DIGIT_BITS as usize) {
        let size = work.tell(&[len, blocks, shift, 0]);
        work.run(&SORT_COUNT, &[&size], &[(1, &from.keys), (2, &digits)], blocks);
        match blocks {
            0 => {}
            1..=FEW => work.run(&SORT_SUM_FEW, &[&size], &[(2, &digits), (3, &totals)], 1),
            _ => work.run(&SORT_SUM, &[&size], &[(2, &digits), (3, &totals)], DIGITS),
        }
        let bindings =
            [(1, &from.keys), (2, &digits), (3, &totals), (4, &from.payloads), (5, &spare.keys), (6, &spare.payloads)];
        work.run(&SORT_SCATTER, &[&size], &bindings, blocks);
        std::mem::swap(&mut from, &mut spare);
    }
    Ok(from)
}
