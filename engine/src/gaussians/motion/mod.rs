//! How fast the things around move, from the sweeps alone.
//!
//! What stands above the ground is gathered in clusters, sweep by sweep; a cluster that other sweeps see through is moved at every
//! horizontal velocity until it lands on clusters of theirs. Standing still wins unless moving explains clearly more.

mod field;
mod grid;
mod ground;
mod rays;
mod score;
mod search;
mod sites;
mod sweeps;
#[cfg(test)]
mod tests;
mod tracks;

use rayon::prelude::*;

use serde::{Deserialize, Serialize};

use self::sweeps::Sweep;
use super::GaussianSet;
use crate::points::PointCloud;

/// Where the velocities of the initial Gaussians come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Motion {
    /// All are zero.
    None,
    /// From input sweeps that are registered to each other.
    ///
    /// Held-out PSNR over ten procedural scenes (128x256, odd frames held out) without a
    /// network, all at rest and registered: 23.36 and 24.27 dB, over moving pixels 18.67 and 20.79 dB.
    #[default]
    Registered,
}

/// Nothing: gives the Gaussians of the returns `chosen`, which are the first of `set`, the velocities that `motion` says.
///
/// # Shapes
/// `origins` `[S, 3]` where the sensor was at each of the cloud's sweeps, metres, clip frame.
pub fn set_velocities(set: &mut GaussianSet, chosen: &[u32], cloud: &PointCloud, origins: &[[f32; 3]], motion: Motion) {
    if motion == Motion::Registered {
        let velocities = velocities(cloud, origins);
        for (own, &point) in set.velocities.iter_mut().zip(chosen) {
            *own = velocities[point as usize];
        }
    }
}

/// Heights above the ground between which returns move with what they are over, metres.
const HEIGHTS: std::ops::Range<f32> = 0.12..4.3;
/// Distance from a site up to which low returns belong to it, metres.
const BESIDE: f32 = 0.3;

/// The velocity (metres a second, clip frame) of every return; zero where nothing says that it moves.
///
/// # Shapes
/// `origins` `[S, 3]` where the sensor was at each of the cloud's sweeps, metres, clip frame; result `[N, 3]`.
pub fn velocities(cloud: &PointCloud, origins: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let mut runs = Vec::with_capacity(origins.len());
    let mut start = 0;
    for run in cloud.frames.chunk_by(|a, b| a == b) {
        runs.push(start..start + run.len());
        start += run.len();
    }
    if runs.len() < 2 || runs.len() != origins.len() {
        return vec![[0.0; 3]; cloud.len()];
    }
    let sweeps = sweeps::prepare(cloud, &runs, origins);
    let clusters = tracks::velocities(&sweeps);
    let of = |((run, sweep), clusters): ((&std::ops::Range<usize>, &Sweep), &Vec<[f32; 2]>)| {
        spread(&cloud.positions[run.clone()], sweep, clusters)
    };
    runs.par_iter().zip(&sweeps).zip(&clusters).map(of).collect::<Vec<_>>().concat()
}

/// The velocities of the returns of a sweep from those of its clusters.
fn spread(points: &[[f32; 3]], sweep: &Sweep, clusters: &[[f32; 2]]) -> Vec<[f32; 3]> {
    if clusters.iter().all(|velocity| *velocity == [0.0; 2]) {
        return vec![[0.0; 3]; points.len()];
    }
    let of_site = |site: usize| sweep.sites.sites[site].cluster.map_or([0.0; 2], |cluster| clusters[cluster]);
    let moves = field::Field::of(&sweep.sites, BESIDE, |site| of_site(site) != [0.0; 2]);
    let of = |&[x, y, z]: &[f32; 3]| {
        let over = sweep.ground.above([x, y, z]).is_some_and(|h| HEIGHTS.contains(&h));
        let site = sweep.sites.at(x, y).or_else(|| match moves.nearest(x, y) {
            field::Found::Site { index, .. } => Some(index),
            _ => None,
        });
        let [x, y] = site.filter(|_| over).map_or([0.0; 2], of_site);
        [x, y, 0.0]
    };
    points.iter().map(of).collect()
}
