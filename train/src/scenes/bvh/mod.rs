//! A bounding volume hierarchy over primitives: first hit and occlusion of a ray.

mod build;

use super::{
    primitive::Primitive,
    shapes::{LocalHit, Ray},
};

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

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec3};
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
