//! How a thing moves at the moment of one sweep: with its own velocity there, and a turn about the vertical where that explains more.

use super::{
    score::{Matching, Scorer},
    search::{AROUND, climb, some_of},
    sweeps::Sweep,
};

/// Most sites by which a motion is refined.
const MAX_SITES: usize = 160;
/// Other sweeps that are so many times as far in time as the nearest are asked, and all up to so many seconds: over less, what a velocity moves is
/// hardly more than beams are apart.
const NEAR: (f32, f32) = (1.6, 0.25);
/// Displacements of the first and last steps, metres.
const STEPS: [f32; 2] = [0.12, 0.008];
/// Fewest sites of what is seen to turn, and least distance of their farthest from their middle, metres.
const TURNS: (usize, f32) = (24, 1.2);
/// What a turn must add to the mean score.
const WORTH: f64 = 0.01;
/// Largest turn, radians a second: tight corners at town speed.
const FASTEST: f32 = 1.0;

/// Directions in which velocity and turn are changed.
const TURNING: [[f32; 3]; 6] =
    [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]];

/// A motion in the plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rigid {
    /// Velocity of its middle, metres a second.
    pub(super) velocity: [f32; 2],
    /// Turn about the vertical, radians a second.
    pub(super) turn: f32,
    /// Its middle at its sweep, metres.
    pub(super) middle: [f32; 2],
}

impl Rigid {
    /// The velocity of a point, metres a second.
    pub(super) fn at(&self, x: f32, y: f32) -> [f32; 2] {
        let [a, b] = [x - self.middle[0], y - self.middle[1]];
        [self.velocity[0] - self.turn * b, self.velocity[1] + self.turn * a]
    }
}

/// The motion of some sites of sweep `from` that explains best what the sweeps next to it and the images see.
pub(super) fn refined(scorer: &Scorer<'_>, from: usize, sites: &[usize], velocity: [f32; 2]) -> Rigid {
    let own = &scorer.sweeps[from];
    let middle = middle(own, sites);
    let Some(nearest) = own.others.first().map(|other| other.seconds.abs()) else {
        return Rigid { velocity, turn: 0.0, middle };
    };
    let near = own.others.iter().take_while(|other| other.seconds.abs() <= (NEAR.0 * nearest).max(NEAR.1)).count();
    let some = some_of(sites, MAX_SITES);
    let matching = Matching { others: near, ..Matching::FINE };
    let total = |velocity: [f32; 2], turn: f32| -> f64 {
        let rigid = Rigid { velocity, turn, middle };
        let site_score = |&site: &usize| {
            let [x, y, _] = own.sites.sites[site].mean;
            f64::from(scorer.score(from, site, rigid.at(x, y), matching))
        };
        if turn.abs() > FASTEST { f64::NEG_INFINITY } else { some.iter().map(site_score).sum() }
    };
    let (first, last) = (STEPS[0] / nearest, STEPS[1] / STEPS[0]);
    let straight = climb(velocity, [first; 2], last, &AROUND, |v| total(v, 0.0));
    let far = |&site: &usize| {
        let [x, y, _] = own.sites.sites[site].mean;
        (x - middle[0]).hypot(y - middle[1])
    };
    let reach = some.iter().map(far).fold(0.0, f32::max);
    let (mut velocity, mut turn) = (straight, 0.0);
    if some.len() >= TURNS.0 && reach >= TURNS.1 {
        let [x, y] = straight;
        // A step of the turn moves the farthest site as far as one of the velocity moves all.
        let steps = [first, first, first / reach];
        let [x, y, w] = climb([x, y, 0.0], steps, last, &TURNING, |[x, y, w]| total([x, y], w));
        if total([x, y], w) - total(straight, 0.0) >= WORTH * some.len() as f64 {
            (velocity, turn) = ([x, y], w);
        }
    }
    Rigid { velocity, turn, middle }
}

fn middle(own: &Sweep, sites: &[usize]) -> [f32; 2] {
    let sum = |k: usize| sites.iter().map(|&site| f64::from(own.sites.sites[site].mean[k])).sum::<f64>();
    [0, 1].map(|k| lgs_formats::casts::to_f32(sum(k) / sites.len().max(1) as f64))
}
