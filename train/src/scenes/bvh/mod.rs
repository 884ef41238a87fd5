//! A bounding volume hierarchy over primitives: first hit and occlusion of a ray.

mod build;

use glam::Vec4;

use super::{
    primitive::Primitive,
    shapes::{LocalHit, Ray},
};

/// Pending children of a traversal: at most `WIDTH - 1` a level of the wide tree, which has no more levels than the binary
/// one: the uneven ones and 18 halvings, which take 2^18 primitives. The longest street has a third of that.
const STACK: usize = 96;

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
    /// `[low, high][axis]`, a lane per child.
    bounds: [[Vec4; 3]; 2],
    children: [Child; WIDTH],
}

/// A range of primitives (a count above 0) or a node, in few bytes, because each ray clears its stack.
#[derive(Clone, Copy, Debug, Default)]
struct Child(u32);

impl Child {
    /// Bits of the count.
    const COUNT_BITS: u32 = 2;

    /// `count` primitives from `first` on, or the node `first` when `count` is 0.
    fn new(first: usize, count: usize) -> Self {
        let packed = (first << Self::COUNT_BITS) | count;
        Self(u32::try_from(packed).unwrap_or(u32::MAX))
    }

    const fn first(self) -> usize {
        (self.0 >> Self::COUNT_BITS) as usize
    }

    const fn count(self) -> usize {
        (self.0 & ((1 << Self::COUNT_BITS) - 1)) as usize
    }
}

/// The first primitive that a ray meets.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BvhHit {
    /// Index into [`Bvh::primitives`].
    pub(crate) index: usize,
    pub(crate) local: LocalHit,
}

impl Bvh {
    /// The tree over `primitives`.
    pub(crate) fn new(primitives: Vec<Primitive>) -> Self {
        if primitives.is_empty() {
            return Self::default();
        }
        let mut items: Vec<build::Item> = primitives
            .into_iter()
            .map(|primitive| {
                let (low, high) = primitive.bounds();
                build::Item { low, high, primitive }
            })
            .collect();
        let cuts = build::cut(&mut items);
        let mut nodes = Vec::new();
        build::widen(&cuts, 0, &mut nodes);
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
            let (first, count) = (child.first(), child.count());
            if count > 0 {
                for k in first..first + count {
                    if act(k, limit) {
                        return true;
                    }
                }
                continue;
            }
            let node = &self.nodes[first];
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
        let (mut near, mut far) = (Vec4::splat(t_min), Vec4::splat(limit));
        for axis in 0..3 {
            let backward = usize::from(inverse[axis] < 0.0);
            let (start, slope) = (Vec4::splat(origin[axis]), Vec4::splat(inverse[axis]));
            near = near.max((self.bounds[backward][axis] - start) * slope);
            far = far.min((self.bounds[1 - backward][axis] - start) * slope);
        }
        Vec4::select(near.cmple(far), near, Vec4::INFINITY).to_array()
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec3};
    use lgs_formats::pose::Pose;

    use super::*;
    use crate::scenes::{
        primitive::{MaterialId, Part},
        rng::Rng,
        shapes::Shape,
    };

    #[test]
    fn finds_what_a_search_over_all_finds() {
        let mut rng = Rng::new(4, 0);
        let mut spot = |r: f64| DVec3::new(rng.uniform(-r, r), rng.uniform(-r, r), rng.uniform(-r, r));
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
            let origin = crate::scenes::maths::narrow3(spot(12.0));
            let ray = Ray { origin, direction: crate::scenes::maths::narrow3(spot(3.0)) - origin };
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
