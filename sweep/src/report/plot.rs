//! Plots as SVG: what configurations cost against what they give.

use std::fmt::Write;

use lgs_engine::report::escape;
use lgs_targetgen::picture::number;

use crate::front::{Offer, on_front};

/// Width and height of a plot.
pub(crate) const SIZE: [f64; 2] = [620.0, 360.0];
/// Left, right, top, bottom of the frame.
pub(crate) const FRAME: [f64; 4] = [58.0, 604.0, 14.0, 312.0];
/// Empty part of an axis beyond the outermost values.
const ROOM: f64 = 0.06;

/// How values lie along an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scale {
    Even,
    Logarithmic,
}

/// An axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Axis<'a> {
    pub(super) label: &'a str,
    pub(super) scale: Scale,
}

/// Which side of the upward axis is better.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Better {
    Up,
    Down,
}

/// A configuration in a plot.
#[derive(Clone, Debug)]
pub(super) struct Dot {
    pub(super) x: f64,
    pub(super) y: f64,
    /// Ends of the line through it; the quartiles of repeated measurements.
    pub(super) spread: Option<[f64; 2]>,
    /// Number of its row in the table, from 1.
    pub(super) row: usize,
    /// Steps of per-scene optimisation; `None` for the others.
    pub(super) reference_steps: Option<usize>,
    /// Dots of per-scene optimisation with the same number are joined.
    pub(super) series: usize,
    pub(super) name: String,
}

/// A plot.
#[derive(Clone, Debug)]
pub(super) struct Plot<'a> {
    pub(super) title: &'a str,
    pub(super) x: Axis<'a>,
    pub(super) y: Axis<'a>,
    pub(super) better: Better,
    pub(super) dots: Vec<Dot>,
}

/// Width and height of what is written at a dot.
const TEXT: [f64; 2] = [26.0, 12.0];

/// Values along an axis brought to places on the page.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Mapping {
    scale: Scale,
    /// Values at the ends, on the axis' own scale.
    range: [f64; 2],
    /// Places of the ends.
    ends: [f64; 2],
}

impl Mapping {
    pub(crate) fn new(scale: Scale, values: impl Iterator<Item = f64>, ends: [f64; 2]) -> Self {
        let bent = values.map(|value| bend(scale, value)).filter(|value| value.is_finite());
        let [low, high] = bent.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)]);
        let [low, high] = if low <= high { [low, high] } else { [0.0, 1.0] };
        let least = if scale == Scale::Logarithmic { 0.1 } else { high.abs().max(1e-6) * 1e-3 };
        let room = ((high - low) * ROOM).max(least);
        Self { scale, range: [low - room, high + room], ends }
    }

    pub(crate) fn place(&self, value: f64) -> f64 {
        let share = (bend(self.scale, value) - self.range[0]) / (self.range[1] - self.range[0]);
        self.ends[0] + share * (self.ends[1] - self.ends[0])
    }

    /// Round values on the axis.
    fn ticks(&self) -> Vec<f64> {
        let [low, high] = self.range;
        match self.scale {
            Scale::Even => {
                let step = round_step((high - low) / 5.0);
                let (first, last) = ((low / step).ceil(), (high / step).floor());
                (0..=20).map(|k| first + f64::from(k)).take_while(|k| *k <= last).map(|k| k * step).collect()
            }
            Scale::Logarithmic => {
                let wide = high - low > 2.0;
                let factors: &[f64] = if wide { &[1.0] } else { &[1.0, 2.0, 5.0] };
                let decades = (-12..=12).flat_map(|decade| factors.iter().map(move |f| f * 10_f64.powi(decade)));
                decades.filter(|value| (low..=high).contains(&value.log10())).collect()
            }
        }
    }
}

fn bend(scale: Scale, value: f64) -> f64 {
    match scale {
        Scale::Even => value,
        Scale::Logarithmic => value.log10(),
    }
}

/// The next of 1, 2, 5 times a power of ten.
fn round_step(step: f64) -> f64 {
    let unit = 10_f64.powf(step.log10().floor());
    let rounded = [1.0, 2.0, 5.0].into_iter().find(|factor| factor * unit >= step * 0.999);
    rounded.unwrap_or(10.0) * unit
}

