//! The plot that every chart is drawn into, as SVG: a frame, two axes, and what stands between them.
//!
//! Colours are attributes: the style of a page may give the classes others.

use std::fmt::Write;

use crate::{escape, number};

/// Width and height of a plot.
const SIZE: [f64; 2] = [620.0, 360.0];
/// Left, right, top, bottom of the frame.
pub const FRAME: [f64; 4] = [58.0, 604.0, 14.0, 312.0];
/// Empty part of an axis beyond the outermost values.
const ROOM: f64 = 0.06;

/// How values lie along an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// In even steps.
    Even,
    /// By their logarithms.
    Logarithmic,
}

/// An axis.
#[derive(Clone, Copy, Debug)]
pub struct Axis<'a> {
    /// What it shows, with the unit.
    pub label: &'a str,
    /// How values lie along it.
    pub scale: Scale,
    /// A value at a mark as text.
    pub tick: fn(f64) -> String,
}

impl<'a> Axis<'a> {
    /// An axis whose marks are plain numbers.
    pub const fn new(label: &'a str, scale: Scale) -> Self {
        Self { label, scale, tick: number }
    }
}

/// Values along an axis brought to places on the page.
#[derive(Clone, Copy, Debug)]
pub struct Mapping {
    scale: Scale,
    /// Values at the ends, on the axis' own scale.
    range: [f64; 2],
    /// Places of the ends.
    ends: [f64; 2],
}

