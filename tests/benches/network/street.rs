//! A driving-like cloud: a spinning `LiDAR` that drives along a street of facades, parked cars and trunks.

use std::collections::HashSet;

use lgs_engine::network::levels::voxels_of;
use lgs_tests::random::Random;

/// Edge of a voxel, metres.
pub(crate) const VOXEL_SIZE: f64 = 0.1;

const NUM_BEAMS: usize = 64;
const NUM_COLUMNS: usize = 2083;
const LOWEST_DEG: f64 = -24.8;
const HIGHEST_DEG: f64 = 2.0;
const HEIGHT: f64 = 1.73;
const REACH: f64 = 80.0;
const NOISE: f64 = 0.02;
/// Metres between two sweeps.
const STEP: f64 = 0.8;
/// Half of the street's length, metres.
const HALF_LENGTH: f64 = 120.0;

/// Corners of a box with faces along the axes, metres; the ground is at 0.
#[derive(Clone, Copy, Debug)]
struct Block {
    low: [f64; 3],
    high: [f64; 3],
}

/// Returns of one sweep after the other, metres.
#[derive(Debug)]
pub(crate) struct Street {
    blocks: Vec<Block>,
    random: Random,
    sweep: u32,
}

impl Street {
    /// The street with this seed.
    pub(crate) fn new(seed: u64) -> Self {
        let mut random = Random::new(seed);
        let mut blocks = Vec::new();
        for side in [-1.0, 1.0] {
            let mut x = -HALF_LENGTH;
            while x < HALF_LENGTH {
                let width = random.uniform(6.0, 18.0);
                let front = random.uniform(9.0, 14.0);
                blocks.push(beside(side, [x, front, 0.0], [width, 8.0, random.uniform(5.0, 14.0)]));
                if random.uniform(0.0, 1.0) < 0.7 {
                    blocks.push(beside(side, [x + 1.0, 4.5, 0.3], [4.2, 1.8, 1.2]));
                }
                blocks.push(beside(side, [x + width - 1.0, 7.5, 0.0], [0.3, 0.3, 6.0]));
                // Gaps between the houses.
                x += width + random.uniform(0.0, 4.0);
            }
        }
        Self { blocks, random, sweep: 0 }
    }

    /// The first `count` returns.
    pub(crate) fn points(mut self, count: usize) -> Vec<[f32; 3]> {
        let mut points = Vec::new();
        while points.len() < count {
            points.extend(self.next_sweep());
        }
        points.truncate(count);
        points
    }

    /// The first `count` voxels that returns fall into: batch 0, x, y, z.
    ///
    /// # Errors
    /// Never for a street.
    pub(crate) fn voxels(mut self, count: usize) -> lgs_engine::error::Result<Vec<[i32; 4]>> {
        let (mut seen, mut voxels) = (HashSet::new(), Vec::new());
        while voxels.len() < count {
            let sweep = voxels_of(self.next_sweep().into_iter(), VOXEL_SIZE)?;
            voxels.extend(sweep.into_iter().filter(|voxel| seen.insert(*voxel)));
        }
        voxels.truncate(count);
        Ok(voxels)
    }

    #[expect(clippy::cast_possible_truncation, reason = "points are stored in f32")]
    fn next_sweep(&mut self) -> Vec<[f32; 3]> {
        let origin = [STEP * f64::from(self.sweep), 0.0, HEIGHT];
        self.sweep += 1;
        let mut points = Vec::new();
        for beam in 0..NUM_BEAMS {
            let share = beam as f64 / (NUM_BEAMS - 1) as f64;
            let elevation = (LOWEST_DEG + (HIGHEST_DEG - LOWEST_DEG) * share).to_radians();
            for column in 0..NUM_COLUMNS {
                let azimuth = std::f64::consts::TAU * column as f64 / NUM_COLUMNS as f64;
                let direction = [elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin()];
                if let Some(distance) = self.distance(origin, direction) {
                    let distance = distance + NOISE * self.random.normal();
                    points.push([0, 1, 2].map(|axis| (origin[axis] + distance * direction[axis]) as f32));
                }
            }
        }
        points
    }

    fn distance(&self, origin: [f64; 3], direction: [f64; 3]) -> Option<f64> {
        let ground = if direction[2] < 0.0 { -origin[2] / direction[2] } else { REACH };
        let nearest = self.blocks.iter().filter_map(|block| block.hit(origin, direction)).fold(ground, f64::min);
        (nearest < REACH).then_some(nearest)
    }
}

impl Block {
    /// Where a ray enters.
    fn hit(&self, origin: [f64; 3], direction: [f64; 3]) -> Option<f64> {
        let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
        for axis in 0..3 {
            let [a, b] = [self.low[axis], self.high[axis]].map(|face| (face - origin[axis]) / direction[axis]);
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        (enter > 0.0 && enter <= leave).then_some(enter)
    }
}

/// A block on one side of the street: `[x, distance from the middle, z]` of its near corner, `[length, depth, height]`.
fn beside(side: f64, [x, y, z]: [f64; 3], [length, depth, height]: [f64; 3]) -> Block {
    let (near, far) = (side * y, side * (y + depth));
    Block { low: [x, near.min(far), z], high: [x + length, near.max(far), z + height] }
}
