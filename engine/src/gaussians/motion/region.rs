//! The sites of a sweep that a velocity explains better than standing still.

use std::collections::{HashMap, HashSet, VecDeque};

use super::score::{Matching, Scorer};

/// Gain from which on a site surely moves, and down to which it may belong to what moves around it.
const GAIN: [f32; 2] = [0.25, -0.35];
/// Mean gain of a site and its neighbours down to which it stays.
const KEEPS: f32 = -0.08;
/// Distance between sites that surely move and are one thing, and between others: metres; and share of the distance from the sensor.
const LINK: [f32; 3] = [1.3, 0.6, 0.012];
/// Longest and widest thing, metres.
const LARGEST: [f32; 2] = [20.0, 3.6];
/// How far beside what surely moves the rest of it may be, metres.
const BESIDE: f32 = 0.5;
/// Distance over which a site is judged together with its neighbours, metres.
const TOGETHER: f32 = 0.6;

/// The sites of a sweep that move as one.
#[derive(Clone, Debug, Default)]
pub(super) struct Region {
    /// Indices, rising.
    pub(super) sites: Vec<usize>,
    /// Sum of what the velocity explains better than standing still.
    pub(super) gain: f64,
    /// How many of them surely move.
    pub(super) sure: usize,
}

/// What grows.
struct Growth<'a> {
    scorer: &'a Scorer<'a>,
    /// `[sites]` scores of standing still.
    zero: &'a [f32],
    from: usize,
    velocity: [f32; 2],
    gains: HashMap<usize, f32>,
}

impl Growth<'_> {
    fn gain(&mut self, site: usize) -> f32 {
        let (scorer, from, velocity, zero) = (self.scorer, self.from, self.velocity, self.zero);
        *self.gains.entry(site).or_insert_with(|| scorer.score(from, site, velocity, Matching::FINE) - zero[site])
    }

    /// Along the velocity and across it, metres.
    fn axes(&self, site: usize) -> [f32; 2] {
        let [x, y, _] = self.scorer.sweeps[self.from].sites.sites[site].mean;
        let [a, b] = self.velocity;
        let speed = a.hypot(b).max(1e-6);
        [(x * a + y * b) / speed, (y * a - x * b) / speed]
    }

    /// The sites around one.
    fn around(&self, site: usize, link: f32) -> Vec<usize> {
        let sites = &self.scorer.sweeps[self.from].sites;
        let here = &sites.sites[site];
        let reach = link + LINK[2] * here.range;
        let near = |&(_, [x, y, z]): &(u32, [f32; 3])| {
            let up = (z - here.mean[2]).abs() - LINK[2] * here.range;
            (x - here.mean[0]).powi(2) + (y - here.mean[1]).powi(2) <= reach * reach && up <= 1.0
        };
        let found = sites.buckets.around(here.mean[0], here.mean[1], reach).into_iter().flatten().filter(near);
        found.map(|(other, _)| other as usize).filter(|&other| other != site).collect()
    }

    /// What is reached from `starts` over sites that are `wanted`, in the order in which they are reached.
    fn spread(&mut self, starts: &[usize], link: f32, mut wanted: impl FnMut(&mut Self, usize) -> bool) -> Vec<usize> {
        let mut seen: HashSet<usize> = starts.iter().copied().collect();
        let mut found = Vec::new();
        let mut queue: VecDeque<usize> = starts.iter().copied().collect();
        while let Some(site) = queue.pop_front() {
            found.push(site);
            for other in self.around(site, link) {
                if seen.insert(other) && wanted(self, other) {
                    queue.push_back(other);
                }
            }
        }
        found
    }
}

/// Ends of what was gathered along an axis.
#[derive(Clone, Copy, Debug)]
struct Ends {
    low: [f32; 2],
    high: [f32; 2],
}

impl Ends {
    const NONE: Self = Self { low: [f32::MAX; 2], high: [f32::MIN; 2] };

    fn with(self, at: [f32; 2]) -> Self {
        Self { low: [0, 1].map(|k| self.low[k].min(at[k])), high: [0, 1].map(|k| self.high[k].max(at[k])) }
    }

    fn fits(self) -> bool {
        (0..2).all(|k| self.high[k] - self.low[k] <= LARGEST[k])
    }
}

/// The region around the sites `seeds` of sweep `from` that `velocity` explains better than standing still; empty where none of them does.
///
/// # Shapes
/// `zero` `[sites]` scores of standing still; `free` `[sites]` whether a site may be taken.
pub(super) fn grow(
    scorer: &Scorer<'_>,
    zero: &[f32],
    from: usize,
    velocity: [f32; 2],
    seeds: &[usize],
    free: &[bool],
) -> Region {
    let mut growth = Growth { scorer, zero, from, velocity, gains: HashMap::new() };
    let starts: Vec<usize> = seeds.iter().copied().filter(|&site| free[site] && growth.gain(site) >= GAIN[0]).collect();
    let Some(&first) = starts.get(starts.len() / 2) else { return Region::default() };
    let mut ends = Ends::NONE.with(growth.axes(first));
    let sure = growth.spread(&[first], LINK[0], |growth, site| {
        let with = ends.with(growth.axes(site));
        let wanted = free[site] && growth.gain(site) >= GAIN[0] && with.fits();
        if wanted {
            ends = with;
        }
        wanted
    });
    let across = [ends.low[1] - BESIDE, ends.high[1] + BESIDE];
    let all = growth.spread(&sure, LINK[1], |growth, site| {
        let at = growth.axes(site);
        let with = ends.with([at[0], ends.low[1]]);
        let wanted =
            free[site] && at[1] >= across[0] && at[1] <= across[1] && with.fits() && growth.gain(site) >= GAIN[1];
        if wanted {
            ends = with;
        }
        wanted
    });
    let mut sites: Vec<usize> = all
        .iter()
        .copied()
        .filter(|&site| {
            let near = growth.around(site, TOGETHER);
            let known: f32 = near.iter().map(|&other| growth.gain(other)).sum();
            growth.gain(site) + known >= KEEPS * (near.len() + 1) as f32
        })
        .collect();
    sites.sort_unstable();
    let gain = sites.iter().map(|&site| f64::from(growth.gain(site))).sum();
    let sure = sites.iter().filter(|&&site| growth.gains[&site] >= GAIN[0]).count();
    Region { sites, gain, sure }
}
