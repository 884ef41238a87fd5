//! Plots as SVG: cost against work on logarithmic axes, with the law that fits.

use lgs_pages::{self as pages, Plot, Scale, escape};

use super::{
    fit::PowerLaw,
    plan::Axis,
    table::{Growth, PartRow, Point},
};

/// What is plotted of rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Cost {
    Seconds,
    Memory,
}

/// A dot.
#[derive(Clone, Debug)]
struct Dot {
    work: f64,
    /// Lower quartile, median, upper quartile.
    cost: [f64; 3],
    name: String,
}

impl Cost {
    const fn label(self) -> &'static str {
        match self {
            Self::Seconds => "seconds",
            Self::Memory => "memory (MB)",
        }
    }

    const fn of(self, row: &PartRow) -> Growth {
        match self {
            Self::Seconds => row.time,
            Self::Memory => row.memory,
        }
    }

    fn dot(self, row: &PartRow, point: &Point) -> Option<Dot> {
        let work = self.of(row).work(point);
        let cost = match self {
            Self::Seconds => point.seconds.map(|s| [s.q1, s.median, s.q3])?,
            Self::Memory => [point.memory_mb?; 3],
        };
        // Only what is above 0 has a place on a logarithmic axis.
        let fits = work > 0.0 && cost[0] > 0.0;
        let name = format!("{}: {} {:.4}", point.size, self.label(), cost[1]);
        fits.then_some(Dot { work, cost, name })
    }
}

/// The costs of a part along the axes that count its work alike; empty where nothing is known.
pub(super) fn svg(rows: &[&PartRow], cost: Cost) -> String {
    let series: Vec<(&PartRow, Vec<Dot>)> =
        rows.iter().map(|row| (*row, row.points.iter().filter_map(|point| cost.dot(row, point)).collect())).collect();
    let dots = || series.iter().flat_map(|(_, dots)| dots);
    let Some((first, _)) = series.iter().find(|(_, dots)| !dots.is_empty()) else { return String::new() };
    let axes = [cost.of(first).unit(first.units), cost.label().to_owned()];
    let [along, up] = [&axes[0], &axes[1]].map(|label| pages::Axis::new(label, Scale::Logarithmic));
    let mut plot = Plot::around([along, up], dots().map(|dot| dot.work), dots().flat_map(|dot| dot.cost));
    for (row, dots) in &series {
        plot.add(&format!("<g class=\"{}\">\n", row.axis.name()));
        if let Some(law) = cost.of(row).law {
            let works = || dots.iter().map(|dot| dot.work);
            let ends = [works().fold(f64::INFINITY, f64::min), works().fold(0.0, f64::max)];
            plot.line("", ends.map(|work| [work, law.cost(work)]));
        }
        for dot in dots {
            let [[at, low], [_, middle], [_, high]] = dot.cost.map(|cost| plot.place([dot.work, cost]));
            plot.add(&format!(
                "<line x1=\"{at:.1}\" y1=\"{low:.1}\" x2=\"{at:.1}\" y2=\"{high:.1}\"/><circle cx=\"{at:.1}\" \
                 cy=\"{middle:.1}\" r=\"{}\"><title>{}</title></circle>\n",
                if row.axis == Axis::Points { 5 } else { 4 },
                escape(&dot.name)
            ));
        }
        plot.add("</g>\n");
    }
    let said: Vec<String> = series.iter().filter_map(|(row, _)| Some(says(row, cost.of(row).law?))).collect();
    let laws = if said.is_empty() { String::new() } else { format!(": {}", said.join(", ")) };
    plot.figure(&format!("{}{laws}", first.part.key()))
}

/// An exponent with its error, for people.
pub(super) fn exponent(law: &PowerLaw) -> String {
    format!("{:.2} ± {:.2}", law.exponent, law.standard_error)
}

fn says(row: &PartRow, law: PowerLaw) -> String {
    let class = if law.is_steep() { " class=\"steep\"" } else { "" };
    format!("<span{class}>{} {}</span>", row.axis.name(), exponent(&law))
}
