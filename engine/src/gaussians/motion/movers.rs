//! Things that move: which sites of which sweeps they are, and how they move.

use super::{
    region::{Region, grow},
    rigid::{Rigid, refined},
    score::{Matching, Scorer},
    search::{AROUND, FASTEST, candidates, climb, seeds, some_of},
    sweeps::{Other, Sweep},
};
use crate::parallel;

/// Seeds that are looked at side by side, the largest first: what they are found to be a part of is then known to the others.
const AT_ONCE: usize = 12;
/// Most sites of each sweep by which the velocity of a thing is found.
const MAX_SITES: usize = 80;
/// Rounds in which region and velocity are found by each other.
const ROUNDS: usize = 2;
/// Displacements of the first and last steps of that search, over the time to the farthest sweep, metres.
const STEPS: [f32; 2] = [0.15, 0.02];
/// Least displacement between the first and the last sweep that sees a thing, metres: what stands is seen so exactly.
const MOVED: f32 = 0.3;
/// How much better than standing still a velocity must be: in the mean of the sites that surely move, and of all.
const GAIN: [f64; 2] = [0.3, 0.05];
/// Share of the sites that must surely move, and fewest of them.
const SURE: (f64, usize) = (0.1, 8);
/// More of them for each metre that the thing moves to the nearest sweep: there are more places to land on by chance.
const FARTHER: f64 = 4.0;
/// Share of its sites in the sweep with most of them that a thing must have in another one.
const AGAIN: f64 = 0.25;
/// The same where there is only one other.
const AGAIN_IN_ONE: f64 = 0.5;
/// Times that differ by less are the same, seconds.
const SAME_TIME: f32 = 1e-3;
/// Sites up to which a thing, and mean gain up to which any, must be seen again by two other sweeps, where there are as many.
const DOUBTFUL: (usize, f64) = (40, 0.6);
/// Largest share of the places at which it would be that other sweeps see through.
const LOST: f64 = 0.15;

/// Something that moves.
#[derive(Clone, Debug)]
pub(super) struct Mover {
    /// `[sweeps]` its sites in each, and how it moves there.
    pub(super) parts: Vec<(Vec<usize>, Rigid)>,
}

/// A seed with the velocity that explains most.
#[derive(Debug)]
struct Guess {
    sweep: usize,
    velocity: [f32; 2],
    region: Region,
}

/// What is looked for, and what is left.
struct Search<'a> {
    scorer: &'a Scorer<'a>,
    /// `[sweeps][sites]` scores of standing still.
    zero: Vec<Vec<f32>>,
    /// `[sweeps][sites]` which of them are of nothing that moves yet.
    free: Vec<Vec<bool>>,
}

/// What moves in these sweeps.
pub(super) fn movers(scorer: &Scorer<'_>) -> Vec<Mover> {
    let sweeps = scorer.sweeps;
    let still = |sweep: usize| {
        let site_score = |site: usize| scorer.score(sweep, site, [0.0; 2], Matching::FINE);
        parallel::map(sweeps[sweep].sites.len(), 1, &site_score)
    };
    let mut search = Search {
        scorer,
        zero: (0..sweeps.len()).map(still).collect(),
        free: sweeps.iter().map(|sweep| vec![true; sweep.sites.len()]).collect(),
    };
    let of_sweep = |(index, sweep): (usize, &Sweep)| {
        seeds(&sweep.sites, &sweep.still).into_iter().map(|seed| (index, seed)).collect::<Vec<_>>()
    };
    let mut left: Vec<(usize, Vec<usize>)> = sweeps.iter().enumerate().flat_map(of_sweep).collect();
    left.sort_by_key(|(_, seed)| std::cmp::Reverse(seed.len())); // stable: by sweep and place where equal
    let mut found = Vec::new();
    while !left.is_empty() {
        let some: Vec<(usize, Vec<usize>)> = left.drain(..AT_ONCE.min(left.len())).collect();
        let mut guesses: Vec<Guess> = parallel::filter_map(some.len(), 1, &|k| search.guess(some[k].0, &some[k].1));
        guesses.sort_by(|a, b| b.region.gain.total_cmp(&a.region.gain));
        for guess in guesses {
            if search.is_free(guess.sweep, &guess.region.sites)
                && let Some(mover) = search.follow(&guess)
            {
                for (free, (sites, _)) in search.free.iter_mut().zip(&mover.parts) {
                    sites.iter().for_each(|&site| free[site] = false);
                }
                found.push(mover);
            }
        }
        left.retain(|(sweep, seed)| search.is_free(*sweep, seed));
    }
    found
}

