//! How rows along a curve are cut into patches.

use crate::ops::serialization::Order;

/// Positions along the curve that attend to each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Patch {
    /// First position that is attended to.
    pub(crate) first_key: usize,
    /// First position that attends; those before it belong to the patch before.
    pub(crate) first_query: usize,
    /// The position after the last, of both.
    pub(crate) end: usize,
}

impl Patch {
    /// Number of positions that are attended to.
    pub(crate) fn num_keys(&self) -> usize {
        self.end - self.first_key
    }
}

/// Patches of one or more clouds that lie one after the other along the curve.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Patches {
    order: Order,
    patches: Vec<Patch>,
    /// Patches of each group; groups share no position.
    groups: Vec<std::ops::Range<usize>>,
}

impl Patches {
    /// Cuts an order into patches.
    ///
    /// # Shapes
    /// `counts`: rows of each cloud; the order visits one cloud after the other.
    ///
    /// # Formula
    /// The size is `size` or the rows of the smallest cloud, if fewer. What is left at the end of a cloud attends to the last `size`
    /// positions of the cloud: its own and, before them, some of the patch before.
    ///
    /// # Source
    /// Wu et al., Point Transformer V3, 2024, as its implementation does it without flash attention.
    ///
    /// # Errors
    /// When `size` is 0 or the counts do not add up to the length of the order.
    pub fn new(order: Order, counts: &[usize], size: usize) -> candle_core::Result<Self> {
        let total: usize = counts.iter().sum();
        if size == 0 || total != order.rows.len() {
            candle_core::bail!(
                "patches: expected a size above 0 and {} rows, found {size} and {total}",
                order.rows.len()
            );
        }
        let size = counts.iter().copied().filter(|&n| n > 0).min().unwrap_or(1).min(size);
        let mut patches: Vec<Patch> = Vec::new();
        let mut groups = Vec::new();
        let mut start = 0;
        for &count in counts {
            let end = start + count;
            for first in (start..end).step_by(size) {
                let next = (first + size).min(end);
                patches.push(Patch { first_key: next - size, first_query: first, end: next });
                let last = patches.len();
                if next - first < size {
                    // Its keys belong to the patch before: one group.
                    groups.pop();
                    groups.push(last - 2..last);
                } else {
                    groups.push(last - 1..last);
                }
            }
            start = end;
        }
        Ok(Self { order, patches, groups })
    }

    /// Number of rows.
    pub fn num_rows(&self) -> usize {
        self.order.rows.len()
    }

    /// The rows along the curve.
    pub(crate) fn rows(&self) -> &[u32] {
        &self.order.rows
    }

    /// Groups of patches that share no row with any other group: positions and patches.
    pub(crate) fn groups(&self) -> impl Iterator<Item = Group<'_>> {
        self.groups.iter().map(|group| Group { patches: &self.patches[group.clone()] })
    }
}

/// Patches that may share rows with each other, but with no others.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Group<'a> {
    pub(crate) patches: &'a [Patch],
}

impl Group<'_> {
    /// The first position of the group.
    pub(crate) fn first(&self) -> usize {
        self.patches[0].first_query
    }

    /// The position after the last.
    pub(crate) fn end(&self) -> usize {
        self.patches[self.patches.len() - 1].end
    }
}

/// The rows of each group as separate slices, in the order of the curve.
pub(crate) fn rows_by_group<'a>(values: &'a mut [f32], width: usize, patches: &Patches) -> Vec<Vec<&'a mut [f32]>> {
    let mut rows: Vec<Option<&mut [f32]>> = values.chunks_exact_mut(width.max(1)).map(Some).collect();
    let mut take = |row: u32| rows.get_mut(row as usize).and_then(Option::take);
    patches
        .groups()
        .map(|group| patches.rows()[group.first()..group.end()].iter().filter_map(|&row| take(row)).collect())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::{Patch, Patches};
    use crate::ops::serialization::order;

    fn patches(counts: &[usize], size: usize) -> Patches {
        let total: usize = counts.iter().sum();
        Patches::new(order(&(0..total as u64).collect::<Vec<u64>>()), counts, size).unwrap()
    }

    #[test]
    fn the_rest_borrows_from_the_patch_before() {
        let cut = patches(&[10], 4);
        let want = [(0, 0, 4), (4, 4, 8), (6, 8, 10)];
        let got: Vec<Patch> = cut.patches.clone();
        assert_eq!(got.iter().map(|p| (p.first_key, p.first_query, p.end)).collect::<Vec<_>>(), want);
        assert_eq!(cut.groups, [0..1, 1..3]);
    }

    #[test]
    fn the_smallest_cloud_sets_the_size() {
        let cut = patches(&[3, 7], 100);
        let got: Vec<_> = cut.patches.iter().map(|p| (p.first_key, p.first_query, p.end)).collect();
        assert_eq!(got, [(0, 0, 3), (3, 3, 6), (6, 6, 9), (7, 9, 10)]);
        assert_eq!(cut.groups, [0..1, 1..2, 2..4]);
        assert_eq!(patches(&[5], 128).patches.len(), 1);
    }

    #[test]
    fn none_and_wrong_counts() {
        assert_eq!(patches(&[], 8).num_rows(), 0);
        assert_eq!(patches(&[0], 8).patches.len(), 0);
        assert!(Patches::new(order(&[1, 2]), &[3], 8).is_err());
        assert!(Patches::new(order(&[1, 2]), &[2], 0).is_err());
    }
}
