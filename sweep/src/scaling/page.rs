//! `scaling.html`: one file that shows what was measured, without anything from elsewhere.

use lgs_engine::report::{document, escape};

use super::{
    fit::{PowerLaw, STEEP},
    job::Failed,
    part::Part,
    plan::Axis,
    plot::{Cost, exponent, svg},
    record::SizeRecord,
    table::Row,
};
use crate::{machine::Machine, report::STYLE as SHARED, statistics::Spread};

const STYLE: &str = include_str!("style.css");

/// What the page shows.
#[derive(Clone, Copy, Debug)]
pub(super) struct Page<'a> {
    pub(super) machine: &'a Machine,
    pub(super) rows: &'a [Row],
    pub(super) records: &'a [SizeRecord],
    pub(super) failed: &'a [Failed],
}

/// The page.
pub(super) fn html(page: &Page<'_>) -> String {
    let mut body = header(page);
    for axis in Axis::ALL {
        let rows: Vec<&Row> = page.rows.iter().filter(|row| row.axis == axis).collect();
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
        let line = |failed: &Failed| format!("<li>{}: {}</li>\n", escape(&failed.size), escape(&failed.reason));
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

fn named(row: &Row) -> String {
    let of = |kind: &str, law: Option<PowerLaw>| {
        law.filter(PowerLaw::is_steep)
            .map(|law| format!("{} of {} ({kind}, {})", row.part.key(), row.axis.name(), exponent(&law)))
    };
    [of("time", row.time.law), of("memory", row.memory.law)].into_iter().flatten().collect::<Vec<_>>().join(", ")
}

fn section(title: &str, content: &str) -> String {
    format!("<section>\n<h2>{title}</h2>\n{content}</section>\n")
}

fn law_table(rows: &[&Row]) -> String {
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
        let seconds = |spread: Option<Spread>| spread.map_or("–".to_owned(), |s| format!("{:.4}", s.median));
        let memory = |value: Option<f64>| value.map_or("–".to_owned(), |value| format!("{value:.0}"));
        body += &format!("<tr><th>{}</th><td class=\"text\">{}</td>", row.part.key(), row.time.unit(row.units));
        let work = |point| thousands(&format!("{:.0}", row.time.work(point)));
        for cell in [
            work(first),
            work(last),
            seconds(first.seconds),
            seconds(last.seconds),
            law(row.time.law),
            memory(first.memory_mb),
            memory(last.memory_mb),
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
        let seconds = Spread::of(times.passes.iter().filter_map(|pass| pass.get(&Part::Total).copied()));
        let text =
            |value: Option<f64>, digits: usize| value.map_or("–".to_owned(), |value| format!("{value:.digits$}"));
        body += &format!("<tr><th>{size}</th>");
        for cell in [
            thousands(&space.work.returns.to_string()),
            thousands(&space.work.gaussians().to_string()),
            thousands(&space.work.sites.to_string()),
            thousands(&space.work.intersections.to_string()),
            times.passes.len().to_string(),
            text(seconds.map(|s| s.median), 2),
            text(Some(space.predicted_mb), 1),
            text(times.peak_rss_mb, 0),
            text(times.peak_rss_mb.map(|peak| peak / space.predicted_mb), 1),
        ] {
            body += &format!("<td>{cell}</td>");
        }
        body += "</tr>\n";
    }
    table(&head, &body)
}

fn table(head: &[&str], body: &str) -> String {
    let cells: String = head.iter().map(|name| format!("<th>{name}</th>")).collect();
    format!("<div class=\"wide\"><table>\n<thead><tr>{cells}</tr></thead>\n<tbody>\n{body}</tbody>\n</table></div>\n")
}

fn plots(rows: &[Row], cost: Cost) -> String {
    let mut all = String::new();
    for part in Part::ALL {
        let of: Vec<&Row> = rows.iter().filter(|row| row.part == part).collect();
        let alike = of.iter().all(|row| row.units == of[0].units);
        let groups: Vec<&[&Row]> = if alike { vec![of.as_slice()] } else { of.chunks(1).collect() };
        all += &groups.into_iter().map(|group| svg(group, cost)).collect::<String>();
    }
    format!("<div class=\"plots\">\n{all}</div>\n")
}

/// The digits of a number with blanks between thousands.
fn thousands(digits: &str) -> String {
    let mut text = String::new();
    for (k, digit) in digits.chars().enumerate() {
        if k > 0 && (digits.len() - k).is_multiple_of(3) {
            text.push('\u{202f}');
        }
        text.push(digit);
    }
    text
}
