//! The lists of all tiles, from the tiles of all Gaussians.

use std::sync::atomic::{AtomicU32, Ordering};

use lgs_formats::casts::to_u32;
use rayon::prelude::*;

/// Elements that a thread takes at once.
pub(super) const CHUNK: usize = 4096;
/// Runs of Gaussians that each thread sorts.
const RUNS: usize = 2;

/// Stable counting sort of the intersections by tile, a run of Gaussians after the other, all runs at once.
pub(super) fn by_tile(first_of_splat: &[u32], tiles: Vec<u32>, num_tiles: usize) -> (Vec<u32>, Vec<u32>, Vec<u32>) {
    let mut places_of_splats = tiles;
    let mut runs = Run::all(first_of_splat, &mut places_of_splats);
    let mut counts: Vec<Vec<u32>> = runs
        .par_iter()
        .map(|run| {
            let mut counts = vec![0_u32; num_tiles];
            run.tiles.iter().for_each(|&tile| counts[tile as usize] += 1);
            counts
        })
        .collect();
    let mut first_of_tile = vec![0_u32; num_tiles + 1];
    for counts in &counts {
        first_of_tile[1..].iter_mut().zip(counts).for_each(|(total, count)| *total += count);
    }
    for t in 0..num_tiles {
        first_of_tile[t + 1] += first_of_tile[t];
    }
    // Of each run, where its first intersection of each tile goes.
    let mut next = first_of_tile.clone();
    for counts in &mut counts {
        for (next, count) in next.iter_mut().zip(counts) {
            (*next, *count) = (*next + *count, *next);
        }
    }
    let num: usize = runs.iter().map(|run| run.tiles.len()).sum();
    let empty = (0..num).into_par_iter().with_min_len(CHUNK).map(|_| AtomicU32::new(0));
    let intersections: Vec<AtomicU32> = empty.collect();
    runs.par_iter_mut().zip(&mut counts).for_each(|(run, next)| run.place(next, &intersections));
    (first_of_tile, places_of_splats, intersections.into_iter().map(AtomicU32::into_inner).collect())
}

/// Gaussians that follow one another, and their tiles.
struct Run<'a> {
    first: usize,
    /// `[num + 1]` of them, offsets as those of all.
    first_of_splat: &'a [u32],
    /// The tiles, and then where in the list of all intersections each is.
    tiles: &'a mut [u32],
}

impl<'a> Run<'a> {
    /// Some for each thread: the order that they are sorted to is the same for any number.
    fn all(first_of_splat: &'a [u32], tiles: &'a mut [u32]) -> Vec<Self> {
        let num_splats = first_of_splat.len() - 1;
        let threads = rayon::current_num_threads();
        let num_runs = if threads == 1 { 1 } else { RUNS * threads };
        let len = num_splats.div_ceil(num_runs).max(CHUNK);
        let mut rest = tiles;
        let mut runs = Vec::new();
        for first in (0..num_splats).step_by(len) {
            let first_of_splat = &first_of_splat[first..=(first + len).min(num_splats)];
            let (start, end) = (first_of_splat[0], first_of_splat[first_of_splat.len() - 1]);
            let (tiles, others) = std::mem::take(&mut rest).split_at_mut((end - start) as usize);
            rest = others;
            runs.push(Self { first, first_of_splat, tiles });
        }
        runs
    }

    /// Writes its intersections to where `next` says for each tile.
    fn place(&mut self, next: &mut [u32], intersections: &[AtomicU32]) {
        let start = self.first_of_splat[0];
        for (visible, pair) in (self.first..).zip(self.first_of_splat.windows(2)) {
            for tile in &mut self.tiles[(pair[0] - start) as usize..(pair[1] - start) as usize] {
                let place = &mut next[*tile as usize];
                intersections[*place as usize].store(to_u32(visible), Ordering::Relaxed);
                *tile = *place;
                *place += 1;
            }
        }
    }
}