impl Plot<'_> {
    /// The plot as SVG; empty without a dot.
    pub(super) fn svg(&self) -> String {
        if self.dots.is_empty() {
            return String::new();
        }
        let x = Mapping::new(
            self.x.scale,
            self.dots.iter().flat_map(|dot| [dot.x].into_iter().chain(dot.spread.into_iter().flatten())),
            [FRAME[0], FRAME[1]],
        );
        let y = Mapping::new(self.y.scale, self.dots.iter().map(|dot| dot.y), [FRAME[3], FRAME[2]]);
        let sign = if self.better == Better::Up { 1.0 } else { -1.0 };
        let offers: Vec<_> = self.dots.iter().map(|dot| Some(Offer { cost: dot.x, quality: sign * dot.y })).collect();
        let front = on_front(&offers);
        // Writing to a String cannot fail.
        let mut svg = format!(
            "<figure class=\"plot\"><figcaption>{}</figcaption>\n<svg viewBox=\"0 0 {} {}\" role=\"img\">\n",
            escape(self.title),
            SIZE[0],
            SIZE[1]
        );
        svg += &axes([self.x.label, self.y.label], &x, &y);
        for series in 0..=self.dots.iter().map(|dot| dot.series).max().unwrap_or(0) {
            let of = |dot: &&Dot| dot.series == series && dot.reference_steps.is_some();
            svg += &line("reference", self.dots.iter().filter(of), &x, &y);
        }
        let on_it = self.dots.iter().zip(&front).filter(|(_, on)| **on).map(|(dot, _)| dot);
        svg += &line("front", on_it, &x, &y);
        let mut order: Vec<usize> = (0..self.dots.len()).collect();
        order.sort_by_key(|&k| (front[k], self.dots[k].reference_steps.is_none()));
        let texts = self.texts(&order, &front, [&x, &y]);
        for k in order {
            svg += &dot(&self.dots[k], front[k], texts[k].as_deref(), [&x, &y]);
        }
        svg + "</svg></figure>\n"
    }

    /// What is written at each dot: nothing where it would cover what a dot later in the order says.
    fn texts(&self, order: &[usize], front: &[bool], [x, y]: [&Mapping; 2]) -> Vec<Option<String>> {
        let (mut texts, mut taken) = (vec![None; self.dots.len()], Vec::<[f64; 2]>::new());
        for &k in order.iter().rev() {
            let dot = &self.dots[k];
            let text = match (dot.reference_steps, front[k]) {
                (Some(steps), _) => steps.to_string(),
                (None, true) => format!("#{}", dot.row),
                (None, false) => continue,
            };
            let at = [x.place(dot.x), y.place(dot.y)];
            if taken.iter().all(|other| (0..2).any(|k| (other[k] - at[k]).abs() >= TEXT[k])) {
                taken.push(at);
                texts[k] = Some(text);
            }
        }
        texts
    }
}

/// The grid, the numbers and the labels of the horizontal and the upward axis.
pub(crate) fn axes([label_x, label_y]: [&str; 2], x: &Mapping, y: &Mapping) -> String {
    let [left, right, top, bottom] = FRAME;
    let mut svg = String::new();
    for tick in x.ticks() {
        let at = x.place(tick);
        let _ = writeln!(svg, "<line class=\"grid\" x1=\"{at:.1}\" y1=\"{top}\" x2=\"{at:.1}\" y2=\"{bottom}\"/>");
        let _ =
            writeln!(svg, "<text x=\"{at:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>", bottom + 18.0, number(tick));
    }
    for tick in y.ticks() {
        let at = y.place(tick);
        let _ = writeln!(svg, "<line class=\"grid\" x1=\"{left}\" y1=\"{at:.1}\" x2=\"{right}\" y2=\"{at:.1}\"/>");
        let _ = writeln!(
            svg,
            "<text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            left - 7.0,
            at + 4.0,
            number(tick)
        );
    }
    let middle = (left + right) / 2.0;
    let _ = writeln!(
        svg,
        "<text class=\"label\" x=\"{middle}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
        bottom + 40.0,
        escape(label_x)
    );
    let middle = (top + bottom) / 2.0;
    let _ = writeln!(
        svg,
        "<text class=\"label\" transform=\"translate(14 {middle}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
        escape(label_y)
    );
    svg
}

