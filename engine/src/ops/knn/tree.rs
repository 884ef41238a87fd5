//! A balanced k-d tree whose leaves hold [`LEAF`] points as columns.

use super::NO_NEIGHBOUR;
use crate::parallel;

/// Points of a leaf: a multiple of every vector length.
pub(super) const LEAF: usize = 16;
/// Subtrees with fewer points than this are built by one thread.
const PARALLEL_POINTS: usize = 1 << 14;

/// A node; its left child is the next one.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Node {
    /// Corners of the box around its points.
    pub(super) low: [f32; 3],
    pub(super) high: [f32; 3],
    /// Smallest index among its points.
    pub(super) first_index: u32,
    /// Smallest and largest group among its points.
    pub(super) groups: [u32; 2],
    /// The right child; 0 for a leaf.
    pub(super) right: u32,
    /// The leaf, or the first leaf below.
    pub(super) leaf: u32,
}

/// Points in the order of the leaves; the last leaf is filled up with points at infinity.
#[derive(Debug)]
pub(super) struct Tree {
    pub(super) nodes: Vec<Node>,
    /// `[num_leaves]`.
    pub(super) leaves: Vec<Leaf>,
    /// `[N]` place of every point: leaf * [`LEAF`] + slot.
    pub(super) place_of: Vec<u32>,
}

/// The points of one leaf.
#[derive(Clone, Copy, Debug)]
pub(super) struct Leaf {
    /// x, y, z of every slot.
    pub(super) columns: [[f32; LEAF]; 3],
    pub(super) groups: [u32; LEAF],
    /// Ascending; [`NO_NEIGHBOUR`] marks a slot without a point.
    pub(super) indices: [u32; LEAF],
}

/// One point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Item {
    point: [f32; 3],
    group: u32,
    index: u32,
}

impl Tree {
    /// The tree of finite points; empty for none.
    pub(super) fn new(points: &[[f32; 3]], groups: &[u32]) -> Self {
        let mut items: Vec<Item> = (0_u32..)
            .zip(points.iter().zip(groups))
            // Negative zero would sort before zero.
            .map(|(index, (point, &group))| Item { point: point.map(|c| c + 0.0), group, index })
            .collect();
        let num_leaves = points.len().div_ceil(LEAF);
        let mut nodes = vec![Node::default(); (2 * num_leaves).saturating_sub(1)];
        if !items.is_empty() {
            build(&mut items, &mut nodes, 0, 0);
        }
        let leaf = |i: usize| Leaf::of(&items[i * LEAF..items.len().min((i + 1) * LEAF)]);
        let leaves = parallel::map(items.len().div_ceil(LEAF), 1, &leaf);
        let mut place_of = vec![0; points.len()];
        (0_u32..).zip(&items).for_each(|(place, item)| place_of[item.index as usize] = place);
        Self { nodes, leaves, place_of }
    }
}

impl Leaf {
    /// Up to [`LEAF`] points.
    pub(super) fn of(items: &[Item]) -> Self {
        let mut leaf =
            Self { columns: [[f32::INFINITY; LEAF]; 3], groups: [NO_NEIGHBOUR; LEAF], indices: [NO_NEIGHBOUR; LEAF] };
        for (slot, item) in items.iter().enumerate() {
            for axis in 0..3 {
                leaf.columns[axis][slot] = item.point[axis];
            }
            leaf.groups[slot] = item.group;
            leaf.indices[slot] = item.index;
        }
        leaf
    }

    /// The point of a slot.
    pub(super) fn item(&self, slot: usize) -> Item {
        Item { point: self.columns.map(|column| column[slot]), group: self.groups[slot], index: self.indices[slot] }
    }
}

/// Orders `items` by leaf and writes the nodes of their subtree, whose first node is `node` and first leaf `leaf`.
fn build(items: &mut [Item], nodes: &mut [Node], node: u32, leaf: u32) {
    let mut here = Node {
        low: [f32::INFINITY; 3],
        high: [f32::NEG_INFINITY; 3],
        first_index: NO_NEIGHBOUR,
        groups: [u32::MAX, 0],
        right: 0,
        leaf,
    };
    for item in items.iter() {
        for axis in 0..3 {
            here.low[axis] = here.low[axis].min(item.point[axis]);
            here.high[axis] = here.high[axis].max(item.point[axis]);
        }
        here.first_index = here.first_index.min(item.index);
        here.groups = [here.groups[0].min(item.group), here.groups[1].max(item.group)];
    }
    if items.len() <= LEAF {
        items.sort_unstable_by_key(|item| item.index);
        nodes[0] = here;
        return;
    }
    // Left leaves are full: half of the leaves, rounded up.
    let left_leaves = items.len().div_ceil(LEAF).div_ceil(2);
    let axis = widest_axis(&here);
    // Points that agree on the axis go by index, so that coincident points lie in the order of their indices.
    items.select_nth_unstable_by(left_leaves * LEAF, |a, b| {
        a.point[axis].total_cmp(&b.point[axis]).then(a.index.cmp(&b.index))
    });
    let (left, right) = items.split_at_mut(left_leaves * LEAF);
    let left_nodes = 2 * left_leaves - 1;
    here.right = node + 1 + index32(left_nodes);
    nodes[0] = here;
    let (left_of, right_of) = nodes[1..].split_at_mut(left_nodes);
    let right_leaf = leaf + index32(left_leaves);
    if left.len() < PARALLEL_POINTS {
        build(left, left_of, node + 1, leaf);
        build(right, right_of, here.right, right_leaf);
    } else {
        rayon::join(|| build(left, left_of, node + 1, leaf), || build(right, right_of, here.right, right_leaf));
    }
}

fn widest_axis(node: &Node) -> usize {
    let width = [0, 1, 2].map(|axis| f64::from(node.high[axis]) - f64::from(node.low[axis]));
    let yz = if width[2] > width[1] { 2 } else { 1 };
    if width[0] >= width[yz] { 0 } else { yz }
}

#[expect(clippy::cast_possible_truncation, reason = "there are fewer than 2^32 points, hence nodes and leaves")]
fn index32(value: usize) -> u32 {
    value as u32
}
