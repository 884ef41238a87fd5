//! From what moves to the returns of it.

use super::{
    movers::Mover,
    sites::{HEIGHTS, NONE},
    sweeps::Sweep,
};

/// How far around what is seen of a thing its shadow is its own, metres.
const AROUND: f32 = 0.15;
/// How far below the ground returns are still of it, metres: mirrored ones are lower.
const LOWEST: f32 = -1.0;
/// One in so many of its sites may stick out on either side.
const FEW: usize = 30;

/// The mover that each return of a sweep belongs to: by its site, or because it is under it, where its shadow is.
pub(super) fn spread(points: &[[f32; 3]], sweep: &Sweep, movers: &[Mover], index: usize) -> Vec<Option<usize>> {
    let mut of_site = vec![None; sweep.sites.len()];
    let mut footprints = Vec::new();
    for (label, mover) in movers.iter().enumerate() {
        let (sites, rigid) = &mover.parts[index];
        sites.iter().for_each(|&site| of_site[site] = Some(label));
        footprints.extend(
            Footprint::of(sites.iter().map(|&site| sweep.sites.sites[site].mean), rigid.velocity).map(|f| (label, f)),
        );
    }
    if footprints.is_empty() {
        return vec![None; points.len()];
    }
    let label_of = |(&point, &site): (&[f32; 3], &u32)| {
        if site != NONE {
            return of_site[site as usize];
        }
        let low = sweep.ground.above(point).is_some_and(|h| (LOWEST..HEIGHTS.start).contains(&h));
        let under = || footprints.iter().find(|(_, footprint)| footprint.holds(point)).map(|(label, _)| *label);
        if low { under() } else { None }
    };
    points.iter().zip(&sweep.sites.of_return).map(label_of).collect()
}

/// A rectangle on the ground, its sides along and across a direction.
#[derive(Clone, Copy, Debug)]
struct Footprint {
    along: [f32; 2],
    low: [f32; 2],
    high: [f32; 2],
}

impl Footprint {
    /// That of nearly all of some places, and a little more; `None` where there is none.
    fn of(places: impl Iterator<Item = [f32; 3]>, [x, y]: [f32; 2]) -> Option<Self> {
        let speed = x.hypot(y);
        let mut made = Self { along: [x / speed, y / speed], low: [0.0; 2], high: [0.0; 2] };
        let at: Vec<[f32; 2]> = places.map(|place| made.axes(place)).collect();
        for k in 0..2 {
            let mut along: Vec<f32> = at.iter().map(|at| at[k]).collect();
            along.sort_by(f32::total_cmp);
            let beyond = along.len() / FEW;
            made.low[k] = along.get(beyond)? - AROUND;
            made.high[k] = along.get(along.len().checked_sub(1 + beyond)?)? + AROUND;
        }
        Some(made)
    }

    fn axes(&self, [x, y, _]: [f32; 3]) -> [f32; 2] {
        let [a, b] = self.along;
        [x * a + y * b, y * a - x * b]
    }

    fn holds(&self, place: [f32; 3]) -> bool {
        let at = self.axes(place);
        (0..2).all(|k| (self.low[k]..=self.high[k]).contains(&at[k]))
    }
}
