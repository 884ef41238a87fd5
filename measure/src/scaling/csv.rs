//! `scaling.csv`: what each part cost at each size; `exponents.csv`: the laws that fit.

use lgs_pages::csv;

use super::{
    record::SizeRecord,
    table::{Growth, PartRow},
};

/// What each part cost at each size, a line for each.
pub(super) fn costs(rows: &[PartRow]) -> String {
    let head = [
        "axis",
        "points",
        "height",
        "width",
        "part",
        "units",
        "work",
        "seconds_median",
        "seconds_q1",
        "seconds_q3",
        "memory_mb",
    ];
    let lines = rows.iter().flat_map(|row| {
        row.points.iter().map(|point| {
            let seconds = |value: fn(&crate::statistics::Quartiles) -> f64| point.seconds.as_ref().map(value);
            vec![
                row.axis.name().to_owned(),
                point.size.points.to_string(),
                point.size.height.to_string(),
                point.size.width.to_string(),
                row.part.key().to_owned(),
                row.units.join(" + "),
                point.work.iter().take(row.units.len()).map(usize::to_string).collect::<Vec<_>>().join(" + "),
                text(seconds(|s| s.median)),
                text(seconds(|s| s.q1)),
                text(seconds(|s| s.q3)),
                text(point.memory_mb),
            ]
        })
    });
    csv(&head, lines)
}

/// The laws, a line for each part along each axis.
pub(super) fn exponents(rows: &[PartRow]) -> String {
    let law = "work,exponent,standard_error,sizes".split(',');
    let names = ["time", "memory"].into_iter().flat_map(|kind| law.clone().map(move |name| format!("{kind}_{name}")));
    let head: Vec<String> = ["axis", "part"].map(str::to_owned).into_iter().chain(names).collect();
    let values = |row: &PartRow, growth: Growth| {
        let law = growth.law;
        [
            growth.unit(row.units),
            text(law.map(|law| law.exponent)),
            text(law.map(|law| law.standard_error)),
            law.map_or(String::new(), |law| law.sizes.to_string()),
        ]
    };
    let lines = rows.iter().map(|row| {
        let names = [row.axis.name(), row.part.key()].map(str::to_owned);
        [names.as_slice(), &values(row, row.time), &values(row, row.memory)].concat()
    });
    csv(&head.iter().map(String::as_str).collect::<Vec<_>>(), lines)
}

/// Of each size, the memory that was predicted and that was measured.
pub(super) fn sizes(records: &[SizeRecord]) -> String {
    let head = [
        "points",
        "height",
        "width",
        "returns",
        "pixels",
        "lidar",
        "background",
        "sites",
        "pairs",
        "background_pairs",
        "intersections",
        "predicted_mb",
        "peak_rss_mb",
    ];
    let lines = records.iter().map(|SizeRecord { size, space, times, .. }| {
        let work = &space.work;
        let counts = [
            size.points,
            size.height,
            size.width,
            work.returns,
            work.pixels,
            work.lidar,
            work.background,
            work.sites,
            work.pairs,
            work.background_pairs,
            work.intersections,
        ];
        let mut fields: Vec<String> = counts.map(|count| count.to_string()).to_vec();
        fields.extend([space.predicted_mb.to_string(), text(times.peak_rss_mb)]);
        fields
    });
    csv(&head, lines)
}

fn text(value: Option<f64>) -> String {
    value.map_or(String::new(), |value| value.to_string())
}
