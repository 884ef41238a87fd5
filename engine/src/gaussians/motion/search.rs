//! Where something may move, and how fast it may.

use lgs_formats::casts::whole;

use super::{
    score::{Matching, Scorer},
    sites::Sites,
    sweeps::{Still, Sweep},
};
use crate::parallel;

/// Fastest speed that is looked for, metres a second.
pub(super) const FASTEST: f32 = 40.0;
/// Displacement between two hypotheses of the coarse search, metres.
const STRIDE: f32 = 0.5;
/// Hypotheses of the coarse search that are followed.
const NUM_FOLLOWED: usize = 5;
/// Displacements of the first and last steps when they are followed, metres.
const STEPS: [f32; 2] = [0.2, 0.04];
/// Displacement between two of them that are different, metres.
const APART: f32 = 0.3;
/// Most sites of a seed that are moved.
const MAX_SITES: usize = 32;
/// Distance between two sites of a seed: metres, and share of the distance from the sensor.
const LINK: [f32; 2] = [0.5, 0.015];
/// Fewest returns of a seed.
const FEWEST: u32 = 6;
/// What it is worth to land on what surely stands, of landing on what may move.
const STANDS: f64 = 0.3;
/// Share of a seed that must land on something.
const LANDS: f64 = 0.4;
/// Velocities of the coarse search that a thread takes at once.
const GRAIN: usize = 64;

/// Groups of sites that other sweeps see through.
pub(super) fn seeds(sites: &Sites, still: &[Still]) -> Vec<Vec<usize>> {
    let seen = |site: usize| still[site].through > 0;
    let mut parents: Vec<usize> = (0..sites.len()).collect();
    for (index, site) in sites.sites.iter().enumerate().filter(|(index, _)| seen(*index)) {
        let reach = LINK[0] + LINK[1] * site.range;
        let near = sites.buckets.around(site.mean[0], site.mean[1], reach).into_iter().flatten();
        for (other, [x, y, z]) in near.filter(|&(other, _)| seen(other as usize)) {
            let square = (x - site.mean[0]).powi(2) + (y - site.mean[1]).powi(2);
            if square <= reach * reach && (z - site.mean[2]).abs() <= 2.0 * reach {
                join(&mut parents, index, other as usize);
            }
        }
    }
    let mut members: Vec<Vec<usize>> = vec![Vec::new(); parents.len()];
    for site in (0..parents.len()).filter(|&site| seen(site)) {
        members[root(&mut parents, site)].push(site);
    }
    let returns = |seed: &[usize]| seed.iter().map(|&site| sites.sites[site].returns).sum::<u32>();
    members.into_iter().filter(|seed| returns(seed) >= FEWEST).collect()
}

/// Sites that stand for all of them.
pub(super) fn some_of(sites: &[usize], most: usize) -> Vec<usize> {
    sites.iter().copied().step_by(sites.len().div_ceil(most).max(1)).collect()
}

/// Velocities that may explain the sites of sweep `from`, were they to move, best first.
pub(super) fn candidates(scorer: &Scorer<'_>, from: usize, sites: &[usize]) -> Vec<[f32; 2]> {
    let sites = some_of(sites, MAX_SITES);
    let others = &scorer.sweeps[from].others;
    let longest = |count: usize| others.iter().take(count).map(|other| other.seconds.abs()).fold(0.0, f32::max);
    let (seconds, last) = (longest(2), longest(usize::MAX));
    if seconds <= 0.0 {
        return Vec::new();
    }
    let mut starts = coarse(STRIDE / seconds, LANDS * (sites.len() * others.len().min(2)) as f64, |v| {
        lands(scorer.sweeps, from, &sites, v)
    });
    starts.truncate(NUM_FOLLOWED);
    let follow = |start: [f32; 2]| {
        let rough = |v| scorer.total(from, &sites, v, Matching::ROUGH);
        let near = climb(start, [0.5 * STRIDE / seconds; 2], 0.8, &AROUND, rough);
        let fine = |v| scorer.total(from, &sites, v, Matching::FINE);
        let near = climb(near, [STEPS[0] / last; 2], STEPS[1] / STEPS[0], &AROUND, fine);
        (near, scorer.total(from, &sites, near, Matching::FINE))
    };
    let mut found: Vec<([f32; 2], f64)> = parallel::map(starts.len(), 1, &|k| follow(starts[k]));
    found.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut kept: Vec<[f32; 2]> = Vec::new();
    for (v, _) in found {
        let new = |other: &[f32; 2]| (v[0] - other[0]).hypot(v[1] - other[1]) * last > APART;
        if kept.iter().all(new) {
            kept.push(v);
        }
    }
    kept
}

