//! Sets that differ in a few Gaussians: what they share is projected and sorted once.

use std::ops::Range;

use super::constants::TRANSMITTANCE_MIN;
use super::project::Footprint;
use super::tiles::{bin, tiles_of_each, visible_by_depth};
use super::{RenderedWithState, forward};
use crate::gaussians::physical::Splat;
use crate::views::PinholeView;

/// The Gaussians that can reach a pixel of one view, projected and in depth order, with the tiles that each touches.
#[derive(Clone, Debug)]
pub struct Projection {
    footprints: Vec<Footprint>,
    /// `[num_visible + 1]`: footprint `v` touches `tiles[first_of_splat[v]..first_of_splat[v + 1]]`.
    first_of_splat: Vec<u32>,
    tiles: Vec<u32>,
}

impl Projection {
    /// The projection of a set.
    pub fn new(splats: &[Splat], view: &PinholeView) -> Self {
        Self::of(splats, 0, view)
    }

    fn of(splats: &[Splat], first: usize, view: &PinholeView) -> Self {
        let footprints = visible_by_depth(splats, first, view);
        let (first_of_splat, tiles) = tiles_of_each(&footprints, view);
        Self { footprints, first_of_splat, tiles }
    }

    fn with_capacity(footprints: usize, tiles: usize) -> Self {
        let mut first_of_splat = Vec::with_capacity(footprints + 1);
        first_of_splat.push(0);
        Self { footprints: Vec::with_capacity(footprints), first_of_splat, tiles: Vec::with_capacity(tiles) }
    }

    /// Appends a run of another projection's footprints.
    fn push(&mut self, from: &Self, run: Range<usize>) {
        let places_of_splats = &from.first_of_splat[run.start..=run.end];
        let (start, end) = (places_of_splats[0], places_of_splats[run.len()]);
        let before = self.first_of_splat.last().copied().unwrap_or(0);
        self.footprints.extend_from_slice(&from.footprints[run]);
        self.first_of_splat.extend(places_of_splats[1..].iter().map(|place_of_splat| place_of_splat - start + before));
        self.tiles.extend_from_slice(&from.tiles[start as usize..end as usize]);
    }

    /// Without the Gaussians that `removed` marks by their index; the others keep their indices.
    pub fn without(&self, removed: &[bool]) -> Self {
        let goes = |v: usize| removed.get(self.footprints[v].index as usize).is_some_and(|&removed| removed);
        let mut rest = Self::with_capacity(self.footprints.len(), self.tiles.len());
        let mut start = 0;
        for v in (0..self.footprints.len()).filter(|&v| goes(v)) {
            rest.push(self, start..v);
            start = v + 1;
        }
        rest.push(self, start..self.footprints.len());
        rest
    }

    /// With further Gaussians, whose indices start at `first`, beyond all others.
    pub fn with(&self, splats: &[Splat], first: usize, view: &PinholeView) -> Self {
        let added = Self::of(splats, first, view);
        let counts = [self, &added].map(|p| [p.footprints.len(), p.tiles.len()]);
        let mut all = Self::with_capacity(counts[0][0] + counts[1][0], counts[0][1] + counts[1][1]);
        let mut start = 0;
        for (place, new) in added.footprints.iter().enumerate() {
            let before = self.footprints[start..].iter().take_while(|old| old.is_before(new)).count();
            all.push(self, start..start + before);
            all.push(&added, place..place + 1);
            start += before;
        }
        all.push(self, start..self.footprints.len());
        all
    }

    /// The images over a background colour, with the state that [`backward`](super::backward) needs.
    pub fn render(self, view: &PinholeView, background: [f32; 3]) -> RenderedWithState {
        self.composite(view, background, TRANSMITTANCE_MIN)
    }

    /// As [`Projection::render`], but that compositing goes on behind what is opaque: until a transmittance of `least`, at which it does not matter what
    /// Gaussian is taken away in front, such as [`UNSEEN`](super::constants::UNSEEN).
    pub fn render_through(self, view: &PinholeView, background: [f32; 3], least: f32) -> RenderedWithState {
        self.composite(view, background, least)
    }

    fn composite(self, view: &PinholeView, background: [f32; 3], opaque: f32) -> RenderedWithState {
        let lists = bin(self.footprints, self.first_of_splat, self.tiles, view);
        let tiles = forward::composite(&lists, opaque);
        let images = forward::assemble(&tiles, lists.grid, [view.width, view.height], background);
        RenderedWithState { images, lists, tiles, background }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::render;
    use crate::views::samples::ahead;

    fn view() -> PinholeView {
        PinholeView { time: 0.1, ..ahead(70, 40, 60.0) }
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
        let (all_gone, nothing) = (vec![true; base.len()], Vec::<Splat>::new());
        assert_eq!(projection.without(&all_gone).render(&view, [0.1; 3]).images, render(&nothing, &view, [0.1; 3]));
        let back = projection.without(&all_gone).with(base, 0, &view).render(&view, [0.1; 3]).images;
        assert_eq!(back, render(base, &view, [0.1; 3]));
    }
}
