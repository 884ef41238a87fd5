//! A bounding volume hierarchy over primitives: first hit and occlusion of a ray.

use glam::Vec3;

use super::{
    primitive::Primitive,
    shapes::{LocalHit, Ray},
};

/// Primitives up to which a node is not split.
const LEAF_SIZE: usize = 3;

/// Candidate cuts per axis.
const NUM_BINS: usize = 12;

/// Levels of the binary tree that may be cut unevenly; below them every cut halves.
const MAX_UNEVEN: usize = 16;

/// Pending nodes of a traversal: at most `WIDTH - 1` a level of the wide tree. Uneven levels and 32 halvings give at most
/// 48 binary levels; a wide node takes at least one.
const STACK: usize = 160;

/// Children of a node.
const WIDTH: usize = 4;

/// Primitives in an order in which neighbours stand together, and the tree over them.
#[derive(Clone, Debug, Default)]
pub(crate) struct Bvh {
    nodes: Vec<Node>,
    primitives: Vec<Primitive>,
}

/// The bounds of up to [`WIDTH`] children, tested together. A lane without a child has bounds that no ray enters.
#[derive(Clone, Copy, Debug)]
struct Node {
    /// `[low, high][axis][child]`.
    bounds: [[[f32; WIDTH]; 3]; 2],
    children: [Child; WIDTH],
}

/// A range of primitives (`count > 0`) or a node.
#[derive(Clone, Copy, Debug, Default)]
struct Child {
    first: usize,
    count: usize,
}

/// A node of the binary tree that the builder makes first: a range of items, cut in two unless it is a leaf.
struct Cut {
    low: Vec3,
    high: Vec3,
    first: usize,
    count: usize,
    /// The left part; the right one follows it.
    left: Option<usize>,
}

/// The first primitive that a ray meets.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BvhHit {
    /// Index into [`Bvh::primitives`].
    pub(crate) index: usize,
    pub(crate) local: LocalHit,
}

struct Item {
    low: Vec3,
    high: Vec3,
    primitive: Primitive,
}

impl Bvh {
    /// The tree over `primitives`.
    pub(crate) fn new(primitives: Vec<Primitive>) -> Self {
        if primitives.is_empty() {
            return Self::default();
        }
        let mut items: Vec<Item> = primitives
            .into_iter()
            .map(|primitive| {
                let (low, high) = primitive.bounds();
                Item { low, high, primitive }
            })
            .collect();
        let cuts = cut(&mut items);
        let mut nodes = Vec::new();
        widen(&cuts, 0, &mut nodes);
        Self { nodes, primitives: items.into_iter().map(|item| item.primitive).collect() }
    }

    /// The primitives, in the tree's order.
    pub(crate) fn primitives(&self) -> &[Primitive] {
        &self.primitives
    }

    /// The nearest primitive that `ray` meets between `t_min` and `t_max`.
    pub(crate) fn first_hit(&self, ray: &Ray, t_min: f32, t_max: f32) -> Option<BvhHit> {
        let mut best: Option<BvhHit> = None;
        let mut limit = t_max;
        self.visit(ray, t_min, &mut limit, |index, limit| {
            if let Some(local) = self.primitives[index].intersect(ray, t_min, *limit) {
                *limit = local.t;
                best = Some(BvhHit { index, local });
            }
            false
        });
        best
    }

    /// Whether anything stands between `t_min` and `t_max`.
    pub(crate) fn occluded(&self, ray: &Ray, t_min: f32, t_max: f32) -> bool {
        let mut limit = t_max;
        self.visit(ray, t_min, &mut limit, |index, limit| {
            self.primitives[index].intersect(ray, t_min, *limit).is_some()
        })
    }

