//! What each part cost at each size, and the laws that fit.

use serde::Serialize;

use super::{
    fit::{KINDS, PowerLaw, Rates, Sample},
    part::Part,
    plan::{Axis, Plan, Size},
    record::SizeRecord,
};
use crate::statistics::Quartiles;

/// Seconds below which starting and stopping decide.
const LEAST_SECONDS: f64 = 2e-3;
/// Memory below which pages and arenas decide, 10^6 bytes.
const LEAST_MB: f64 = 8.0;

/// A part along an axis.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PartRow {
    /// The axis.
    pub axis: Axis,
    /// The part.
    pub part: Part,
    /// What its work is made of.
    pub units: &'static [&'static str],
    /// The sizes, ascending.
    pub points: Vec<Point>,
    /// Its time (seconds).
    pub time: Growth,
    /// Its memory (10^6 bytes).
    pub memory: Growth,
}

/// How a cost grows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Growth {
    /// What a unit of work costs, by the sizes of both axes.
    pub rates: Rates,
    /// Cost against work, joined by the rates, along one axis; `None` where there is too little to say.
    pub law: Option<PowerLaw>,
}

/// A part at a size.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Point {
    /// The size.
    pub size: Size,
    /// How much there was to do, by the row's units.
    pub work: [usize; KINDS],
    /// What it took; `None` for a part that is not timed by itself.
    pub seconds: Option<Quartiles>,
    /// How far memory rose, 10^6 bytes; `None` where it is not known.
    pub memory_mb: Option<f64>,
}

/// A cost of a part at a size, where it is known.
type Cost = fn(&Point) -> Option<f64>;

impl PartRow {
    /// Whether the time or the memory grows clearly faster than the work.
    pub fn is_steep(&self) -> bool {
        [self.time, self.memory].into_iter().filter_map(|growth| growth.law).any(|law| law.is_steep())
    }
}

impl Growth {
    /// A point's work in units of the first kind that costs something.
    pub fn work(&self, point: &Point) -> f64 {
        self.rates.joined(point.work.map(|count| count as f64))
    }

    /// What such work is called.
    pub fn unit(&self, units: &[&str]) -> String {
        let (first, Rates(rates)) = (self.rates.first(), self.rates);
        let named = |(k, rate): (usize, f64)| {
            let unit = units.get(k)?;
            Some(if k == first { (*unit).to_owned() } else { format!("{:.2} {unit}", rate / rates[first]) })
        };
        let counted = rates.into_iter().enumerate().filter(|&(k, rate)| k == first || rate > 0.0);
        counted.filter_map(named).collect::<Vec<_>>().join(" + ")
    }
}

/// The rows of both axes, of parts that ran.
pub fn rows(plan: &Plan, records: &[SizeRecord]) -> Vec<PartRow> {
    let axis_rows = |axis: Axis| {
        let along: Vec<&SizeRecord> =
            plan.along(axis).iter().filter_map(|size| records.iter().find(|record| &record.size == size)).collect();
        Part::ALL.into_iter().map(move |part| row(axis, part, &along, records))
    };
    let ran = |row: &PartRow| row.points.iter().any(|point| point.seconds.is_some() || point.memory_mb.is_some());
    Axis::ALL.into_iter().flat_map(axis_rows).filter(ran).collect()
}

fn row(axis: Axis, part: Part, along: &[&SizeRecord], records: &[SizeRecord]) -> PartRow {
    let points: Vec<Point> = along.iter().map(|record| point(axis, part, record)).collect();
    let all: Vec<Point> = records.iter().map(|record| point(axis, part, record)).collect();
    let growth = |cost: Cost, floor: f64| {
        let counts = |point: &Point| Some((point.work.map(|count| count as f64), cost(point).filter(|c| *c >= floor)?));
        let rates = Rates::of(&all.iter().filter_map(counts).collect::<Vec<_>>());
        let sample = |point: &Point| counts(point).map(|(work, cost)| Sample { work: rates.joined(work), cost });
        Growth { rates, law: PowerLaw::of(&points.iter().filter_map(sample).collect::<Vec<_>>(), floor) }
    };
    let time = growth(|point| point.seconds.map(|seconds| seconds.median), LEAST_SECONDS);
    let memory = growth(|point| point.memory_mb, LEAST_MB);
    PartRow { axis, part, units: part.units(axis), time, memory, points }
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
        seconds: Quartiles::of(times.passes.iter().filter_map(|pass| pass.get(&part).copied())),
        memory_mb,
    }
}
