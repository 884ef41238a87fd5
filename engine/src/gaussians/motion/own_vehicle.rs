//! Returns of the vehicle that carries the sensor: roof, bonnet, mounts. They go with the sensor.

use super::{
    grid::{Buckets, Grid},
    sweeps::Sweep,
};
use crate::points::PointCloud;

/// Distance from the sensor, seen from above, up to which its vehicle is, metres.
const REACH: f32 = 3.0;
/// Side of the cells in which returns are looked up, metres.
const CELL: f32 = 0.25;
/// How far from its place beside the sensor a return may be in another sweep, metres.
const SAME: f32 = 0.1;
/// Least way of the sensor between two sweeps that tells its vehicle from what stands, metres.
const DRIVEN: f32 = 0.4;
/// Share of the sweeps that tell in which a return must be again.
const AGAIN: f32 = 0.5;

/// The returns of one sweep that go with the sensor, and the sensor's velocity, metres a second.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Own {
    /// Indices in the cloud, rising.
    pub(super) returns: Vec<usize>,
    pub(super) velocity: [f32; 2],
}

/// Those of every sweep.
///
/// # Shapes
/// `runs` `[S]` ranges of the cloud's returns; result `[S]`.
pub(super) fn own(cloud: &PointCloud, runs: &[std::ops::Range<usize>], sweeps: &[Sweep]) -> Vec<Own> {
    let beside = |index: usize| -> Vec<(usize, [f32; 3])> {
        let origin = sweeps[index].origin;
        let place = |point: usize| (point, std::array::from_fn(|k| cloud.positions[point][k] - origin[k]));
        let near = |(_, [x, y, _]): &(usize, [f32; 3])| x.hypot(*y) <= REACH;
        runs[index].clone().map(place).filter(near).collect()
    };
    let all: Vec<Vec<(usize, [f32; 3])>> = (0..sweeps.len()).map(beside).collect();
    let grid = Grid::around([0.0; 3], REACH, CELL);
    let buckets: Vec<Buckets> =
        all.iter().map(|returns| Buckets::of(grid, returns.iter().map(|&(_, place)| place))).collect();
    let labels = |index: usize| {
        let sweep = &sweeps[index];
        let way = |other: usize| [0, 1].map(|k| sweeps[other].origin[k] - sweep.origin[k]);
        let driven = |[x, y]: [f32; 2]| x.hypot(y) >= DRIVEN;
        let others: Vec<usize> =
            sweep.others.iter().map(|other| other.sweep).filter(|&other| driven(way(other))).collect();
        let again = |place: [f32; 3]| {
            let in_it = |&&other: &&usize| {
                let mut near = buckets[other].around(place[0], place[1], SAME).into_iter().flatten();
                near.any(|(_, there)| (0..3).map(|k| (there[k] - place[k]).powi(2)).sum::<f32>() <= SAME * SAME)
            };
            others.iter().filter(in_it).count() as f32 >= AGAIN * others.len() as f32
        };
        let Some(&first) = others.first() else { return Own { returns: Vec::new(), velocity: [0.0; 2] } };
        let seconds = sweeps[first].time - sweep.time;
        Own {
            returns: all[index].iter().filter(|&&(_, place)| again(place)).map(|&(point, _)| point).collect(),
            velocity: way(first).map(|way| way / seconds),
        }
    };
    (0..sweeps.len()).map(labels).collect()
}
