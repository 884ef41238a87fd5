//! Returns of the vehicle that carries the sensor: roof, bonnet, mounts. They go with the sensor.
//!
//! So do, at first sight, those of a smooth side beside it: a wall or a parked car is hit at the same places beside the sensor again. Unlike the
//! vehicle, it is also where it was.

use std::collections::HashMap;

use lgs_formats::casts::whole;

use super::{
    grid::{Buckets, Grid},
    sweeps::Sweep,
};
use crate::{parallel, points::PointCloud};

/// Distance from the sensor, seen from above, up to which its vehicle is, metres.
const REACH: f32 = 3.0;
/// Side of the cells in which returns are looked up, metres.
const CELL: f32 = 0.25;
/// How far from its place a return may be in another sweep, metres.
const SAME: f32 = 0.1;
/// Least way of the sensor between two sweeps that tells its vehicle from what stands, metres.
const DRIVEN: f32 = 0.4;
/// Share of the sweeps that tell in which a return must be again.
const AGAIN: f32 = 0.5;
/// Side of the cubes of which 27 are judged as one, metres.
const TOGETHER: f32 = 0.7;
/// Times that returns are where they were, over the times that they are at the same place beside the sensor, from which on they stand. In pieces of
/// more than a hundred returns that is 0 to 0.1 for what is on the vehicles of five clips (KITTI, KITTI-360, DDAD, `PandaSet`), in smaller ones mostly up
/// to 0.5, and 0.7 to 1.5 for cars that stand beside them.
const STANDS: f32 = 0.5;

/// The returns of one sweep that go with the sensor, and the sensor's velocity, metres a second.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Own {
    /// Indices in the cloud, rising.
    pub(super) returns: Vec<usize>,
    pub(super) velocity: [f32; 2],
}

/// In how many sweeps that tell something is seen again: beside the sensor, and where it was.
type Seen = [u32; 2];

/// Those of every sweep.
///
/// # Shapes
/// `runs` `[S]` ranges of the cloud's returns; result `[S]`.
pub(super) fn own(cloud: &PointCloud, runs: &[std::ops::Range<usize>], sweeps: &[Sweep]) -> Vec<Own> {
    // The returns of a sweep around a place, from there.
    let around = |sweep: usize, origin: [f32; 3]| -> Vec<(usize, [f32; 3])> {
        let place = |point: usize| (point, std::array::from_fn(|k| cloud.positions[point][k] - origin[k]));
        let near = |(_, [x, y, _]): &(usize, [f32; 3])| x.hypot(*y) <= REACH;
        runs[sweep].clone().map(place).filter(near).collect()
    };
    let grid = Grid::around([0.0; 3], REACH, CELL);
    let buckets = |returns: &[(usize, [f32; 3])]| Buckets::of(grid, returns.iter().map(|&(_, place)| place));
    let beside: Vec<Vec<(usize, [f32; 3])>> =
        parallel::map(sweeps.len(), 1, &|index| around(index, sweeps[index].origin));
    let of_sweep = |index: usize| {
        let sweep = &sweeps[index];
        let way = |other: usize| [0, 1].map(|k| sweeps[other].origin[k] - sweep.origin[k]);
        let driven = |[x, y]: [f32; 2]| x.hypot(y) >= DRIVEN;
        let others: Vec<usize> =
            sweep.others.iter().map(|other| other.sweep).filter(|&other| driven(way(other))).collect();
        let Some(&first) = others.first() else { return Own { returns: Vec::new(), velocity: [0.0; 2] } };
        let mut seen: Vec<Seen> = vec![[0; 2]; beside[index].len()];
        for &other in &others {
            let both = [buckets(&beside[other]), buckets(&around(other, sweep.origin))];
            for (seen, &(_, place)) in seen.iter_mut().zip(&beside[index]) {
                *seen = std::array::from_fn(|k| seen[k] + u32::from(is_near(&both[k], place)));
            }
        }
        let goes = goes_along(&beside[index], &seen);
        let again = |seen: &Seen| seen[0] as f32 >= AGAIN * others.len() as f32;
        let chosen = beside[index].iter().zip(&seen).zip(goes).filter(|((_, seen), goes)| *goes && again(seen));
        let seconds = sweeps[first].time - sweep.time;
        Own {
            returns: chosen.map(|((&(point, _), _), _)| point).collect(),
            velocity: way(first).map(|way| way / seconds),
        }
    };
    parallel::map(sweeps.len(), 1, &of_sweep)
}

/// Whether one of some returns is at a place.
fn is_near(returns: &Buckets, place: [f32; 3]) -> bool {
    let square = |there: [f32; 3]| (0..3).map(|k| (there[k] - place[k]).powi(2)).sum::<f32>();
    let mut near = returns.around(place[0], place[1], SAME).into_iter().flatten();
    near.any(|(_, there)| square(there) <= SAME * SAME)
}

/// Whether what is around each of some returns goes with the sensor rather than stands.
///
/// # Shapes
/// `seen` and result `[returns]`.
fn goes_along(returns: &[(usize, [f32; 3])], seen: &[Seen]) -> Vec<bool> {
    /// Cubes that are counted below the sensor; more than there are to its sides.
    const BELOW: f32 = 32.0;
    let cube = |place: [f32; 3]| place.map(|at| whole(at / TOGETHER + BELOW));
    let mut cubes: HashMap<[usize; 3], Seen> = HashMap::new();
    for (&(_, place), seen) in returns.iter().zip(seen) {
        let sums = cubes.entry(cube(place)).or_default();
        *sums = [0, 1].map(|k| sums[k] + seen[k]);
    }
    let goes = |[x, y, z]: [usize; 3]| {
        let near =
            (0..27).filter_map(|k| cubes.get(&[x + k % 3 - 1, y + k / 3 % 3 - 1, (z + k / 9).saturating_sub(1)]));
        let [beside, still] = near.fold([0, 0], |sums: Seen, seen| [0, 1].map(|k| sums[k] + seen[k]));
        (still as f32) < STANDS * beside as f32
    };
    let mut decided: HashMap<[usize; 3], bool> = HashMap::new();
    let mut of_cube = |at: [usize; 3]| *decided.entry(at).or_insert_with(|| goes(at));
    returns.iter().map(|&(_, place)| of_cube(cube(place))).collect()
}
