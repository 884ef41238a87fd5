//! The search: one descent for the points of a leaf together.
//!
//! A vector of f32 sorts out what is surely too far; what is left is compared in f64, by (squared distance, index). Nodes are cut off by
//! the same pair, so that a million points on one spot cost no more than any others, and by group, so that a region seen at one time
//! only is skipped at once.

use pulp::{Simd, WithSimd};
use rayon::prelude::*;

use super::NO_NEIGHBOUR;
use super::batch::Batch;
use super::tree::{Item, LEAF, Leaf, Node, Tree};
use crate::parallel;

/// Rows that one piece of work copies.
const PIECE: usize = 4096;

/// `[N, k]` indices of the nearest points of other groups.
pub(super) fn search(points: &[[f32; 3]], groups: &[u32], k: usize) -> Vec<u32> {
    if k == 0 || points.is_empty() {
        return Vec::new();
    }
    let tree = Tree::new(points, groups);
    let by_place = search_leaves(&tree, &tree.leaves, k);
    rows_at(&by_place, &tree.place_of, k)
}

/// `[M, k]` indices of the nearest points of other groups, for the points `queries` alone.
pub(super) fn search_of(points: &[[f32; 3]], groups: &[u32], queries: &[u32], k: usize) -> Vec<u32> {
    if k == 0 || queries.is_empty() {
        return Vec::new();
    }
    let tree = Tree::new(points, groups);
    // Queries that lie in the same region share a descent.
    let mut order: Vec<(u32, u32)> = queries.iter().map(|&i| tree.place_of[i as usize]).zip(0..).collect();
    order.sort_unstable();
    let point_at = |&(place, _): &(u32, u32)| tree.leaves[place as usize / LEAF].item(place as usize % LEAF);
    let items: Vec<Item> = order.iter().map(point_at).collect();
    let leaves: Vec<Leaf> = items.chunks(LEAF).map(Leaf::of).collect();
    let by_place = search_leaves(&tree, &leaves, k);
    let mut place_of = vec![0; queries.len()];
    (0_u32..).zip(&order).for_each(|(place, &(_, query))| place_of[query as usize] = place);
    rows_at(&by_place, &place_of, k)
}

/// `[num_leaves, LEAF, k]` neighbours of the points of `queries` among those of the tree.
fn search_leaves(tree: &Tree, queries: &[Leaf], k: usize) -> Vec<u32> {
    let mut by_place = vec![NO_NEIGHBOUR; queries.len() * LEAF * k];
    let arch = pulp::Arch::new();
    by_place.par_chunks_mut(LEAF * k).zip(queries).for_each_init(
        || Batch::new(k),
        |batch, (out, queries)| arch.dispatch(SearchLeaf { tree, batch, queries, out }),
    );
    by_place
}

fn rows_at(by_place: &[u32], places: &[u32], k: usize) -> Vec<u32> {
    let mut indices = vec![0; places.len() * k];
    parallel::for_chunks(&mut indices, PIECE * k, &|piece, rows| {
        for (row, &place) in rows.chunks_exact_mut(k).zip(&places[piece * PIECE..]) {
            row.copy_from_slice(&by_place[place as usize * k..][..k]);
        }
    });
    indices
}

struct SearchLeaf<'a> {
    tree: &'a Tree,
    batch: &'a mut Batch,
    queries: &'a Leaf,
    out: &'a mut [u32],
}

impl WithSimd for SearchLeaf<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { tree, batch, queries, out } = self;
        batch.start(queries);
        let area = Area::of(queries);
        batch.stack.push((0, (0.0, 0)));
        while let Some((index, best)) = batch.stack.pop() {
            let node = &tree.nodes[index as usize];
            if best > batch.worst || (node.groups[0] == node.groups[1] && area.groups == node.groups) {
                continue;
            }
            if node.right == 0 {
                scan(simd, batch, queries, node, &tree.leaves[node.leaf as usize]);
                continue;
            }
            let [left, right] = [index + 1, node.right].map(|child| {
                let node = &tree.nodes[child as usize];
                (area.centre_distance(node), (child, (area.distance(node), node.first_index)))
            });
            // The nearer child goes on top; where both are as near, the one with the smaller indices.
            let left_first = (left.0, left.1.1.1) < (right.0, right.1.1.1);
            let (near, far) = if left_first { (left.1, right.1) } else { (right.1, left.1) };
            batch.stack.extend([far, near].into_iter().filter(|(_, best)| *best <= batch.worst));
        }
        for (out, found) in out.iter_mut().zip(&batch.found) {
            *out = found.1;
        }
    }
}

/// Where the points of a batch lie.
#[derive(Debug)]
struct Area {
    low: [f64; 3],
    high: [f64; 3],
    groups: [u32; 2],
}

impl Area {
    fn of(leaf: &Leaf) -> Self {
        let count = leaf.indices.iter().position(|&i| i == NO_NEIGHBOUR).unwrap_or(LEAF);
        let bound = |axis: usize, pick: fn(f64, f64) -> f64| {
            leaf.columns[axis][..count].iter().map(|&c| f64::from(c)).reduce(pick).unwrap_or(0.0)
        };
        let groups = &leaf.groups[..count];
        Self {
            low: [0, 1, 2].map(|axis| bound(axis, f64::min)),
            high: [0, 1, 2].map(|axis| bound(axis, f64::max)),
            groups: [groups.iter().copied().min().unwrap_or(0), groups.iter().copied().max().unwrap_or(0)],
        }
    }

