//! How far apart the points of a cloud are.

use rayon::prelude::*;

use crate::ops::knn::{nearest, squared_distance};

/// How many neighbours the spacing is the mean over.
const NUM_NEIGHBOURS: usize = 3;

/// The mean distance (metres) of every point to its three nearest neighbours; to as many as there are when fewer exist,
/// 0 for a lone point. Coincident points are neighbours at distance 0. Where a coordinate is not finite, there are no distances: zeros.
///
/// The result depends on distances only, so ties and the order of the search cannot change it.
pub fn spacing(positions: &[[f32; 3]]) -> Vec<f32> {
    let Ok(neighbours) = nearest(positions, NUM_NEIGHBOURS) else {
        return vec![0.0; positions.len()];
    };
    let of = |i: usize| {
        let others = neighbours.of(i);
        let distance = |&j: &u32| squared_distance(&positions[i], &positions[j as usize]).sqrt();
        single(others.iter().map(distance).sum::<f64>() / others.len().max(1) as f64)
    };
    (0..positions.len()).into_par_iter().with_min_len(4096).map(of).collect()
}

#[expect(clippy::cast_possible_truncation, reason = "sizes are stored in f32")]
fn single(value: f64) -> f32 {
    value as f32
}