impl Search<'_> {
    /// Whether at least half of some sites are of nothing that moves yet.
    fn is_free(&self, sweep: usize, sites: &[usize]) -> bool {
        2 * sites.iter().filter(|&&site| self.free[sweep][site]).count() >= sites.len().max(1)
    }

    fn grown(&self, sweep: usize, velocity: [f32; 2], seeds: &[usize]) -> Region {
        grow(self.scorer, &self.zero[sweep], sweep, velocity, seeds, &self.free[sweep])
    }

    /// The velocity of a seed by which most around it is explained better than by standing still.
    fn guess(&self, sweep: usize, seed: &[usize]) -> Option<Guess> {
        let grown = |velocity: [f32; 2]| Guess { sweep, velocity, region: self.grown(sweep, velocity, seed) };
        let better = |a: Guess, b: Guess| if b.region.gain > a.region.gain { b } else { a };
        let velocities = candidates(self.scorer, sweep, seed);
        let grown: Vec<Guess> = parallel::map(velocities.len(), 1, &|k| grown(velocities[k]));
        grown.into_iter().reduce(better).filter(|guess| guess.region.sure > 0)
    }

    /// The thing in all sweeps, with the motions that explain it best; `None` where it may as well stand still.
    fn follow(&self, guess: &Guess) -> Option<Mover> {
        let (scorer, sweeps) = (self.scorer, self.scorer.sweeps);
        let own = &sweeps[guess.sweep];
        let last = own.others.iter().map(|other| other.seconds.abs()).fold(0.0, f32::max);
        let mut velocity = guess.velocity;
        let mut regions: Vec<Region> = vec![Region::default(); sweeps.len()];
        regions[guess.sweep] = guess.region.clone();
        for round in 0..=ROUNDS {
            // Every sweep over which the velocity holds, not only those that are compared.
            let before = &regions[guess.sweep];
            let again = |index: usize| {
                let other = &sweeps[index];
                let seconds = other.time - own.time;
                let compared = index != guess.sweep && seconds.abs() <= last + SAME_TIME;
                compared.then(|| {
                    let seeds = landed(own, &before.sites, other, velocity.map(|v| v * seconds));
                    self.grown(index, velocity, &seeds)
                })
            };
            let again: Vec<Option<Region>> = parallel::map(sweeps.len(), 1, &again);
            for (region, again) in regions.iter_mut().zip(again) {
                if let Some(again) = again {
                    *region = again;
                }
            }
            if round == ROUNDS {
                break;
            }
            let some: Vec<(usize, Vec<usize>)> =
                regions.iter().map(|region| some_of(&region.sites, MAX_SITES)).enumerate().collect();
            let total =
                |v: [f32; 2]| some.iter().map(|(sweep, sites)| scorer.total(*sweep, sites, v, Matching::FINE)).sum();
            velocity = climb(velocity, [STEPS[0] / last; 2], STEPS[1] / STEPS[0], &AROUND, total);
            regions[guess.sweep] = self.grown(guess.sweep, velocity, &regions[guess.sweep].sites);
        }
        let speed = velocity[0].hypot(velocity[1]);
        let moves = (MOVED / last..=FASTEST).contains(&speed) && self.convinces(&regions, velocity, &own.others);
        moves.then(|| {
            let part = |sweep: usize| refined(scorer, sweep, &regions[sweep].sites, velocity);
            let rigid: Vec<Rigid> = parallel::map(regions.len(), 1, &part);
            Mover { parts: regions.into_iter().map(|region| region.sites).zip(rigid).collect() }
        })
    }

    /// Whether these regions surely move so: enough of them, seen again by enough of the other sweeps, and nowhere seen through.
    fn convinces(&self, regions: &[Region], velocity: [f32; 2], others: &[Other]) -> bool {
        let sites = || {
            regions.iter().enumerate().flat_map(|(sweep, region)| region.sites.iter().map(move |&site| (sweep, site)))
        };
        let count = sites().count() as f64;
        let sure: usize = regions.iter().map(|region| region.sure).sum();
        let gain: f64 = regions.iter().map(|region| region.gain).sum();
        let moved = velocity[0].hypot(velocity[1]) * others.first().map_or(0.0, |other| other.seconds.abs());
        let most = regions.iter().map(|region| region.sure).max().unwrap_or_default() as f64;
        let again = if others.len() < 2 { AGAIN_IN_ONE } else { AGAIN };
        let seen = regions.iter().filter(|region| region.sure as f64 >= again * most).count();
        let doubtful = sure <= DOUBTFUL.0 || gain <= DOUBTFUL.1 * sure as f64;
        let wanted = if doubtful { others.len().min(2) + 1 } else { 2 };
        let lost = sites().map(|(sweep, site)| self.scorer.lost(sweep, site, velocity));
        let [through, known] = lost.fold([0, 0], |a, b| [a[0] + b[0], a[1] + b[1]]);
        seen >= wanted
            && sure as f64 >= SURE.1 as f64 + FARTHER * f64::from(moved)
            && sure as f64 >= SURE.0 * count
            && gain >= (GAIN[0] * sure as f64).max(GAIN[1] * count)
            && through as f64 <= LOST * known as f64
    }
}

/// The sites of another sweep on which those of one land.
fn landed(from: &Sweep, sites: &[usize], to: &Sweep, moved: [f32; 2]) -> Vec<usize> {
    let land = |&site: &usize| {
        let site = &from.sites.sites[site];
        let [x, y, z] = site.mean;
        to.nearest([x + moved[0], y + moved[1], z], site.range, 1.5).map(|(site, _)| site)
    };
    let mut landed: Vec<usize> = sites.iter().filter_map(land).collect();
    landed.sort_unstable();
    landed.dedup();
    landed
}