impl Mapping {
    /// The mapping that shows all values, with some room beyond them, between two places.
    pub fn around(scale: Scale, values: impl IntoIterator<Item = f64>, ends: [f64; 2]) -> Self {
        let bent = values.into_iter().map(|value| bend(scale, value)).filter(|value| value.is_finite());
        let [low, high] = bent.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)]);
        let [low, high] = if low <= high { [low, high] } else { [0.0, 1.0] };
        let least = if scale == Scale::Logarithmic { 0.1 } else { high.abs().max(1e-6) * 1e-3 };
        let room = ((high - low) * ROOM).max(least);
        Self { scale, range: [low - room, high + room], ends }
    }

    /// The mapping of an even range between two places.
    pub fn exactly([low, high]: [f64; 2], ends: [f64; 2]) -> Self {
        Self { scale: Scale::Even, range: if high > low { [low, high] } else { [low - 0.5, low + 0.5] }, ends }
    }

    /// The place of a value.
    pub fn place(&self, value: f64) -> f64 {
        let share = (bend(self.scale, value) - self.range[0]) / (self.range[1] - self.range[0]);
        self.ends[0] + share * (self.ends[1] - self.ends[0])
    }

    /// The value, held to the ends of the axis.
    fn held(&self, value: f64) -> f64 {
        value.clamp(self.range[0], self.range[1])
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

/// A plot that is being drawn.
#[derive(Clone, Debug)]
pub struct Plot {
    x: Mapping,
    y: Mapping,
    content: String,
}

impl Plot {
    /// An empty plot whose axes, along and up, show all of these values.
    pub fn around(
        axes: [Axis<'_>; 2],
        along: impl IntoIterator<Item = f64>,
        up: impl IntoIterator<Item = f64>,
    ) -> Self {
        let [left, right, top, bottom] = FRAME;
        let x = Mapping::around(axes[0].scale, along, [left, right]);
        let y = Mapping::around(axes[1].scale, up, [bottom, top]);
        Self { x, y, content: axis_marks(axes, &x, &y) }
    }

    /// An empty plot whose even axes, along and up, have these ends.
    pub fn exactly(axes: [Axis<'_>; 2], ranges: [[f64; 2]; 2]) -> Self {
        let [left, right, top, bottom] = FRAME;
        let (x, y) = (Mapping::exactly(ranges[0], [left, right]), Mapping::exactly(ranges[1], [bottom, top]));
        Self { x, y, content: axis_marks(axes, &x, &y) }
    }

    /// The place of a point.
    pub fn place(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [self.x.place(x), self.y.place(y)]
    }

    /// The place of a point, held to the frame.
    pub fn place_within(&self, point: [f64; 2]) -> [f64; 2] {
        self.place(self.held(point))
    }

    /// A point, held to the ranges of the axes.
    pub(crate) fn held(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [self.x.held(x), self.y.held(y)]
    }

    /// Adds a piece of SVG.
    pub fn add(&mut self, svg: &str) {
        self.content += svg;
    }

    /// Adds a line through points; none through fewer than two.
    pub fn line(&mut self, attributes: &str, points: impl IntoIterator<Item = [f64; 2]>) {
        let places: Vec<String> = points
            .into_iter()
            .map(|point| {
                let [x, y] = self.place(point);
                format!("{x:.1},{y:.1}")
            })
            .collect();
        if places.len() > 1 {
            // Writing to a String cannot fail.
            let _ = writeln!(self.content, "<polyline {attributes} points=\"{}\"/>", places.join(" "));
        }
    }

    /// The plot as a figure of a page; the caption is HTML already.
    pub fn figure(&self, caption: &str) -> String {
        format!(
            "<figure class=\"plot\"><figcaption>{caption}</figcaption>\n<svg viewBox=\"0 0 {} {}\" role=\"img\">\n{}</svg></figure>\n",
            SIZE[0], SIZE[1], self.content
        )
    }

    /// The plot as a file of its own.
    pub fn file(&self, title: &str) -> String {
        let [width, height] = SIZE;
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 -24 {width} {}\" width=\"{width}\" height=\"{}\" \
             font-family=\"sans-serif\" font-size=\"12\">\n<rect y=\"-24\" width=\"{width}\" height=\"{}\" fill=\"#fff\"/>\n\
             <text x=\"{}\" y=\"-6\" font-size=\"14\" text-anchor=\"middle\">{}</text>\n{}</svg>\n",
            height + 24.0,
            height + 24.0,
            height + 24.0,
            width / 2.0,
            escape(title),
            self.content
        )
    }
}

/// The axes with their marks and labels.
fn axis_marks(axes: [Axis<'_>; 2], x: &Mapping, y: &Mapping) -> String {
    let [left, right, top, bottom] = FRAME;
    let mut svg = String::new();
    // Writing to a String cannot fail.
    let mut grid = |[x1, y1, x2, y2]: [f64; 4], [at_x, at_y]: [f64; 2], anchor: &str, text: &str| {
        let _ = writeln!(
            svg,
            "<line class=\"grid\" stroke=\"#ddd\" x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\"/>\
             <text x=\"{at_x:.1}\" y=\"{at_y:.1}\" text-anchor=\"{anchor}\">{text}</text>"
        );
    };
    for tick in x.ticks() {
        let at = x.place(tick);
        grid([at, top, at, bottom], [at, bottom + 18.0], "middle", &(axes[0].tick)(tick));
    }
    for tick in y.ticks() {
        let at = y.place(tick);
        grid([left, at, right, at], [left - 7.0, at + 4.0], "end", &(axes[1].tick)(tick));
    }
    let (along, up) = ((left + right) / 2.0, (top + bottom) / 2.0);
    let _ = writeln!(
        svg,
        "<text class=\"label\" x=\"{along}\" y=\"{}\" text-anchor=\"middle\">{}</text>\n\
         <text class=\"label\" transform=\"translate(14 {up}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
        bottom + 40.0,
        escape(axes[0].label),
        escape(axes[1].label)
    );
    svg
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_few() {
        for range in [[0.0, 1.0], [17.31, 17.42], [1e6, 5e6]] {
            let ticks = Mapping::around(Scale::Even, range, [0.0, 1.0]).ticks();
            assert!((2..=12).contains(&ticks.len()), "{range:?}: {ticks:?}");
        }
        for range in [[0.1, 0.2], [0.01, 300.0], [3.0, 3.0]] {
            let ticks = Mapping::around(Scale::Logarithmic, range, [0.0, 1.0]).ticks();
            assert!(ticks.len() <= 12, "{range:?}: {ticks:?}");
        }
    }

    #[test]
    fn values_lie_between_the_ends_and_labels_stay_text() {
        let axes = [Axis::new("a < b", Scale::Even), Axis::new("c", Scale::Logarithmic)];
        let mut plot = Plot::around(axes, [1.0, 2.0], [10.0, 1000.0]);
        let [[x1, y1], [x2, y2]] = [[1.0, 10.0], [2.0, 1000.0]].map(|point| plot.place(point));
        assert!(FRAME[0] < x1 && x1 < x2 && x2 < FRAME[1] && FRAME[3] > y1 && y1 > y2 && y2 > FRAME[2]);
        plot.line("class=\"front\"", [[1.0, 10.0], [2.0, 1000.0]]);
        plot.line("class=\"none\"", [[1.0, 10.0]]);
        let svg = plot.file("d & e");
        assert!(
            svg.contains("a &lt; b") && svg.contains("d &amp; e") && svg.contains("front") && !svg.contains("none")
        );
        assert!(svg.ends_with("</svg>\n") && !svg.contains("NaN") && !svg.contains("inf"));
        let one = Plot::exactly(axes, [[3.0, 3.0], [0.0, 1.0]]);
        assert_eq!(one.place_within([9.0, 7.0]), [FRAME[1], FRAME[2]]);
    }
}