/// How much of some sites lands on something in the two sweeps nearest in time.
fn lands(sweeps: &[Sweep], from: usize, sites: &[usize], velocity: [f32; 2]) -> f64 {
    let own = &sweeps[from];
    let mut sum = 0.0;
    for other in own.others.iter().take(2) {
        let there = &sweeps[other.sweep];
        let moved = velocity.map(|v| v * other.seconds);
        for &site in sites {
            let [x, y, z] = own.sites.sites[site].mean;
            let place = [x + moved[0], y + moved[1], z];
            if there.masks[1].near(place) {
                sum += 1.0;
            } else if there.masks[0].near(place) {
                sum += STANDS;
            }
        }
    }
    sum
}

/// The local maxima above `least` among velocities `step` apart, best first.
fn coarse(step: f32, least: f64, value: impl Fn([f32; 2]) -> f64 + Sync) -> Vec<[f32; 2]> {
    let reach = whole(FASTEST / step).max(1);
    let side = 2 * reach + 1;
    let velocity = |at: usize| [at % side, at / side].map(|k| (k as f32 - reach as f32) * step);
    let possible = |[x, y]: [f32; 2]| x * x + y * y <= FASTEST * FASTEST;
    let value_at = |at: usize| if possible(velocity(at)) { value(velocity(at)) } else { 0.0 };
    let values: Vec<f64> = parallel::map(side * side, GRAIN, &value_at);
    let neighbours = |at: usize| {
        let (x, y) = (at % side, at / side);
        let rows = y.saturating_sub(1)..(y + 2).min(side);
        rows.flat_map(move |r| (x.saturating_sub(1)..(x + 2).min(side)).map(move |c| r * side + c))
    };
    let best = |at: &usize| {
        values[*at] >= least
            && neighbours(*at).all(|n| values[n] < values[*at] || (values[n] == values[*at] && n >= *at))
    };
    let mut maxima: Vec<usize> = (0..side * side).filter(best).collect();
    maxima.sort_by(|&a, &b| values[b].total_cmp(&values[a]).then(a.cmp(&b)));
    maxima.into_iter().map(velocity).collect()
}

/// Directions in which a velocity is changed.
pub(super) const AROUND: [[f32; 2]; 8] =
    [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0], [1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0]];

/// Where steps along some directions no longer raise `value`; `first` long at the beginning, and halved as long as they are at least `last`
/// of that.
pub(super) fn climb<const N: usize>(
    start: [f32; N],
    first: [f32; N],
    last: f32,
    directions: &[[f32; N]],
    value: impl Fn([f32; N]) -> f64 + Sync,
) -> [f32; N] {
    /// Most steps of one length.
    const MAX_STEPS: usize = 8;
    let (mut best, mut highest, mut share) = (start, value(start), 1.0);
    while share >= last {
        for _ in 0..MAX_STEPS {
            let before = best;
            let found: Vec<([f32; N], f64)> = parallel::map(directions.len(), 1, &|direction| {
                let next = std::array::from_fn(|k| before[k] + share * first[k] * directions[direction][k]);
                (next, value(next))
            });
            for (next, found) in found {
                if found > highest {
                    (best, highest) = (next, found);
                }
            }
            if best == before {
                break;
            }
        }
        share *= 0.5;
    }
    best
}

fn root(parents: &mut [usize], mut index: usize) -> usize {
    while parents[index] != index {
        parents[index] = parents[parents[index]];
        index = parents[index];
    }
    index
}

/// Joins two trees: the lower root becomes that of both.
fn join(parents: &mut [usize], a: usize, b: usize) {
    let [a, b] = [root(parents, a), root(parents, b)];
    parents[a.max(b)] = a.min(b);
}
