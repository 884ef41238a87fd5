//! Clusters of several sweeps that are one moving thing.

use rayon::prelude::*;

use super::{
    field::Found,
    score::{Fields, Score, Tolerance, score},
    search::{FASTEST, Guess, better_of, climb, search, some_of},
    sweeps::Sweep,
};

/// Value that a velocity must reach.
const CONVINCING: f64 = 0.5;
/// How much better than standing still it must be.
const BETTER: f64 = 0.2;
/// Share of the pairs of a site and another sweep that must speak against standing still.
const SEEN_THROUGH: f64 = 0.08;
/// What does without that.
const UNSEEN: Unseen = Unseen { sweeps: 3, value: 0.75, better: 0.27, still: 0.7, sites: 20, sites_of_one: 5 };
/// Sites that a track needs, and more of them for each metre that it moves between two sweeps: chance matches are as many as places.
const ENOUGH: [f32; 2] = [6.0, 4.0];
/// Least displacement between the first and the last sweep that sees a thing, metres.
const MOVED: f32 = 0.35;
/// Share of a cluster's sites that must land on another for the two to be one thing: of the seed's, and of the other's.
const SHARED: [f64; 2] = [0.3, 0.5];
/// How far from a site of another sweep one lands on it, metres.
const LANDED: f32 = 0.6;
/// Velocities of members that a track's search starts from.
const MAX_STARTS: usize = 3;
/// Distance from a moving thing up to which a cluster may be a part of it, metres.
const BESIDE: f32 = 3.0;
/// How much worse than its own best velocity that of the thing beside it may explain a part.
const LITTLE: f64 = 0.15;

/// What a velocity must reach where no sweep saw through the places of what moves.
struct Unseen {
    /// Sweeps that show it.
    sweeps: usize,
    /// Its value.
    value: f64,
    /// How much better than standing still it is.
    better: f64,
    /// Value of standing still, at most.
    still: f64,
    /// Sites in all, and for each cluster.
    sites: usize,
    sites_of_one: usize,
}

/// A cluster of a sweep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Member {
    pub(super) sweep: usize,
    pub(super) cluster: usize,
}

/// The velocities (metres a second, along x and y) of the clusters of every sweep; zero for those that stand still.
///
/// # Shapes
/// `[sweeps][clusters]`.
pub(super) fn velocities(sweeps: &[Sweep]) -> Vec<Vec<[f32; 2]>> {
    let movable = |sweep: usize| {
        let clusters = sweeps[sweep].may_move.iter().enumerate().filter(|&(_, may)| *may);
        clusters.map(move |(cluster, _)| Member { sweep, cluster })
    };
    let members: Vec<Member> = (0..sweeps.len()).flat_map(movable).collect();
    let guess = |&member: &Member| {
        let sites = sites_of(sweeps, member);
        let guess = search(sweeps, member.sweep, sites)?;
        let still = score(sweeps, member.sweep, &some_of(sites), [0.0; 2], Fields::All, Tolerance::FINE);
        Some(Seed { member, guess, gain: guess.score.total() - still.total() })
    };
    let guesses: Vec<Option<Seed>> = members.par_iter().map(guess).collect();
    let mut seeds: Vec<Seed> = guesses.into_iter().flatten().filter(|seed| seed.gain > 0.0).collect();
    seeds.sort_by(|a, b| b.gain.total_cmp(&a.gain)); // stable: by sweep and cluster where equal
    let mut moving = Moving {
        found: sweeps.iter().map(|sweep| vec![[0.0; 2]; sweep.may_move.len()]).collect(),
        free: sweeps.iter().map(|sweep| sweep.may_move.clone()).collect(),
    };
    for seed in &seeds {
        if !moving.is_free(seed.member) {
            continue;
        }
        if let Some(velocity) = moving.beside(sweeps, seed) {
            moving.take(seed.member, velocity);
            continue;
        }
        let members = track(sweeps, seed, &moving);
        let Some(velocity) = joint(sweeps, seed, &members, &seeds) else { continue };
        for member in members {
            moving.take(member, velocity);
        }
    }
    for seed in &seeds {
        if moving.is_free(seed.member)
            && let Some(velocity) = moving.beside(sweeps, seed)
        {
            moving.take(seed.member, velocity);
        }
    }
    moving.found
}

/// What is known to move so far.
struct Moving {
    /// `[sweeps][clusters]` metres a second.
    found: Vec<Vec<[f32; 2]>>,
    /// `[sweeps][clusters]` which may still be found to move.
    free: Vec<Vec<bool>>,
}

impl Moving {
    fn is_free(&self, member: Member) -> bool {
        self.free[member.sweep][member.cluster]
    }

    fn take(&mut self, member: Member, velocity: [f32; 2]) {
        self.found[member.sweep][member.cluster] = velocity;
        self.free[member.sweep][member.cluster] = false;
    }

