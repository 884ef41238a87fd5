//! The lists of all tiles, from the tiles of all Gaussians.

use std::sync::atomic::{AtomicU32, Ordering};

use lgs_formats::casts::to_u32;
use rayon::prelude::*;

use crate::parallel;

/// Elements that a thread takes at once.
pub(super) const CHUNK: usize = 4096;
/// Runs of Gaussians that each thread sorts.
const RUNS: usize = 2;

/// First intersection of each tile and the end, the place of each Gaussian's intersections in the order of its tiles, and the Gaussian at each place.
///
/// # Shapes
/// `first_of_splat` `[N + 1]`, `tiles` one for each intersection; results `[num_tiles + 1]`, and twice one for each intersection.
///
/// # Formula
/// A stable counting sort by tile, a run of Gaussians after the other, all runs at once.
pub(super) fn by_tile(first_of_splat: &[u32], tiles: Vec<u32>, num_tiles: usize) -> (Vec<u32>, Vec<u32>, Vec<u32>) {
    let mut places_of_splats = tiles;
    let mut runs = Run::all(first_of_splat, &mut places_of_splats);
    let mut counts: Vec<Vec<u32>> = parallel::map(runs.len(), 1, &|run| {
        let mut counts = vec![0_u32; num_tiles];
        runs[run].tiles.iter().for_each(|&tile| counts[tile as usize] += 1);
        counts
    });
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
    parallel::for_each_pair(&mut runs, &mut counts, 1, &|_, run, next| run.place(next, &intersections));
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

#[cfg(test)]
mod tests {
    use super::{CHUNK, by_tile};

    /// More Gaussians than a thread takes, some without tiles: any number of threads sorts them as one loop does.
    #[test]
    fn runs_sort_as_one_does() {
        let num_tiles = 37;
        let mixed = |i: usize| (i.wrapping_mul(0x9e37_79b9) >> 11) % 1009;
        let (mut first_of_splat, mut tiles) = (vec![0], Vec::new());
        for splat in 0..5 * CHUNK + 3 {
            tiles.extend((0..mixed(splat) % 4).map(|k| u32::try_from(mixed(splat + 7 * k) % num_tiles).unwrap()));
            first_of_splat.push(u32::try_from(tiles.len()).unwrap());
        }
        let owner = |place: usize| first_of_splat.partition_point(|&first| first as usize <= place) - 1;
        let mut order: Vec<usize> = (0..tiles.len()).collect();
        order.sort_by_key(|&place| tiles[place]);
        let want: Vec<usize> = order.iter().map(|&place| owner(place)).collect();
        for threads in [1, 2, 5] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let (firsts, places, found) = pool.install(|| by_tile(&first_of_splat, tiles.clone(), num_tiles));
            assert!(found.iter().map(|&splat| splat as usize).eq(want.iter().copied()), "{threads} threads");
            assert!(order.iter().zip(0..).all(|(&from, to)| places[from] == to), "{threads} threads");
            for (tile, pair) in (0..).zip(firsts.windows(2)) {
                assert!((pair[0]..pair[1]).all(|place| tiles[order[place as usize]] == tile));
            }
            assert_eq!(firsts.last().copied(), u32::try_from(tiles.len()).ok());
        }
    }
}
