//! The search among other timestamps beside `kiddo`'s, one tree for the points of all other times; and the search in space.

use divan::Bencher;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use lgs_engine::ops::knn::nearest_other_time;
use lgs_engine::points::spacing;
use rayon::prelude::*;

use crate::load::SEED;
use crate::street::Street;

/// Points of all timestamps.
pub(crate) const NUM_POINTS: usize = 500_000;
/// A third of them.
const NUM_POINTS_PER_TIME: u32 = 166_667;
/// Neighbours that the full size asks.
const NEIGHBOURS: usize = 8;

/// Points of a street and which of three timestamps each has.
pub(crate) fn timed_points() -> (Vec<[f32; 3]>, Vec<u32>) {
    let points = Street::new(SEED).points(NUM_POINTS);
    let times = (0_u32..).map(|i| i / NUM_POINTS_PER_TIME).take(points.len()).collect();
    (points, times)
}

#[divan::bench(sample_count = 10, sample_size = 1)]
fn other_times(bencher: Bencher) {
    let (points, times) = timed_points();
    bencher.bench_local(|| nearest_other_time(&points, &times, NEIGHBOURS));
}

#[divan::bench(sample_count = 10, sample_size = 1)]
fn other_times_by_kiddo(bencher: Bencher) {
    let (points, times) = timed_points();
    let neighbours = NEIGHBOURS.try_into().unwrap();
    bencher.bench_local(|| {
        let of_time = |time: u32| {
            let part = |own: bool| -> Vec<[f32; 3]> {
                let rows = points.iter().zip(&times);
                rows.filter(|(_, t)| (**t == time) == own).map(|(point, _)| *point).collect()
            };
            let tree = ImmutableKdTree::<f32, 3>::new_from_slice(&part(false)).unwrap();
            let nearest = |point: &[f32; 3]| -> Vec<u32> {
                let found = tree.query(point).nearest_n::<SquaredEuclidean<f32>>(neighbours).execute();
                found.iter().map(|found| found.item).collect()
            };
            part(true).par_iter().flat_map_iter(nearest).collect::<Vec<u32>>()
        };
        [0, 1, 2].map(of_time)
    });
}

/// Three nearest of every point, as the spacing of returns asks for them.
#[divan::bench(sample_count = 10, sample_size = 1)]
fn spacing_of_street_points(bencher: Bencher) {
    let (points, _) = timed_points();
    let all: Vec<u32> = (0..).take(points.len()).collect();
    bencher.bench_local(|| spacing(&points, &all));
}
