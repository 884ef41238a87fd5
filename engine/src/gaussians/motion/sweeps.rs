//! A sweep as registration sees it.

use super::{
    ground::{Ground, Lowest},
    masks::Mask,
    rays::{Look, Rays},
    sites::{REACH, Sites},
};
use crate::{parallel, points::PointCloud};

/// Seconds between sweeps over which a velocity counts as constant.
const STEADY: f32 = 0.65;
/// Seconds after which two sweeps have nothing to say about each other's velocities, even when none is nearer.
const APART: f32 = 1.1;
/// Sweeps that are nearer in time than this show the same moment, seconds.
const SAME_MOMENT: f32 = 5e-3;
/// Distance at which a site of another sweep is no longer the same place: metres, and share of the distance from the sensor.
const SAME_PLACE: [f32; 2] = [0.25, 0.006];
/// Share of the distance from the sensor that neighbouring beams may be apart in height.
const BEAMS: f32 = 0.01;

/// Another sweep to compare with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Other {
    /// Its index.
    pub(super) sweep: usize,
    /// How much later it was taken, seconds.
    pub(super) seconds: f32,
}

/// What the other sweeps see where a site is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Still {
    /// Share of the other sweeps that know the place and see something there.
    pub(super) share: f32,
    /// How many saw through it.
    pub(super) through: u32,
}

/// A sweep as registration sees it.
#[derive(Clone, Debug)]
pub(super) struct Sweep {
    pub(super) sites: Sites,
    pub(super) rays: Rays,
    pub(super) ground: Ground,
    /// Where it was taken from, the mean over its returns, metres, clip frame.
    pub(super) origin: [f32; 3],
    /// Mean time of its returns, seconds.
    pub(super) time: f32,
    /// Whom it is compared with, nearest in time first.
    pub(super) others: Vec<Other>,
    /// `[sites]`.
    pub(super) still: Vec<Still>,
    /// Everything that stands above the ground, and of it what does not surely stand still.
    pub(super) masks: [Mask; 2],
}

impl Sweep {
    /// The site nearest to a place and how near it is: 1 there, 0 where it is no longer the same place.
    pub(super) fn nearest(&self, place: [f32; 3], range: f32, tolerance: f32) -> Option<(usize, f32)> {
        let limit = tolerance * (SAME_PLACE[0] + SAME_PLACE[1] * range);
        let mut best = (0, limit * limit);
        for (index, [x, y, z]) in self.sites.buckets.around(place[0], place[1], limit)? {
            let up = ((z - place[2]).abs() - BEAMS * range).max(0.0);
            let square = (x - place[0]).powi(2) + (y - place[1]).powi(2) + up * up;
            if square < best.1 {
                best = (index as usize, square);
            }
        }
        (best.1 < limit * limit).then(|| (best.0, 1.0 - best.1 / (limit * limit)))
    }
}

/// The sweeps of a cloud.
///
/// # Shapes
/// `runs` `[S]` ranges of the cloud's points.
pub(super) fn prepare(cloud: &PointCloud, runs: &[std::ops::Range<usize>]) -> Vec<Sweep> {
    let origin = |run: &std::ops::Range<usize>| {
        let sum = |k: usize| cloud.origins[run.clone()].iter().map(|origin| f64::from(origin[k])).sum::<f64>();
        [0, 1, 2].map(|k| lgs_formats::casts::to_f32(sum(k) / run.len().max(1) as f64))
    };
    let origins: Vec<[f32; 3]> = runs.iter().map(origin).collect();
    let mean = |run: &std::ops::Range<usize>| {
        let sum: f64 = cloud.times[run.clone()].iter().map(|&time| f64::from(time)).sum();
        lgs_formats::casts::to_f32(sum / run.len().max(1) as f64)
    };
    let times: Vec<f32> = runs.iter().map(mean).collect();
    let points = |index: usize| &cloud.positions[runs[index].clone()];
    let lowest: Vec<Lowest> = parallel::map(runs.len(), 1, &|index| Lowest::of(points(index), origins[index], REACH));
    let prepared = |index: usize| {
        let (others, origin) = (others(&times, index), origins[index]);
        let ground = Ground::of(&lowest[index], others.iter().map(|other| &lowest[other.sweep]));
        let sites = Sites::of(points(index), &cloud.times[runs[index].clone()], origin, &ground);
        let rays = Rays::of(points(index), &cloud.origins[runs[index].clone()], origin);
        let all = Mask::of(&sites.sites, origin, |_| true);
        Sweep { masks: [all.clone(), all], still: Vec::new(), origin, time: times[index], rays, sites, others, ground }
    };
    let mut sweeps: Vec<Sweep> = parallel::map(runs.len(), 1, &prepared);
    let mut still: Vec<Vec<Still>> = parallel::map(sweeps.len(), 1, &|sweep| {
        parallel::map(sweeps[sweep].sites.len(), 1, &|site| still(&sweeps, sweep, site))
    });
    parallel::for_each_pair(&mut sweeps, &mut still, 1, &|index, sweep, still| {
        sweep.masks[1] = Mask::of(&sweep.sites.sites, origins[index], |site| still[site].share < 0.75);
        sweep.still = std::mem::take(still);
    });
    sweeps
}

fn still(sweeps: &[Sweep], from: usize, site: usize) -> Still {
    let site = &sweeps[from].sites.sites[site];
    let (mut known, mut seen, mut through) = (0.0, 0.0, 0);
    for other in &sweeps[from].others {
        let there = &sweeps[other.sweep];
        if let Some((_, near)) = there.nearest(site.mean, site.range, 1.0) {
            known += 1.0;
            seen += near.sqrt();
        } else if there.rays.look(site.mean) == Look::Through {
            known += 1.0;
            through += 1;
        }
    }
    Still { share: if known > 0.0 { seen / known } else { 0.0 }, through }
}

/// The sweeps that one is compared with, nearest in time first: on either side the nearest, the farthest over which velocities count as
/// constant, and one between them.
fn others(times: &[f32], index: usize) -> Vec<Other> {
    let offset = |sweep: usize| Other { sweep, seconds: times[sweep] - times[index] };
    let mut apart: Vec<Other> =
        (0..times.len()).map(offset).filter(|other| other.seconds.abs() >= SAME_MOMENT).collect();
    apart.sort_by(|a, b| a.seconds.abs().total_cmp(&b.seconds.abs()));
    let mut chosen = Vec::new();
    for later in [false, true] {
        let side: Vec<Other> = apart.iter().copied().filter(|other| (other.seconds > 0.0) == later).collect();
        let count = side.iter().take_while(|other| other.seconds.abs() <= STEADY).count();
        let places = [0, count / 2, count.saturating_sub(1)];
        let mut places = places.into_iter().filter(|&place| place < count).collect::<Vec<_>>();
        places.dedup();
        chosen.extend(places.into_iter().map(|place| side[place]));
    }
    if chosen.is_empty() {
        chosen.extend(apart.into_iter().take(2).filter(|other| other.seconds.abs() <= APART));
    }
    chosen.sort_by(|a, b| a.seconds.abs().total_cmp(&b.seconds.abs()));
    chosen
}
