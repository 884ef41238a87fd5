//! Sets that differ in a few Gaussians: what they share is projected and sorted once.

use super::project::Footprint;
use super::tiles::{bin, visible_by_depth};
use super::{RenderedWithState, forward};
use crate::gaussians::physical::Splat;
use crate::views::PinholeView;

/// The Gaussians that can reach a pixel of one view, projected and in depth order.
#[derive(Clone, Debug)]
pub struct Projection {
    footprints: Vec<Footprint>,
}

impl Projection {
    /// The projection of a set.
    pub fn new(splats: &[Splat], view: &PinholeView) -> Self {
        Self { footprints: visible_by_depth(splats, 0, view) }
    }

    /// Without the Gaussians that `removed` marks by their index; the others keep their indices.
    pub fn without(&self, removed: &[bool]) -> Self {
        let stays = |f: &&Footprint| !removed.get(f.index as usize).is_some_and(|&removed| removed);
        Self { footprints: self.footprints.iter().filter(stays).copied().collect() }
    }

    /// With further Gaussians, whose indices start at `first`, beyond all others.
    pub fn with(&self, splats: &[Splat], first: usize, view: &PinholeView) -> Self {
        let added = visible_by_depth(splats, first, view);
        let mut footprints = Vec::with_capacity(self.footprints.len() + added.len());
        let mut rest = self.footprints.as_slice();
        for new in &added {
            let (before, after) = rest.split_at(rest.partition_point(|old| old.is_before(new)));
            footprints.extend_from_slice(before);
            footprints.push(*new);
            rest = after;
        }
        footprints.extend_from_slice(rest);
        Self { footprints }
    }

    /// The images over a background colour, with the state that [`backward`](super::backward) needs.
    pub fn render(self, view: &PinholeView, background: [f32; 3]) -> RenderedWithState {
        let lists = bin(self.footprints, view);
        let tiles = forward::composite(&lists);
        let images = forward::assemble(&tiles, lists.grid, [view.width, view.height], background);
        RenderedWithState { images, lists, tiles, background }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::render;

    fn view() -> PinholeView {
        PinholeView {
            width: 70,
            height: 40,
            fx: 60.0,
            fy: 60.0,
            cx: 35.0,
            cy: 20.0,
            camera_from_clip: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
            time: 0.1,
        }
    }

    fn splats() -> Vec<Splat> {
        let at = |i: usize, salt: f32| (i as f32 * 12.9898 + salt).sin() * 43_758.547 % 1.0;
        let splat = |i: usize| Splat {
            mean: [3.0 * at(i, 0.1), 2.0 * at(i, 0.7), 4.0 + 2.0 * at(i, 1.3)],
            quat: [1.0, at(i, 2.0), at(i, 3.0), 0.2],
            scale: [0.1, 0.2, 0.05],
            opacity: 0.2 + 0.7 * at(i, 5.0).abs(),
            colour: [at(i, 6.0).abs(), 0.5, at(i, 7.0).abs()],
            velocity: [0.1, 0.0, 0.0],
            time: 0.0,
        };
        (0..300).map(splat).collect()
    }

    #[test]
    fn branches_are_the_pictures_of_their_sets_to_the_bit() {
        let (all, view) = (splats(), view());
        let (base, rest) = all.split_at(250);
        let projection = Projection::new(base, &view);
        assert_eq!(projection.clone().render(&view, [0.1; 3]).images, render(base, &view, [0.1; 3]));
        let added = projection.with(rest, base.len(), &view).render(&view, [0.1; 3]).images;
        assert_eq!(added, render(&all, &view, [0.1; 3]));
        let removed: Vec<bool> = (0..base.len()).map(|i| i % 3 == 0).collect();
        let kept: Vec<Splat> = base.iter().zip(&removed).filter(|(_, r)| !**r).map(|(s, _)| *s).collect();
        let without = projection.without(&removed).render(&view, [0.1; 3]).images;
        assert_eq!(without, render(&kept, &view, [0.1; 3]));
        assert_ne!(without, added);
    }
}
