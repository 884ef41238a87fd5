//! How far apart the points of a cloud are.

use std::num::NonZeroUsize;

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

/// How many neighbours the spacing is the mean over.
const NUM_NEIGHBOURS: usize = 3;
/// Points that are queried in one go, so that they share the tree's cached nodes.
const RUN: usize = 1024;

/// The mean distance (metres) of every point to its three nearest neighbours; to as many as there are when fewer exist,
/// 0 for a lone point. Coincident points are neighbours at distance 0.
///
/// The result depends on distances only, so ties and the order of the search cannot change it.
pub fn spacing(positions: &[[f32; 3]]) -> Vec<f32> {
    let Ok(tree) = ImmutableKdTree::<f32, 3>::new_from_slice(positions) else {
        return vec![0.0; positions.len()];
    };
    let order = spatial_order(positions);
    let of_run = |run: &[u32]| run.iter().map(|&i| mean_distance(&tree, &positions[i as usize])).collect::<Vec<f32>>();
    let means: Vec<Vec<f32>> = order.par_chunks(RUN).map(of_run).collect();
    let mut result = vec![0.0; positions.len()];
    for (&i, mean) in order.iter().zip(means.into_iter().flatten()) {
        result[i as usize] = mean;
    }
    result
}

fn mean_distance(tree: &ImmutableKdTree<f32, 3>, point: &[f32; 3]) -> f32 {
    const WITH_ITSELF: NonZeroUsize = NonZeroUsize::MIN.saturating_add(NUM_NEIGHBOURS);
    let nearest = tree.query(point).nearest_n::<SquaredEuclidean<f32>>(WITH_ITSELF).execute();
    let others = nearest.get(1..).unwrap_or_default();
    let total: f32 = others.iter().map(|neighbour| neighbour.distance.sqrt()).sum();
    total / others.len().max(1) as f32
}

/// Indices of the points along a Morton curve through their bounding box.
fn spatial_order(positions: &[[f32; 3]]) -> Vec<u32> {
    let (low, high) = bounding_box(positions);
    let scale: [f32; 3] = std::array::from_fn(|k| CELLS / (high[k] - low[k]).max(f32::MIN_POSITIVE));
    let code = |p: &[f32; 3]| (0..3).fold(0, |code, k| code | spread(cell((p[k] - low[k]) * scale[k])) << k);
    let mut keyed: Vec<(u32, u32)> = positions.iter().map(code).zip(0..).collect();
    keyed.sort_unstable();
    keyed.into_iter().map(|(_, i)| i).collect()
}

/// Cells per axis of the Morton grid: ten bits, so that three axes fit into a u32.
const CELLS: f32 = 1023.0;

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the cast saturates, NaN gives 0, and the order needs not be exact"
)]
const fn cell(scaled: f32) -> u32 {
    scaled.clamp(0.0, CELLS) as u32
}

/// The ten low bits of `v`, three places apart.
const fn spread(v: u32) -> u32 {
    let v = (v | v << 16) & 0x0300_00FF;
    let v = (v | v << 8) & 0x0300_F00F;
    let v = (v | v << 4) & 0x030C_30C3;
    (v | v << 2) & 0x0924_9249
}

fn bounding_box(positions: &[[f32; 3]]) -> ([f32; 3], [f32; 3]) {
    let start = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    positions.iter().fold(start, |(low, high), p| {
        (std::array::from_fn(|k| low[k].min(p[k])), std::array::from_fn(|k| high[k].max(p[k])))
    })
}
