//! How a thing moves at the moment of one sweep: with its own velocity there, and a turn about the vertical where that explains more.

use super::{
    judge::{Care, Judge},
    search::some_of,
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
const WORTH: f64 = 0.02;
/// Largest turn, radians a second: tight corners at town speed.
const FASTEST: f32 = 1.0;

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
pub(super) fn refined(judge: &Judge<'_>, from: usize, sites: &[usize], velocity: [f32; 2]) -> Rigid {
    let own = &judge.sweeps[from];
    let middle = middle(own, sites);
    let start = Rigid { velocity, turn: 0.0, middle };
    let Some(nearest) = own.others.first().map(|other| other.seconds.abs()) else { return start };
    let near = own.others.iter().take_while(|other| other.seconds.abs() <= (NEAR.0 * nearest).max(NEAR.1)).count();
    let some = some_of(sites, MAX_SITES);
    let care = Care { others: near, ..Care::FINE };
    let total = |rigid: &Rigid| -> f64 {
        let of = |&site: &usize| {
            let [x, y, _] = own.sites.sites[site].mean;
            f64::from(judge.score(from, site, rigid.at(x, y), care))
        };
        some.iter().map(of).sum()
    };
    let straight = climb(start, nearest, None, &total);
    let far = |&site: &usize| {
        let [x, y, _] = own.sites.sites[site].mean;
        (x - middle[0]).hypot(y - middle[1])
    };
    let reach = some.iter().map(far).fold(0.0, f32::max);
    if some.len() < TURNS.0 || reach < TURNS.1 {
        return straight;
    }
    let turning = climb(straight, nearest, Some(reach), &total);
    if total(&turning) - total(&straight) >= WORTH * some.len() as f64 { turning } else { straight }
}

fn middle(own: &Sweep, sites: &[usize]) -> [f32; 2] {
    let sum = |k: usize| sites.iter().map(|&site| f64::from(own.sites.sites[site].mean[k])).sum::<f64>();
    [0, 1].map(|k| crate::views::to_f32(sum(k) / sites.len().max(1) as f64))
}

/// Where steps of shrinking length along velocity and, for a thing of some half length, turn no longer raise `total`.
fn climb(start: Rigid, seconds: f32, half: Option<f32>, total: &impl Fn(&Rigid) -> f64) -> Rigid {
    /// Most steps of one length.
    const MAX_STEPS: usize = 8;
    let (mut best, mut highest, mut step) = (start, total(&start), STEPS[0]);
    while step >= STEPS[1] {
        for _ in 0..MAX_STEPS {
            let before = best;
            let speed = step / seconds;
            let turn = half.map_or(0.0, |half| speed / half);
            let moves = [
                [1.0, 0.0, 0.0],
                [-1.0, 0.0, 0.0],
                [0.0, 1.0, 0.0],
                [0.0, -1.0, 0.0],
                [0.0, 0.0, 1.0],
                [0.0, 0.0, -1.0],
            ];
            for [x, y, w] in moves {
                if w != 0.0 && half.is_none() {
                    continue;
                }
                let next = Rigid {
                    velocity: [before.velocity[0] + x * speed, before.velocity[1] + y * speed],
                    turn: (before.turn + w * turn).clamp(-FASTEST, FASTEST),
                    ..before
                };
                let found = total(&next);
                if found > highest {
                    (best, highest) = (next, found);
                }
            }
            if best == before {
                break;
            }
        }
        step *= 0.5;
    }
    best
}
