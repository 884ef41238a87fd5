//! `scaling.html`: one file that shows what was measured, without anything from elsewhere.

use lgs_formats::casts::rounded;
use lgs_pages::{document, escape, or_dash, section, table, thousands};

use super::{
    fit::{PowerLaw, STEEP},
    part::Part,
    plan::Axis,
    plot::{Cost, exponent, svg},
    record::{FailedSize, SizeRecord},
    table::PartRow,
};
use crate::{machine::Machine, statistics::Quartiles, sweep::report::STYLE as SHARED};

const STYLE: &str = include_str!("style.css");

/// What the page shows.
#[derive(Clone, Copy, Debug)]
pub(super) struct Page<'a> {
    pub(super) machine: &'a Machine,
    pub(super) rows: &'a [PartRow],
    pub(super) records: &'a [SizeRecord],
    pub(super) failed: &'a [FailedSize],
}

/// The page.
pub(super) fn html(page: &Page<'_>) -> String {
    let mut body = header(page);
    for axis in Axis::ALL {
        let rows: Vec<&PartRow> = page.rows.iter().filter(|row| row.axis == axis).collect();
        let title = match axis {
            Axis::Points => "More points, images of one size",
            Axis::Pixels => "More pixels, clips of as many points",
        };
        body += &section(title, &law_table(&rows));
    }
    body += &section("Memory: what the engine says beforehand, and what a run needs", &size_table(page.records));
    body += &section("Time against work", &plots(page.rows, Cost::Seconds));
    body += &section("Memory against work", &plots(page.rows, Cost::Memory));
    if !page.failed.is_empty() {
        let line = |failed: &FailedSize| format!("<li>{}: {}</li>\n", escape(&failed.size), escape(&failed.reason));
        let lines: String = page.failed.iter().map(line).collect();
        body += &section("Could not be measured", &format!("<ul>\n{lines}</ul>\n"));
    }
    document("How cost grows – LGS", &format!("{SHARED}{STYLE}"), &body, "")
}

fn header(page: &Page<'_>) -> String {
    let Machine { version, build, target, cpu, cores, threads, .. } = page.machine;
    let cpu = cpu.as_deref().unwrap_or("a processor without a name");
    let passes = || page.records.iter().map(|record| record.times.passes.len());
    let steep: Vec<String> = page.rows.iter().filter(|row| row.is_steep()).map(named).collect();
    let verdict = if steep.is_empty() {
        format!("No exponent is above {STEEP}.")
    } else {
        format!("Above {STEEP}: {}.", steep.join(", "))
    };
    format!(
        "<header>\n<p class=\"brand\">LGS sweep</p>\n<h1>How cost grows</h1>\n<p>{}, {threads} of {cores} cores, {} · version {} \
         ({})</p>\n<p>One procedural street, seen by finer and coarser sensors: <span class=\"points-word\">more points</span> with \
         images of one size, <span class=\"pixels-word\">more pixels</span> with one number of points; each size in processes of its \
         own. Times: median and quartiles of {} to {} runs after one that does not count. Memory of a part: how far resident memory \
         rises above what it was when the part begins, in a run that gives freed pages back; of the total: above what the program \
         with its weights takes. Work of several kinds is joined by what a unit of each costs, by least \
         squares over all sizes. Lines: cost = a · work<sup>b</sup>, by least squares of the logarithms over the sizes that are above \
         fixed costs; b with its standard error.</p>\n<p class=\"said\">{verdict}</p>\n</header>\n",
        escape(cpu),
        escape(target),
        escape(version),
        escape(build),
        passes().min().unwrap_or(0),
        passes().max().unwrap_or(0),
    )
}

fn named(row: &PartRow) -> String {
    let law_of = |kind: &str, law: Option<PowerLaw>| {
        law.filter(PowerLaw::is_steep)
            .map(|law| format!("{} of {} ({kind}, {})", row.part.key(), row.axis.name(), exponent(&law)))
    };
    [law_of("time", row.time.law), law_of("memory", row.memory.law)]
        .into_iter()
        .flatten()
        .collect::<Vec<_>>()
        .join(", ")
}

fn law_table(rows: &[&PartRow]) -> String {
    let head = [
        "part",
        "work in",
        "work from",
        "to",
        "seconds from",
        "to",
        "exponent",
        "MB from",
        "to",
        "exponent",
        "against",
    ];
    let mut body = String::new();
    for row in rows {
        let (Some(first), Some(last)) = (row.points.first(), row.points.last()) else { continue };
        let seconds = |spread: Option<Quartiles>| spread.map_or("–".to_owned(), |s| format!("{:.4}", s.median));
        body += &format!("<tr><th>{}</th><td class=\"text\">{}</td>", row.part.key(), row.time.unit(row.units));
        let work = |point| thousands(rounded(row.time.work(point)));
        for cell in [
            work(first),
            work(last),
            seconds(first.seconds),
            seconds(last.seconds),
            law(row.time.law),
            or_dash(first.memory_mb, 0),
            or_dash(last.memory_mb, 0),
            law(row.memory.law),
        ] {
            body += &format!("<td>{cell}</td>");
        }
        let against = row.memory.law.map_or("–".to_owned(), |_| row.memory.unit(row.units));
        body += &format!("<td class=\"text\">{against}</td></tr>\n");
    }
    table(&head, &body)
}

fn law(law: Option<PowerLaw>) -> String {
    law.map_or("–".to_owned(), |law| {
        let class = if law.is_steep() { " class=\"steep\"" } else { "" };
        format!("<span{class}>{}</span>", exponent(&law))
    })
}

fn size_table(records: &[SizeRecord]) -> String {
    let head = [
        "size",
        "returns",
        "Gaussians",
        "sites",
        "intersections",
        "runs",
        "seconds of a run",
        "predicted MB",
        "peak MB",
        "times",
    ];
    let mut body = String::new();
    for SizeRecord { size, times, space, .. } in records {
        let seconds = Quartiles::of(times.passes.iter().filter_map(|pass| pass.get(&Part::Total).copied()));
        body += &format!("<tr><th>{size}</th>");
        for cell in [
            thousands(space.work.returns),
            thousands(space.work.gaussians()),
            thousands(space.work.sites),
            thousands(space.work.intersections),
            times.passes.len().to_string(),
            or_dash(seconds.map(|s| s.median), 2),
            or_dash(Some(space.predicted_mb), 1),
            or_dash(times.peak_rss_mb, 0),
            or_dash(times.peak_rss_mb.map(|peak| peak / space.predicted_mb), 1),
        ] {
            body += &format!("<td>{cell}</td>");
        }
        body += "</tr>\n";
    }
    table(&head, &body)
}

fn plots(rows: &[PartRow], cost: Cost) -> String {
    let mut all = String::new();
    for part in Part::ALL {
        let of_part: Vec<&PartRow> = rows.iter().filter(|row| row.part == part).collect();
        let alike = of_part.iter().all(|row| row.units == of_part[0].units);
        let groups: Vec<&[&PartRow]> = if alike { vec![of_part.as_slice()] } else { of_part.chunks(1).collect() };
        all += &groups.into_iter().map(|group| svg(group, cost)).collect::<String>();
    }
    format!("<div class=\"plots\">\n{all}</div>\n")
}
