//! Building: a binary tree by the surface area heuristic, then nodes of [`WIDTH`] children made of it.

use glam::Vec3;

use super::{Child, Node, WIDTH};
use crate::scenes::primitive::Primitive;

/// Primitives up to which a node is not split.
const LEAF_SIZE: usize = 3;

/// Candidate cuts per axis.
const NUM_BINS: usize = 12;

/// Levels of the binary tree that may be cut unevenly; below them every cut halves.
const MAX_UNEVEN: usize = 16;

/// A primitive with its bounds.
pub(super) struct Item {
    pub(super) low: Vec3,
    pub(super) high: Vec3,
    pub(super) primitive: Primitive,
}

/// A node of the binary tree that the builder makes first: a range of items, cut in two unless it is a leaf.
pub(super) struct Cut {
    low: Vec3,
    high: Vec3,
    first: usize,
    count: usize,
    /// The left part; the right one follows it.
    left: Option<usize>,
}

/// The binary tree over the items, which it reorders; the root comes first.
pub(super) fn cut(items: &mut [Item]) -> Vec<Cut> {
    let whole = |first, count| Cut { low: Vec3::ZERO, high: Vec3::ZERO, first, count, left: None };
    let mut cuts = vec![whole(0, items.len())];
    let mut pending = vec![(0_usize, 0_usize)];
    while let Some((index, depth)) = pending.pop() {
        let (first, count) = (cuts[index].first, cuts[index].count);
        let range = &mut items[first..first + count];
        (cuts[index].low, cuts[index].high) = bounds(range);
        if count <= LEAF_SIZE {
            continue;
        }
        let num_left = if depth < MAX_UNEVEN { partition(range) } else { halve(range) };
        let left = cuts.len();
        cuts.push(whole(first, num_left));
        cuts.push(whole(first + num_left, count - num_left));
        cuts[index].left = Some(left);
        pending.push((left, depth + 1));
        pending.push((left + 1, depth + 1));
    }
    cuts
}

/// The place in `nodes` of the wide node made of the part `root` of the binary tree.
pub(super) fn widen(cuts: &[Cut], root: usize, nodes: &mut Vec<Node>) -> usize {
    let mut parts = vec![root];
    while parts.len() < WIDTH {
        let inner = parts.iter().enumerate().filter_map(|(k, &p)| Some((k, cuts[p].left?)));
        let size = |&(k, _): &(usize, usize)| area((cuts[parts[k]].low, cuts[parts[k]].high));
        let Some((k, left)) = inner.max_by(|a, b| size(a).total_cmp(&size(b))) else { break };
        parts[k] = left;
        parts.push(left + 1);
    }
    let index = nodes.len();
    nodes.push(Node {
        bounds: [[[f32::INFINITY; WIDTH]; 3], [[f32::NEG_INFINITY; WIDTH]; 3]],
        children: [Child::default(); WIDTH],
    });
    for (lane, &part) in parts.iter().enumerate() {
        let cut = &cuts[part];
        let child = match cut.left {
            Some(_) => Child { first: widen(cuts, part, nodes), count: 0 },
            None => Child { first: cut.first, count: cut.count },
        };
        nodes[index].children[lane] = child;
        for axis in 0..3 {
            nodes[index].bounds[0][axis][lane] = cut.low[axis];
            nodes[index].bounds[1][axis][lane] = cut.high[axis];
        }
    }
    index
}

fn bounds(items: &[Item]) -> (Vec3, Vec3) {
    items
        .iter()
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), item| (low.min(item.low), high.max(item.high)))
}

fn area((low, high): (Vec3, Vec3)) -> f32 {
    let e = high - low;
    e.x * e.y + e.y * e.z + e.z * e.x
}

/// Number of items of the left side after reordering by the cheapest binned cut of the surface area heuristic.
fn partition(items: &mut [Item]) -> usize {
    let middle = |item: &Item| (item.low + item.high) * 0.5;
    let (low, high) = items
        .iter()
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), item| (l.min(middle(item)), h.max(middle(item))));
    let mut best: Option<(f32, usize, f32)> = None;
    for axis in 0..3 {
        let extent = high[axis] - low[axis];
        if extent <= 0.0 {
            continue;
        }
        for bin in 1..NUM_BINS {
            let cut = low[axis] + extent * bin as f32 / NUM_BINS as f32;
            let empty = (Vec3::INFINITY, Vec3::NEG_INFINITY, 0.0_f32);
            let (mut left, mut right) = (empty, empty);
            for item in items.iter() {
                let side = if middle(item)[axis] < cut { &mut left } else { &mut right };
                *side = (side.0.min(item.low), side.1.max(item.high), side.2 + 1.0);
            }
            if left.2 == 0.0 || right.2 == 0.0 {
                continue;
            }
            let cost = left.2 * area((left.0, left.1)) + right.2 * area((right.0, right.1));
            if best.is_none_or(|(least, ..)| cost < least) {
                best = Some((cost, axis, cut));
            }
        }
    }
    let Some((_, axis, cut)) = best else { return halve(items) };
    let mut len = 0;
    for k in 0..items.len() {
        if middle(&items[k])[axis] < cut {
            items.swap(len, k);
            len += 1;
        }
    }
    len
}

/// Half of the items after ordering them along the longest side of their bounds.
fn halve(items: &mut [Item]) -> usize {
    let (low, high) = bounds(items);
    let axis = (high - low).max_position();
    items.sort_by(|a, b| (a.low[axis] + a.high[axis]).total_cmp(&(b.low[axis] + b.high[axis])));
    items.len() / 2
}
