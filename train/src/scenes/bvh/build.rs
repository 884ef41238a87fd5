//! Building: a binary tree by the surface area heuristic, then nodes of [`WIDTH`] children made of it.

use glam::{Vec3, Vec4};

use super::{Child, Node, WIDTH};
use crate::scenes::{maths::count, primitive::Primitive};

/// Primitives up to which a node is not split: what [`Child`] can count.
const LEAF_SIZE: usize = 3;

/// Candidate cuts per axis.
const NUM_BINS: usize = 12;

/// Levels of the binary tree that may be cut unevenly; below them every cut halves.
const MAX_UNEVEN: usize = 12;

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
    nodes.push(Node { bounds: [[Vec4::INFINITY; 3], [Vec4::NEG_INFINITY; 3]], children: [Child::default(); WIDTH] });
    for (lane, &part) in parts.iter().enumerate() {
        let cut = &cuts[part];
        let child = match cut.left {
            Some(_) => Child::new(widen(cuts, part, nodes), 0),
            None => Child::new(cut.first, cut.count),
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

/// Items of a slice of space.
#[derive(Clone, Copy)]
struct Bin {
    bounds: (Vec3, Vec3),
    count: f32,
}

impl Bin {
    const EMPTY: Self = Self { bounds: (Vec3::INFINITY, Vec3::NEG_INFINITY), count: 0.0 };

    fn with(self, other: Self) -> Self {
        let (a, b) = (self.bounds, other.bounds);
        Self { bounds: (a.0.min(b.0), a.1.max(b.1)), count: self.count + other.count }
    }

    /// Share of this side in the cost of a cut; infinite when it is empty.
    fn cost(&self) -> f32 {
        if self.count > 0.0 { self.count * area(self.bounds) } else { f32::INFINITY }
    }
}

/// Where the middles of items lie along an axis.
#[derive(Clone, Copy)]
struct Binning {
    axis: usize,
    low: f32,
    per_metre: f32,
}

impl Binning {
    fn bin(&self, item: &Item) -> usize {
        let middle = (item.low[self.axis] + item.high[self.axis]) * 0.5;
        count(f64::from((middle - self.low) * self.per_metre)).min(NUM_BINS - 1)
    }

    /// The cost of the cheapest cut and the first bin on its right side.
    fn cheapest_cut(&self, items: &[Item]) -> (f32, usize) {
        let mut bins = [Bin::EMPTY; NUM_BINS];
        for item in items {
            let bin = &mut bins[self.bin(item)];
            *bin = bin.with(Bin { bounds: (item.low, item.high), count: 1.0 });
        }
        let mut right = [Bin::EMPTY; NUM_BINS];
        for k in (0..NUM_BINS - 1).rev() {
            right[k] = right[k + 1].with(bins[k + 1]);
        }
        let (mut left, mut best) = (Bin::EMPTY, (f32::INFINITY, 0));
        for k in 0..NUM_BINS - 1 {
            left = left.with(bins[k]);
            let cost = left.cost() + right[k].cost();
            if cost < best.0 {
                best = (cost, k + 1);
            }
        }
        best
    }
}

/// Number of items of the left side after reordering by the cheapest binned cut of the surface area heuristic.
fn partition(items: &mut [Item]) -> usize {
    let (low, high) = items.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), item| {
        let middle = (item.low + item.high) * 0.5;
        (low.min(middle), high.max(middle))
    });
    let binnings = (0..3).filter(|&axis| high[axis] > low[axis]).map(|axis| Binning {
        axis,
        low: low[axis],
        per_metre: NUM_BINS as f32 / (high[axis] - low[axis]),
    });
    let cuts = binnings.map(|binning| (binning, binning.cheapest_cut(items)));
    let Some((binning, (cost, cut))) = cuts.min_by(|a, b| a.1.0.total_cmp(&b.1.0)) else { return halve(items) };
    if cost.is_infinite() {
        return halve(items);
    }
    let mut num_left = 0;
    for k in 0..items.len() {
        if binning.bin(&items[k]) < cut {
            items.swap(num_left, k);
            num_left += 1;
        }
    }
    num_left
}

/// Half of the items after ordering them along the longest side of their bounds.
fn halve(items: &mut [Item]) -> usize {
    let (low, high) = bounds(items);
    let axis = (high - low).max_position();
    items.sort_by(|a, b| (a.low[axis] + a.high[axis]).total_cmp(&(b.low[axis] + b.high[axis])));
    items.len() / 2
}
