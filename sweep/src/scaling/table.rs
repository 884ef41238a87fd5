//! What each part cost at each size, and the laws that fit.

use serde::Serialize;

use super::{
    fit::{PowerLaw, Sample},
    part::Part,
    plan::{Axis, Plan, Size},
    record::SizeRecord,
};
use crate::statistics::Spread;

/// Seconds below which starting and stopping decide.
const LEAST_SECONDS: f64 = 2e-3;
/// Memory below which pages and arenas decide, 10^6 bytes.
const LEAST_MB: f64 = 8.0;

/// A part along an axis.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// The axis.
    pub axis: Axis,
    /// The part.
    pub part: Part,
    /// What its work is counted in.
    pub unit: &'static str,
    /// The sizes, ascending.
    pub points: Vec<Point>,
    /// Seconds against work; `None` where there is too little to say.
    pub time: Option<PowerLaw>,
    /// Memory against work.
    pub memory: Option<PowerLaw>,
}

/// A part at a size.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Point {
    /// The size.
    pub size: Size,
    /// How much there was to do.
    pub work: usize,
    /// What it took; `None` for a part that is not timed by itself.
    pub seconds: Option<Spread>,
    /// How far memory rose, 10^6 bytes; `None` where it is not known.
    pub memory_mb: Option<f64>,
}

impl Row {
    /// Whether the time or the memory grows clearly faster than the work.
    pub fn is_steep(&self) -> bool {
        [self.time, self.memory].into_iter().flatten().any(|law| law.is_steep())
    }
}

/// The rows of both axes, of parts that ran.
pub fn rows(plan: &Plan, records: &[SizeRecord]) -> Vec<Row> {
    let of = |axis: Axis| {
        let along: Vec<&SizeRecord> =
            plan.along(axis).iter().filter_map(|size| records.iter().find(|record| &record.size == size)).collect();
        Part::ALL.into_iter().map(move |part| row(axis, part, &along))
    };
    let ran = |row: &Row| row.points.iter().any(|point| point.seconds.is_some() || point.memory_mb.is_some());
    Axis::ALL.into_iter().flat_map(of).filter(ran).collect()
}

fn row(axis: Axis, part: Part, records: &[&SizeRecord]) -> Row {
    let points: Vec<Point> = records.iter().map(|record| point(axis, part, record)).collect();
    let law = |cost: &dyn Fn(&Point) -> Option<f64>, floor| {
        let sample = |point: &Point| Some(Sample { work: point.work as f64, cost: cost(point)? });
        PowerLaw::of(&points.iter().filter_map(sample).collect::<Vec<_>>(), floor)
    };
    let time = law(&|point| point.seconds.map(|seconds| seconds.median), LEAST_SECONDS);
    let memory = law(&|point| point.memory_mb, LEAST_MB);
    Row { axis, part, unit: part.unit(axis), time, memory, points }
}

fn point(axis: Axis, part: Part, record: &SizeRecord) -> Point {
    let SizeRecord { times, space, .. } = record;
    let memory_mb = if part == Part::Total {
        times.peak_rss_mb.zip(times.resident_mb).map(|(peak, before)| peak - before)
    } else {
        space.memory_mb.get(&part).copied()
    };
    Point {
        size: record.size,
        work: part.work(&space.work, axis),
        seconds: Spread::of(times.passes.iter().filter_map(|pass| pass.get(&part).copied())),
        memory_mb,
    }
}