    /// Whether `act` returned true for a primitive whose bounds the ray crosses nearer than `limit`; nearer children
    /// come first.
    fn visit(&self, ray: &Ray, t_min: f32, limit: &mut f32, mut act: impl FnMut(usize, &mut f32) -> bool) -> bool {
        if self.nodes.is_empty() {
            return false;
        }
        let inverse = ray.inverse_direction().to_array();
        let origin = ray.origin.to_array();
        let mut stack = [(Child::default(), 0.0_f32); STACK];
        let mut len = 1;
        while len > 0 {
            len -= 1;
            let (child, near) = stack[len];
            if near >= *limit {
                continue;
            }
            if child.count > 0 {
                for k in child.first..child.first + child.count {
                    if act(k, limit) {
                        return true;
                    }
                }
                continue;
            }
            let node = &self.nodes[child.first];
            let entries = node.entries(origin, inverse, t_min, *limit);
            let base = len;
            for (&child, &near) in node.children.iter().zip(&entries) {
                if near < *limit {
                    // Sorted from far to near, so that the nearest is taken next.
                    let mut slot = len;
                    while slot > base && stack[slot - 1].1 < near {
                        stack[slot] = stack[slot - 1];
                        slot -= 1;
                    }
                    stack[slot] = (child, near);
                    len += 1;
                }
            }
        }
        false
    }
}

impl Node {
    /// Where a ray enters each child; infinite where it does not between `t_min` and `limit`.
    #[inline]
    fn entries(&self, origin: [f32; 3], inverse: [f32; 3], t_min: f32, limit: f32) -> [f32; WIDTH] {
        let (mut near, mut far) = ([t_min; WIDTH], [limit; WIDTH]);
        for axis in 0..3 {
            let backward = usize::from(inverse[axis] < 0.0);
            let (low, high) = (&self.bounds[backward][axis], &self.bounds[1 - backward][axis]);
            for lane in 0..WIDTH {
                let enter = (low[lane] - origin[axis]) * inverse[axis];
                let leave = (high[lane] - origin[axis]) * inverse[axis];
                near[lane] = if enter > near[lane] { enter } else { near[lane] };
                far[lane] = if leave < far[lane] { leave } else { far[lane] };
            }
        }
        std::array::from_fn(|lane| if near[lane] <= far[lane] { near[lane] } else { f32::INFINITY })
    }
}

/// The binary tree over the items, which it reorders; the root comes first.
fn cut(items: &mut [Item]) -> Vec<Cut> {
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
fn widen(cuts: &[Cut], root: usize, nodes: &mut Vec<Node>) -> usize {
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

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use lgs_formats::pose::Pose;

    use super::*;
    use crate::scenes::{
        dice::Dice,
        primitive::{MaterialId, Part},
        shapes::Shape,
    };

    #[test]
    fn finds_what_a_search_over_all_finds() {
        let mut dice = Dice::new(4, 0);
        let mut spot = |r: f64| DVec3::new(dice.uniform(-r, r), dice.uniform(-r, r), dice.uniform(-r, r));
        let all: Vec<Primitive> = (0..600)
            .map(|k| {
                let shape = if k % 2 == 0 {
                    Shape::Ellipsoid { radii: Vec3::new(0.3, 0.2, 0.4) }
                } else {
                    Shape::cuboid(Vec3::new(0.5, 0.3, 0.4))
                };
                Part::new(shape, spot(6.0), MaterialId(0)).placed(&Pose::IDENTITY, None)
            })
            .collect();
        let tree = Bvh::new(all.clone());
        let mut hits = 0;
        for _ in 0..500 {
            let origin = super::super::maths::narrow3(spot(12.0));
            let ray = Ray { origin, direction: super::super::maths::narrow3(spot(3.0)) - origin };
            let want = all.iter().filter_map(|p| p.intersect(&ray, 0.0, 2.0)).map(|h| h.t).min_by(f32::total_cmp);
            let got = tree.first_hit(&ray, 0.0, 2.0).map(|h| h.local.t);
            assert_eq!(got, want);
            assert_eq!(tree.occluded(&ray, 0.0, 2.0), want.is_some());
            hits += usize::from(want.is_some());
        }
        assert!(hits > 100, "{hits} hits");
        assert!(Bvh::new(Vec::new()).first_hit(&Ray { origin: Vec3::ZERO, direction: Vec3::X }, 0.0, 1.0).is_none());
    }

    #[test]
    fn coincident_primitives_are_split_too() {
        let one = Part::new(Shape::cuboid(Vec3::ONE), DVec3::ZERO, MaterialId(0)).placed(&Pose::IDENTITY, None);
        let tree = Bvh::new(vec![one; 100]);
        assert_eq!(tree.primitives().len(), 100);
        assert!(tree.occluded(&Ray { origin: Vec3::X * 5.0, direction: -Vec3::X }, 0.0, 9.0));
    }
}
