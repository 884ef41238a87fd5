//! What other sweeps and the images say of a velocity.

use super::{eyes::Eyes, rays::Look, sites::Site, sweeps::Sweep};

/// How much less it counts to land on something that surely stands still.
const STANDS: f32 = 0.0;
/// What a sweep that cannot see a place counts.
const HIDDEN: f32 = 0.5;
/// What colours count beside places.
const COLOURS: f32 = 1.0;

/// Scores velocities by what other sweeps and the images show.
#[derive(Clone, Debug)]
pub(super) struct Scorer<'a> {
    pub(super) sweeps: &'a [Sweep],
    pub(super) eyes: &'a Eyes<'a>,
}

/// How the sites of two sweeps are matched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Matching {
    /// Times the usual distance up to which a place is the same.
    pub(super) tolerance: f32,
    /// How many of the nearest other sweeps are asked.
    pub(super) others: usize,
    /// Whether images are asked.
    pub(super) colours: bool,
}

impl Matching {
    /// To find what is roughly right.
    pub(super) const ROUGH: Self = Self { tolerance: 2.0, others: 3, colours: false };
    /// To decide.
    pub(super) const FINE: Self = Self { tolerance: 1.0, others: usize::MAX, colours: true };
}

impl Scorer<'_> {
    /// How well a velocity explains what is seen of a site: 1 where all find it again, -1 where all see through it; less where its colours change.
    pub(super) fn score(&self, from: usize, site: usize, velocity: [f32; 2], matching: Matching) -> f32 {
        let own = &self.sweeps[from];
        let Site { mean, time, range, .. } = own.sites.sites[site];
        let moving = velocity != [0.0; 2];
        let (mut sum, mut known) = (0.0, 0.0);
        for other in own.others.iter().take(matching.others) {
            let there = &self.sweeps[other.sweep];
            // A thing is seen at about the same place of each turn of the sensor, so the sweeps' own times are what is between.
            let place = [mean[0] + velocity[0] * other.seconds, mean[1] + velocity[1] * other.seconds, mean[2]];
            if let Some((found, near)) = there.nearest(place, range, matching.tolerance) {
                let share = if moving { 1.0 - STANDS * there.still[found].share } else { 1.0 };
                sum += near * share;
                known += 1.0;
            } else {
                match there.rays.look(place) {
                    Look::Through => {
                        sum -= 1.0;
                        known += 1.0;
                    }
                    Look::Hidden => known += 1.0 - HIDDEN,
                    Look::Unknown => known += 1.0,
                }
            }
        }
        let places = if known > 0.0 { sum / known } else { 0.0 };
        if matching.colours { places - COLOURS * self.eyes.differ(from, mean, time, velocity) } else { places }
    }

    /// How many of the other sweeps that know the place of a site that moves so see through it, and how many know it.
    pub(super) fn lost(&self, from: usize, site: usize, velocity: [f32; 2]) -> [usize; 2] {
        let own = &self.sweeps[from];
        let Site { mean, range, .. } = own.sites.sites[site];
        let (mut through, mut known) = (0, 0);
        for other in &own.others {
            let there = &self.sweeps[other.sweep];
            let place = [mean[0] + velocity[0] * other.seconds, mean[1] + velocity[1] * other.seconds, mean[2]];
            if there.nearest(place, range, 1.0).is_some() {
                known += 1;
            } else if there.rays.look(place) == Look::Through {
                through += 1;
                known += 1;
            }
        }
        [through, known]
    }

    /// The sum of the scores of some sites.
    pub(super) fn total(&self, from: usize, sites: &[usize], velocity: [f32; 2], matching: Matching) -> f64 {
        sites.iter().map(|&site| f64::from(self.score(from, site, velocity, matching))).sum()
    }
}