/// A line through dots from left to right.
fn line<'a>(class: &str, dots: impl Iterator<Item = &'a Dot>, x: &Mapping, y: &Mapping) -> String {
    let mut through: Vec<&Dot> = dots.collect();
    through.sort_by(|a, b| a.x.total_cmp(&b.x));
    let places: Vec<String> =
        through.iter().map(|dot| format!("{:.1},{:.1}", x.place(dot.x), y.place(dot.y))).collect();
    if places.len() < 2 {
        return String::new();
    }
    format!("<polyline class=\"{class}\" points=\"{}\"/>\n", places.join(" "))
}

fn dot(dot: &Dot, on_front: bool, text: Option<&str>, [x, y]: [&Mapping; 2]) -> String {
    let (at_x, at_y) = (x.place(dot.x), y.place(dot.y));
    let class = match (dot.reference_steps, on_front) {
        (Some(_), true) => "reference best",
        (Some(_), false) => "reference",
        (None, true) => "best",
        (None, false) => "beaten",
    };
    let mut svg = format!("<g class=\"{class}\" data-row=\"{}\"><title>{}</title>", dot.row, escape(&dot.name));
    if let Some([low, high]) = dot.spread {
        let (low, high) = (x.place(low), x.place(high));
        let _ = write!(svg, "<line x1=\"{low:.1}\" y1=\"{at_y:.1}\" x2=\"{high:.1}\" y2=\"{at_y:.1}\"/>");
    }
    let _ = write!(svg, "<circle cx=\"{at_x:.1}\" cy=\"{at_y:.1}\" r=\"5\"/>");
    if let Some(text) = text {
        let (text_x, anchor) = if at_x > FRAME[1] - 30.0 { (at_x - 8.0, "end") } else { (at_x + 8.0, "start") };
        let text_y = if at_y < FRAME[2] + 12.0 { at_y + 16.0 } else { at_y - 7.0 };
        let _ = write!(svg, "<text x=\"{text_x:.1}\" y=\"{text_y:.1}\" text-anchor=\"{anchor}\">{text}</text>");
    }
    svg + "</g>\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot(dots: &[[f64; 2]]) -> String {
        let axis = |scale| Axis { label: "a < b", scale };
        let dots = dots.iter().zip(1..).map(|(&[x, y], row)| Dot {
            x,
            y,
            spread: None,
            row,
            reference_steps: None,
            series: 0,
            name: "a & b".to_owned(),
        });
        let (x, y) = (axis(Scale::Logarithmic), axis(Scale::Even));
        Plot { title: "t", x, y, better: Better::Up, dots: dots.collect() }.svg()
    }

    #[test]
    fn what_is_beaten_is_grey_and_the_others_are_on_the_line() {
        let svg = plot(&[[1.0, 10.0], [2.0, 9.0], [3.0, 12.0]]);
        assert_eq!((svg.matches("class=\"best\"").count(), svg.matches("class=\"beaten\"").count()), (2, 1));
        assert!(svg.contains("polyline class=\"front\"") && svg.contains("a &lt; b") && svg.contains("a &amp; b"));
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
    }

    #[test]
    fn nothing_is_written_over_another() {
        let svg = plot(&[[1.0, 10.0], [1.001, 10.001], [3.0, 12.0]]);
        assert_eq!((svg.matches(">#").count(), svg.matches("<circle").count()), (2, 3), "{svg}");
    }

    #[test]
    fn a_single_dot_and_none_are_drawn_too() {
        let svg = plot(&[[1.0, 10.0]]);
        assert!(!svg.contains("NaN") && !svg.contains("inf") && svg.contains("circle"), "{svg}");
        assert_eq!(plot(&[]), "");
    }

    #[test]
    fn ticks_are_round_and_few() {
        for range in [[0.0, 1.0], [17.31, 17.42], [1e6, 5e6]] {
            let ticks = Mapping::new(Scale::Even, range.into_iter(), [0.0, 1.0]).ticks();
            assert!((2..=12).contains(&ticks.len()), "{range:?}: {ticks:?}");
        }
        for range in [[0.1, 0.2], [0.01, 300.0], [3.0, 3.0]] {
            let ticks = Mapping::new(Scale::Logarithmic, range.into_iter(), [0.0, 1.0]).ticks();
            assert!(ticks.len() <= 12, "{range:?}: {ticks:?}");
        }
    }
}