    /// The velocity of a moving thing beside a cluster, or of one in other sweeps that it lands on, where that explains the cluster, too.
    fn beside(&self, sweeps: &[Sweep], seed: &Seed) -> Option<[f32; 2]> {
        let Member { sweep, cluster } = seed.member;
        let clusters = &sweeps[sweep].sites.clusters;
        let own = some_of(&clusters[cluster].sites);
        let near = |other: usize| clusters[cluster].distance(&clusters[other]) <= BESIDE;
        let mut velocities: Vec<[f32; 2]> =
            self.found[sweep].iter().enumerate().filter(|&(other, _)| near(other)).map(|(_, v)| *v).collect();
        for other in &sweeps[sweep].others {
            let moved = seed.guess.velocity.map(|v| v * other.seconds);
            let landed = landings(&sweeps[sweep], &own, moved, &sweeps[other.sweep]);
            let enough = |&(_, &count): &(&[f32; 2], &usize)| count as f64 >= SHARED[0] * own.len() as f64;
            velocities.extend(self.found[other.sweep].iter().zip(&landed).filter(enough).map(|(v, _)| *v));
        }
        let still = seed.guess.score.total() - seed.gain;
        let wanted = CONVINCING.max(seed.guess.score.value() - LITTLE);
        let of = |velocity: [f32; 2]| Guess {
            velocity,
            score: score(sweeps, sweep, &own, velocity, Fields::Movable, Tolerance::FINE),
        };
        let explains =
            |guess: &Guess| guess.score.value() >= wanted && guess.score.total() - still >= BETTER * guess.score.pairs;
        let guesses = velocities.into_iter().filter(|v| *v != [0.0; 2]).map(of).filter(explains);
        let best = guesses.reduce(|best, next| if next.score.total() > best.score.total() { next } else { best })?;
        Some(best.velocity)
    }
}

/// A cluster with the velocity that explains it best, and how much more it explains than standing still.
#[derive(Clone, Copy, Debug)]
struct Seed {
    member: Member,
    guess: Guess,
    gain: f64,
}

fn sites_of(sweeps: &[Sweep], member: Member) -> &[usize] {
    &sweeps[member.sweep].sites.clusters[member.cluster].sites
}

/// The seed's cluster and those of other sweeps that it lands on, or that land on it.
fn track(sweeps: &[Sweep], seed: &Seed, moving: &Moving) -> Vec<Member> {
    let Member { sweep: own, cluster } = seed.member;
    let sites = some_of(sites_of(sweeps, seed.member));
    let mut members = vec![seed.member];
    for other in &sweeps[own].others {
        let moved = seed.guess.velocity.map(|v| v * other.seconds);
        let landed = landings(&sweeps[own], &sites, moved, &sweeps[other.sweep]);
        let back = moved.map(|v| -v);
        for (index, &count) in landed.iter().enumerate().filter(|&(_, count)| *count > 0) {
            let member = Member { sweep: other.sweep, cluster: index };
            let theirs = some_of(sites_of(sweeps, member));
            let returned = landings(&sweeps[other.sweep], &theirs, back, &sweeps[own])[cluster];
            let shares = [count as f64 / sites.len() as f64, returned as f64 / theirs.len() as f64];
            if (shares[0] >= SHARED[0] || shares[1] >= SHARED[1]) && moving.is_free(member) {
                members.push(member);
            }
        }
    }
    members
}

/// How many moved sites of a sweep land on each cluster of another.
///
/// # Shapes
/// `moved` metres; result `[clusters]` of `to`.
fn landings(from: &Sweep, sites: &[usize], moved: [f32; 2], to: &Sweep) -> Vec<usize> {
    let mut counts = vec![0; to.may_move.len()];
    for &site in sites {
        let [x, y, _] = from.sites.sites[site].mean;
        let landed = match to.movable.nearest(x + moved[0], y + moved[1]) {
            Found::Site { index, square } if square <= LANDED * LANDED => to.sites.sites[index].cluster,
            _ => None,
        };
        if let Some(cluster) = landed {
            counts[cluster] += 1;
        }
    }
    counts
}

/// The velocity of a track; `None` where it may as well stand still.
fn joint(sweeps: &[Sweep], seed: &Seed, members: &[Member], seeds: &[Seed]) -> Option<[f32; 2]> {
    let sites: Vec<(usize, Vec<usize>)> =
        members.iter().map(|&member| (member.sweep, some_of(sites_of(sweeps, member)))).collect();
    let num_sweeps = {
        let mut seen: Vec<usize> = members.iter().map(|member| member.sweep).collect();
        seen.sort_unstable();
        seen.dedup();
        seen.len()
    };
    if num_sweeps < 2 {
        return None;
    }
    let total = |velocity: [f32; 2], fields: Fields| {
        let of = |(sweep, sites): &(usize, Vec<usize>)| score(sweeps, *sweep, sites, velocity, fields, Tolerance::FINE);
        sites.iter().map(of).fold(Score::default(), Score::and)
    };
    let others = &sweeps[seed.member.sweep].others;
    let longest = others.iter().map(|other| other.seconds.abs()).fold(0.0, f32::max);
    let starts = seeds.iter().filter(|other| members.contains(&other.member)).take(MAX_STARTS);
    let shortest = others.first().map_or(0.0, |other| other.seconds.abs());
    let of = |start: &Seed| {
        let value = |velocity: [f32; 2]| total(velocity, Fields::Movable).total();
        let velocity = climb(start.guess.velocity, 0.2 / longest, 0.02 / longest, value);
        Guess { velocity, score: total(velocity, Fields::Movable) }
    };
    let best = better_of(starts.map(of), shortest)?;
    let still = total([0.0; 2], Fields::All);
    let num_sites: usize = sites.iter().map(|(_, sites)| sites.len()).sum();
    let speed = length(best.velocity);
    let value = best.score.value();
    let seen = still.through >= SEEN_THROUGH * still.pairs
        || (num_sweeps >= UNSEEN.sweeps
            && num_sites >= UNSEEN.sites.max(UNSEEN.sites_of_one * members.len())
            && value >= UNSEEN.value
            && value - still.value() >= UNSEEN.better
            && still.value() <= UNSEEN.still);
    let enough = num_sites as f32 >= ENOUGH[0] + ENOUGH[1] * speed * shortest;
    let better = value >= CONVINCING && value - still.value() >= BETTER;
    (better && seen && enough && speed * longest >= MOVED && speed <= FASTEST).then_some(best.velocity)
}

fn length([x, y]: [f32; 2]) -> f32 {
    (x * x + y * y).sqrt()
}