    /// No point of the area is nearer to a point of the node: the steps round the same way as those of the distance.
    #[inline(always)]
    fn distance(&self, node: &Node) -> f64 {
        let [x, y, z] = [0, 1, 2].map(|axis| {
            let (low, high) = (f64::from(node.low[axis]), f64::from(node.high[axis]));
            (low - self.high[axis]).max(self.low[axis] - high).max(0.0)
        });
        (x * x + y * y) + z * z
    }

    /// Squared distance of the area's centre to the node's box: what decides the order of the visits.
    #[inline(always)]
    fn centre_distance(&self, node: &Node) -> f64 {
        let [x, y, z] = [0, 1, 2].map(|axis| {
            let centre = (self.low[axis] + self.high[axis]) * 0.5;
            (f64::from(node.low[axis]) - centre).max(centre - f64::from(node.high[axis])).max(0.0)
        });
        (x * x + y * y) + z * z
    }
}

/// Looks through the points of one leaf for every query that they can serve.
#[inline(always)]
fn scan<S: Simd>(simd: S, batch: &mut Batch, queries: &Leaf, node: &Node, candidates: &Leaf) {
    let single_group = node.groups[0] == node.groups[1];
    let mut changed = false;
    for first in (0..LEAF).step_by(S::F32_LANES) {
        let mut near = bits::<S>(queries_in_reach(simd, batch, queries, node, first));
        while near != 0 {
            let slot = first + near.trailing_zeros() as usize;
            near &= near - 1;
            if !(single_group && queries.groups[slot] == node.groups[0]) {
                changed |= scan_for(simd, batch, queries, slot, candidates);
            }
        }
    }
    if changed {
        batch.update_worst();
    }
}

/// The queries, from slot `first` on, whose limit reaches the node's box.
#[inline(always)]
fn queries_in_reach<S: Simd>(simd: S, batch: &Batch, queries: &Leaf, node: &Node, first: usize) -> S::m32s {
    let zero = simd.splat_f32s(0.0);
    let mut sum = zero;
    for axis in 0..3 {
        let query = vector::<S>(&queries.columns[axis], first);
        let below = simd.sub_f32s(simd.splat_f32s(node.low[axis]), query);
        let above = simd.sub_f32s(query, simd.splat_f32s(node.high[axis]));
        let outside = simd.max_f32s(simd.max_f32s(below, above), zero);
        sum = simd.mul_add_f32s(outside, outside, sum);
    }
    simd.less_than_or_equal_f32s(sum, vector::<S>(&batch.limits, first))
}

/// Looks through a leaf for one query; whether anything was found.
#[inline(always)]
fn scan_for<S: Simd>(simd: S, batch: &mut Batch, queries: &Leaf, slot: usize, candidates: &Leaf) -> bool {
    let query = [0, 1, 2].map(|axis| queries.columns[axis][slot]);
    let own = simd.splat_u32s(queries.groups[slot]);
    let mut changed = false;
    for first in (0..LEAF).step_by(S::F32_LANES) {
        let mut sum = simd.splat_f32s(0.0);
        for (column, query) in candidates.columns.iter().zip(query) {
            let d = simd.sub_f32s(vector::<S>(column, first), simd.splat_f32s(query));
            sum = simd.mul_add_f32s(d, d, sum);
        }
        let groups = S::as_simd_u32s(&candidates.groups).0[first / S::F32_LANES];
        let mut near = bits::<S>(simd.and_m32s(
            simd.less_than_or_equal_f32s(sum, simd.splat_f32s(batch.limits[slot])),
            simd.not_m32s(simd.equal_u32s(groups, own)),
        ));
        while near != 0 {
            let place = first + near.trailing_zeros() as usize;
            near &= near - 1;
            let point = [0, 1, 2].map(|axis| candidates.columns[axis][place]);
            let candidate = (super::squared_distance(&point, &query), candidates.indices[place]);
            if candidate < batch.last[slot] {
                batch.insert(slot, candidate);
                changed = true;
            }
        }
    }
    changed
}

/// One bit per lane of a mask, the first lane lowest. (`first_true_m32s` of pulp 0.22.3 counts from the wrong end on AVX-512.)
#[inline(always)]
fn bits<S: Simd>(mask: S::m32s) -> u32 {
    let bytes = bytemuck::bytes_of(&mask);
    match *bytes {
        [byte] => u32::from(byte),
        [low, high] => u32::from(u16::from_le_bytes([low, high])),
        _ => {
            (bytes.as_chunks::<4>().0.iter().enumerate()).fold(0, |all, (lane, m)| all | (u32::from(m[0] & 1) << lane))
        }
    }
}

#[inline(always)]
fn vector<S: Simd>(values: &[f32; LEAF], first: usize) -> S::f32s {
    S::as_simd_f32s(values).0[first / S::F32_LANES]
}
