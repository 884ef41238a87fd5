//! `scaling.csv`: what each part cost at each size; `exponents.csv`: the laws that fit.

use super::{
    record::SizeRecord,
    table::{Growth, Row},
};

/// What each part cost at each size, a line for each.
pub(super) fn costs(rows: &[Row]) -> String {
    let mut page =
        "axis,points,height,width,part,units,work,seconds_median,seconds_q1,seconds_q3,memory_mb\n".to_owned();
    for row in rows {
        for point in &row.points {
            let seconds = |value: fn(&crate::statistics::Spread) -> f64| point.seconds.as_ref().map(value);
            let fields = [
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
            ];
            page += &(fields.join(",") + "\n");
        }
    }
    page
}

/// The laws, a line for each part along each axis.
pub(super) fn exponents(rows: &[Row]) -> String {
    let law = "work,exponent,standard_error,sizes".split(',');
    let names = ["time", "memory"].into_iter().flat_map(|kind| law.clone().map(move |name| format!("{kind}_{name}")));
    let mut page = format!("axis,part,{}\n", names.collect::<Vec<_>>().join(","));
    let values = |row: &Row, growth: Growth| {
        let law = growth.law;
        [
            growth.unit(row.units),
            text(law.map(|law| law.exponent)),
            text(law.map(|law| law.standard_error)),
            law.map_or(String::new(), |law| law.sizes.to_string()),
        ]
    };
    for row in rows {
        let names = [row.axis.name(), row.part.key()].map(str::to_owned);
        page += &([names.as_slice(), &values(row, row.time), &values(row, row.memory)].concat().join(",") + "\n");
    }
    page
}

/// Of each size, the memory that was predicted and that was measured.
pub(super) fn sizes(records: &[SizeRecord]) -> String {
    let mut page =
        "points,height,width,returns,pixels,lidar,background,sites,pairs,background_pairs,intersections,predicted_mb,peak_rss_mb\n"
            .to_owned();
    for SizeRecord { size, space, times, .. } in records {
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
        page += &(fields.join(",") + "\n");
    }
    page
}

fn text(value: Option<f64>) -> String {
    value.map_or(String::new(), |value| value.to_string())
}
