//! The velocity that explains a cluster best.

use super::{
    score::{Fields, Score, Tolerance, score},
    sweeps::Sweep,
};

/// Fastest speed that is looked for, metres a second.
pub(super) const FASTEST: f32 = 40.0;
/// Displacement between two hypotheses of the coarse search, metres.
const STRIDE: f32 = 0.7;
/// Hypotheses of the coarse search that are followed.
const NUM_FOLLOWED: usize = 6;
/// Displacement at which following ends, metres.
const END: f32 = 0.04;
/// What a metre more between two sweeps takes from a guess's value.
const FARTHER: f64 = 0.04;
/// Most sites of a cluster that are moved.
pub(super) const MAX_SITES: usize = 48;

/// A velocity and what speaks for it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Guess {
    /// Metres a second along x and y of the clip frame.
    pub(super) velocity: [f32; 2],
    pub(super) score: Score,
}

/// The best of several guesses: of two that explain as much the slower one, for what is far away may be another thing.
///
/// # Formula
/// Largest `total - 0.04 / m * |v| seconds * pairs`, `seconds` the time to another sweep near by; the first where equal.
pub(super) fn better_of(guesses: impl Iterator<Item = Guess>, seconds: f32) -> Option<Guess> {
    let worth = |guess: &Guess| {
        let [x, y] = guess.velocity;
        let moved = (x * x + y * y).sqrt() * seconds;
        guess.score.total() - FARTHER * f64::from(moved) * guess.score.pairs
    };
    guesses.reduce(|best, next| if worth(&next) > worth(&best) { next } else { best })
}

/// Sites of a cluster that stand for all of them.
pub(super) fn some_of(sites: &[usize]) -> Vec<usize> {
    sites.iter().copied().step_by(sites.len().div_ceil(MAX_SITES).max(1)).collect()
}

/// The velocity that explains a cluster of sweep `from` best, were it to move; `None` where no other sweep can tell.
pub(super) fn search(sweeps: &[Sweep], from: usize, sites: &[usize]) -> Option<Guess> {
    let sites = some_of(sites);
    let others = &sweeps[from].others;
    let longest = |count: usize| others.iter().take(count).map(|other| other.seconds.abs()).fold(0.0, f32::max);
    let seconds = longest(2);
    if seconds <= 0.0 {
        return None;
    }
    let value = |tolerance: Tolerance| {
        let sites = &sites;
        move |velocity: [f32; 2]| score(sweeps, from, sites, velocity, Fields::Movable, tolerance).total()
    };
    let mut starts = coarse(STRIDE / seconds, value(Tolerance::COARSE));
    starts.truncate(NUM_FOLLOWED);
    let follow = |start: [f32; 2]| {
        let near = climb(start, 0.5 * STRIDE / seconds, 0.25 * STRIDE / seconds, value(Tolerance::MIDDLE));
        let step = 0.3 / longest(3);
        let near = climb(near, step, 0.5 * step, value(Tolerance::MIDDLE));
        let longest = longest(others.len());
        climb(near, 0.3 / longest, END / longest, value(Tolerance::FINE))
    };
    let guesses = starts.into_iter().map(follow).map(|velocity| Guess {
        velocity,
        score: score(sweeps, from, &sites, velocity, Fields::Movable, Tolerance::FINE),
    });
    better_of(guesses, seconds)
}

/// The local maxima among velocities `step` apart, best first.
fn coarse(step: f32, value: impl Fn([f32; 2]) -> f64) -> Vec<[f32; 2]> {
    let reach = super::grid::whole(FASTEST / step).max(1);
    let side = 2 * reach + 1;
    let velocity = |at: usize| [at % side, at / side].map(|k| (k as f32 - reach as f32) * step);
    let possible = |[x, y]: [f32; 2]| x * x + y * y <= FASTEST * FASTEST;
    let of = |at: usize| if possible(velocity(at)) { value(velocity(at)) } else { 0.0 };
    let values: Vec<f64> = (0..side * side).map(of).collect();
    let neighbours = |at: usize| {
        let (x, y) = (at % side, at / side);
        let rows = y.saturating_sub(1)..(y + 2).min(side);
        rows.flat_map(move |r| (x.saturating_sub(1)..(x + 2).min(side)).map(move |c| r * side + c))
    };
    let best = |at: &usize| {
        values[*at] > 0.0 && neighbours(*at).all(|n| values[n] < values[*at] || (values[n] == values[*at] && n >= *at))
    };
    let mut maxima: Vec<usize> = (0..side * side).filter(best).collect();
    maxima.sort_by(|&a, &b| values[b].total_cmp(&values[a]).then(a.cmp(&b)));
    maxima.into_iter().map(velocity).collect()
}

/// Where steps of shrinking length (metres a second) along the axes and diagonals no longer raise `value`.
pub(super) fn climb(start: [f32; 2], step: f32, end: f32, value: impl Fn([f32; 2]) -> f64) -> [f32; 2] {
    const AROUND: [[f32; 2]; 8] =
        [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0], [1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0]];
    /// Most steps of one length.
    const MAX_STEPS: usize = 12;
    let (mut best, mut highest, mut step) = (start, value(start), step);
    while step >= end && step > 0.0 {
        for _ in 0..MAX_STEPS {
            let before = best;
            for [x, y] in AROUND {
                let next = [before[0] + x * step, before[1] + y * step];
                let found = value(next);
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
