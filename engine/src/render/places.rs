//! From the visible Gaussians of a view, which are in depth order, back to the Gaussians of their set.

use std::sync::atomic::{AtomicU32, Ordering};

use lgs_formats::casts::to_u32;
use rayon::prelude::*;

use super::RenderedWithState;
use crate::parallel;

/// Gaussians that a thread takes at once.
const GRAIN: usize = 4096;
/// The place of a Gaussian that is not visible.
const NONE: u32 = u32::MAX;

/// Where each Gaussian of a set is among the visible ones of a view.
#[derive(Debug)]
pub struct Places(Vec<AtomicU32>);

impl RenderedWithState {
    /// The places of the first `count` Gaussians of the set that was rendered.
    pub fn places(&self, count: usize) -> Places {
        let none = || AtomicU32::new(NONE);
        let places: Vec<AtomicU32> = (0..count).into_par_iter().with_min_len(GRAIN).map(|_| none()).collect();
        let visible = self.lists.footprints.par_iter().with_min_len(GRAIN).enumerate();
        // Every Gaussian is at one place only.
        visible.for_each(|(place, footprint)| {
            if let Some(at) = places.get(footprint.index as usize) {
                at.store(to_u32(place), Ordering::Relaxed);
            }
        });
        Places(places)
    }
}

impl Places {
    /// Gives `take` what there is of each visible Gaussian, in parallel, with its place.
    ///
    /// # Shapes
    /// `all` at most as many as there are places.
    pub fn each<T: Send>(&self, all: &mut [T], take: impl Fn(&mut T, usize) + Sync) {
        parallel::for_chunks(all, GRAIN, &|number, part| {
            for (of_gaussian, place) in part.iter_mut().zip(&self.0[number * GRAIN..]) {
                match place.load(Ordering::Relaxed) {
                    NONE => {}
                    place => take(of_gaussian, place as usize),
                }
            }
        });
    }
}
