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

/// Pending nodes of a traversal: at most one a level. Below level `STACK / 4` every cut halves, so no tree gets there.
const STACK: usize = 64;

/// Primitives in an order in which neighbours stand together, and the tree over them.
#[derive(Clone, Debug, Default)]
pub(crate) struct Bvh {
    nodes: Vec<Node>,
    primitives: Vec<Primitive>,
}

/// Bounds with either a range of primitives (`count > 0`) or two children (`first`, `first + 1`).
#[derive(Clone, Copy, Debug)]
struct Node {
    low: Vec3,
    high: Vec3,
    first: usize,
    count: usize,
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
        let mut nodes = vec![Node { low: Vec3::ZERO, high: Vec3::ZERO, first: 0, count: items.len() }];
        let mut pending = vec![(0_usize, 0_usize)];
        while let Some((index, depth)) = pending.pop() {
            let Node { first, count, .. } = nodes[index];
            let range = &mut items[first..first + count];
            (nodes[index].low, nodes[index].high) = bounds(range);
            if count <= LEAF_SIZE {
                continue;
            }
            let cut = if depth < STACK / 4 { partition(range) } else { halve(range) };
            let left = nodes.len();
            nodes.push(Node { first, count: cut, ..nodes[index] });
            nodes.push(Node { first: first + cut, count: count - cut, ..nodes[index] });
            nodes[index] = Node { first: left, count: 0, ..nodes[index] };
            pending.push((left, depth + 1));
            pending.push((left + 1, depth + 1));
        }
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

    /// Whether `act` returned true for a primitive whose node the ray crosses nearer than `limit`; nearer children
    /// come first.
    fn visit(&self, ray: &Ray, t_min: f32, limit: &mut f32, mut act: impl FnMut(usize, &mut f32) -> bool) -> bool {
        if self.nodes.is_empty() {
            return false;
        }
        let inverse = ray.inverse_direction();
        let enter = |node: &Node, limit: f32| -> f32 {
            let (a, b) = ((node.low - ray.origin) * inverse, (node.high - ray.origin) * inverse);
            let (near, far) = (a.min(b).max_element().max(t_min), a.max(b).min_element().min(limit));
            if near <= far { near } else { f32::INFINITY }
        };
        let mut stack = [(0_usize, 0.0_f32); STACK];
        stack[0] = (0, enter(&self.nodes[0], *limit));
        let mut len = 1;
        while len > 0 {
            len -= 1;
            let (index, near) = stack[len];
            if near >= *limit {
                continue;
            }
            let node = &self.nodes[index];
            if node.count > 0 {
                for k in node.first..node.first + node.count {
                    if act(k, limit) {
                        return true;
                    }
                }
                continue;
            }
            let left = (node.first, enter(&self.nodes[node.first], *limit));
            let right = (node.first + 1, enter(&self.nodes[node.first + 1], *limit));
            let [far, near] = if left.1 <= right.1 { [right, left] } else { [left, right] };
            for child in [far, near] {
                if child.1 < *limit {
                    stack[len] = child;
                    len += 1;
                }
            }
        }
        false
    }
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
