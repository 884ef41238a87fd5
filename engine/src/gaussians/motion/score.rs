//! How well a velocity explains what other sweeps see of some sites.

use super::{field::Found, sites::Site, sweeps::Sweep};

/// Distance from the sensor over which tolerances double, metres: far away returns are sparse.
const DOUBLES: f32 = 60.0;

/// What moved sites may land on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fields {
    /// Everything.
    All,
    /// What may move.
    Movable,
}

/// How far from a site one may land.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Tolerance {
    /// Metres at which support ends, next to the sensor.
    metres: f32,
    /// How many of the nearest other sweeps are asked.
    others: usize,
    /// Whether what was seen through counts against the velocity.
    through: bool,
}

impl Tolerance {
    /// To find what is roughly right.
    pub(super) const COARSE: Self = Self { metres: 1.0, others: 2, through: false };
    /// To come nearer.
    pub(super) const MIDDLE: Self = Self { metres: 0.6, others: 3, through: true };
    /// To decide.
    pub(super) const FINE: Self = Self { metres: 0.3, others: usize::MAX, through: true };
}

/// What other sweeps say of a velocity.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Score {
    /// Sites that were found again, each by how near.
    pub(super) support: f64,
    /// Sites at whose places other sweeps saw that nothing is there.
    pub(super) through: f64,
    /// Pairs of a site and another sweep that could have seen it.
    pub(super) pairs: f64,
}

impl Score {
    /// 1 where every sweep confirms, -1 where every sweep contradicts; 0 where nobody knows anything.
    pub(super) fn value(&self) -> f64 {
        (self.support - self.through) / self.pairs.max(1.0)
    }

    /// What `value` sums up over the pairs.
    pub(super) fn total(&self) -> f64 {
        self.support - self.through
    }

    /// The score of two groups of sites.
    pub(super) fn and(self, other: Self) -> Self {
        Self {
            support: self.support + other.support,
            through: self.through + other.through,
            pairs: self.pairs + other.pairs,
        }
    }
}

/// The score of a velocity (metres a second) of the sites `sites` of sweep `from`.
///
/// # Formula
/// `sum_{site, sweep} max(0, 1 - (d / tolerance)^2)`, `d` the distance of the moved site from the nearest one of that sweep; where that
/// is 0 and the sweep saw through the place, one is taken off.
pub(super) fn score(
    sweeps: &[Sweep],
    from: usize,
    sites: &[usize],
    velocity: [f32; 2],
    fields: Fields,
    tolerance: Tolerance,
) -> Score {
    let own = &sweeps[from];
    let mut sum = Score::default();
    for other in own.others.iter().take(tolerance.others) {
        let seen = &sweeps[other.sweep];
        let field = if fields == Fields::All { &seen.all } else { &seen.movable };
        let moved = velocity.map(|v| v * other.seconds);
        for &site in sites {
            let Site { mean: [x, y, z], range, .. } = own.sites.sites[site];
            let limit = tolerance.metres * (1.0 + range / DOUBLES);
            let place = [x + moved[0], y + moved[1], z];
            let near = match field.nearest(place[0], place[1]) {
                Found::Outside => continue,
                Found::Site { square, .. } => (1.0 - square / (limit * limit)).max(0.0),
                Found::Nothing => 0.0,
            };
            sum.pairs += 1.0;
            sum.support += f64::from(near);
            if near == 0.0 && tolerance.through && seen.rays.through(place) {
                sum.through += 1.0;
            }
        }
    }
    sum
}
