//! A sweep as registration sees it.

use rayon::prelude::*;

use super::{
    field::Field,
    ground::{Ground, Lowest},
    rays::Rays,
    score::{self, Fields, Tolerance},
    sites::{REACH, Sites},
};
use crate::points::PointCloud;

/// Seconds between sweeps over which a velocity counts as constant.
const STEADY: f32 = 0.65;
/// Seconds after which two sweeps have nothing to say about each other's velocities, even when none is nearer.
const APART: f32 = 1.1;
/// Sweeps that are nearer in time than this show the same moment, seconds.
const SAME_MOMENT: f32 = 5e-3;
/// How far a place may be from a site for the site to be seen there, metres: of what stands still, and of what may move.
const SEEN: [f32; 2] = [0.8, 1.4];
/// Value of the hypothesis that a cluster stands still above which nobody asks whether it moves.
const STANDS: f64 = 0.8;

/// Another sweep to compare with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Other {
    /// Its index.
    pub(super) sweep: usize,
    /// How much later it was taken, seconds.
    pub(super) seconds: f32,
}

/// A sweep as registration sees it.
#[derive(Clone, Debug)]
pub(super) struct Sweep {
    pub(super) sites: Sites,
    pub(super) rays: Rays,
    /// Everything that stands above the ground.
    pub(super) all: Field,
    /// Only what may move.
    pub(super) movable: Field,
    /// `[clusters]` which of them may move: where they are, other sweeps see less than they should.
    pub(super) may_move: Vec<bool>,
    /// Whom it is compared with, nearest in time first.
    pub(super) others: Vec<Other>,
    pub(super) ground: Ground,
}

/// The sweeps of a cloud.
///
/// # Shapes
/// `runs` `[S]` ranges of the cloud's points, `origins` `[S, 3]`.
pub(super) fn prepare(cloud: &PointCloud, runs: &[std::ops::Range<usize>], origins: &[[f32; 3]]) -> Vec<Sweep> {
    let times: Vec<f32> = runs.iter().map(|run| cloud.times[run.start]).collect();
    let points = |index: usize| &cloud.positions[runs[index].clone()];
    let lowest: Vec<Lowest> =
        (0..runs.len()).into_par_iter().map(|index| Lowest::of(points(index), origins[index], REACH)).collect();
    let of = |index: usize| {
        let (others, origin) = (others(&times, index), origins[index]);
        let ground = Ground::of(&lowest[index], others.iter().map(|other| &lowest[other.sweep]));
        let sites = Sites::of(points(index), origin, &ground);
        let [all, movable] = [Field::of(&sites, SEEN[0], |_| true), Field::empty(sites.grid)];
        Sweep { rays: Rays::of(points(index), origin), all, movable, may_move: Vec::new(), sites, others, ground }
    };
    let mut sweeps: Vec<Sweep> = (0..runs.len()).into_par_iter().map(of).collect();
    let stands = |sweep: usize, cluster: usize| {
        let here = score::score(
            &sweeps,
            sweep,
            &sweeps[sweep].sites.clusters[cluster].sites,
            [0.0; 2],
            Fields::All,
            Tolerance::FINE,
        );
        here.pairs > 0.0 && here.value() >= STANDS
    };
    let may_move: Vec<Vec<bool>> = (0..sweeps.len())
        .into_par_iter()
        .map(|sweep| (0..sweeps[sweep].sites.clusters.len()).map(|cluster| !stands(sweep, cluster)).collect())
        .collect();
    sweeps.par_iter_mut().zip(may_move).for_each(|(sweep, may_move)| {
        let wanted = |site: usize| sweep.sites.sites[site].cluster.is_some_and(|cluster| may_move[cluster]);
        sweep.movable = Field::of(&sweep.sites, SEEN[1], wanted);
        sweep.may_move = may_move;
    });
    sweeps
}

/// The sweeps that one is compared with, nearest in time first: on either side the nearest, the farthest over which velocities count as
/// constant, and one between them.
fn others(times: &[f32], index: usize) -> Vec<Other> {
    let of = |sweep: usize| Other { sweep, seconds: times[sweep] - times[index] };
    let mut apart: Vec<Other> = (0..times.len()).map(of).filter(|other| other.seconds.abs() >= SAME_MOMENT).collect();
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
