//! Charts that need no style of a page: histograms, scatter plots, curves.

use std::fmt::Write;

use crate::{
    escape,
    plot::{Axis, FRAME, Plot, Scale},
};

/// The colour of bars and dots.
const COLOUR: &str = "#3465a4";
/// The colours of curves, in turns.
const COLOURS: [&str; 6] = [COLOUR, "#c8660c", "#2e7d32", "#8e24aa", "#b71c1c", "#00838f"];
/// Between two lines of names.
const LINE: f64 = 16.0;

/// An axis from one value to another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range<'a> {
    /// Name, with the unit.
    pub name: &'a str,
    /// First value.
    pub low: f64,
    /// Last value.
    pub high: f64,
}

impl<'a> Range<'a> {
    const fn axis(&self) -> Axis<'a> {
        Axis::new(self.name, Scale::Even)
    }

    const fn ends(&self) -> [f64; 2] {
        [self.low, self.high]
    }
}

/// A histogram as a file: bars of counts over equal parts of the axis.
pub fn histogram(title: &str, axis: &Range<'_>, unit: &str, counts: &[u64]) -> String {
    let largest = counts.iter().copied().max().unwrap_or(0).max(1) as f64;
    let mut plot = Plot::exactly([axis.axis(), Axis::new(unit, Scale::Even)], [axis.ends(), [0.0, largest]]);
    let width = (FRAME[1] - FRAME[0]) / counts.len().max(1) as f64;
    for (k, &count) in counts.iter().enumerate() {
        let [_, top] = plot.place([axis.low, count as f64]);
        plot.add(&format!(
            "<rect x=\"{:.1}\" y=\"{top:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"{COLOUR}\"/>\n",
            FRAME[0] + k as f64 * width,
            (width - 0.5).max(0.3),
            FRAME[3] - top
        ));
    }
    plot.file(title)
}

/// A scatter plot as a file; points beyond an axis stand at its end.
pub fn scatter(title: &str, [x, y]: [Range<'_>; 2], points: &[[f64; 2]]) -> String {
    let mut plot = Plot::exactly([x.axis(), y.axis()], [x.ends(), y.ends()]);
    for zero in [[[0.0, y.low], [0.0, y.high]], [[x.low, 0.0], [x.high, 0.0]]] {
        if zero[0] == plot.held(zero[0]) {
            plot.line("fill=\"none\" stroke=\"#999\"", zero);
        }
    }
    for &point in points {
        let [cx, cy] = plot.place_within(point);
        plot.add(&format!(
            "<circle cx=\"{cx:.1}\" cy=\"{cy:.1}\" r=\"1.8\" fill=\"{COLOUR}\" fill-opacity=\"0.45\"/>\n"
        ));
    }
    plot.file(title)
}

/// A course.
#[derive(Clone, Debug)]
pub struct Curve {
    /// Its name.
    pub name: String,
    /// Along and up.
    pub points: Vec<[f64; 2]>,
}

/// What stands around curves.
#[derive(Clone, Copy, Debug)]
pub struct CurvesFrame<'a> {
    /// Above them.
    pub title: &'a str,
    /// Along and up.
    pub axes: [Axis<'a>; 2],
    /// Radius of the dot at every point; 0 for none.
    pub dots: f64,
}

/// Curves as a file; empty where no curve has a point.
pub fn curves(frame: &CurvesFrame<'_>, curves: &[Curve]) -> String {
    let values = |axis: usize| curves.iter().flat_map(move |curve| curve.points.iter().map(move |point| point[axis]));
    if values(0).next().is_none() {
        return String::new();
    }
    let mut plot = Plot::around(frame.axes, values(0), values(1));
    let mut names = String::new();
    for (k, curve) in curves.iter().enumerate() {
        let colour = COLOURS[k % COLOURS.len()];
        plot.line(&format!("fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\""), curve.points.iter().copied());
        for &point in curve.points.iter().filter(|_| frame.dots > 0.0) {
            let [cx, cy] = plot.place(point);
            plot.add(&format!("<circle cx=\"{cx:.1}\" cy=\"{cy:.1}\" r=\"{}\" fill=\"{colour}\"/>\n", frame.dots));
        }
        // Writing to a String cannot fail.
        let _ = writeln!(
            names,
            "<text x=\"{}\" y=\"{}\" fill=\"{colour}\" text-anchor=\"end\" paint-order=\"stroke\" stroke=\"#fff\" \
             stroke-width=\"3\">{}</text>",
            FRAME[1] - 6.0,
            FRAME[2] + LINE * (k as f64 + 1.0),
            escape(&curve.name)
        );
    }
    plot.add(&names);
    plot.file(frame.title)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn charts_hold_their_points_and_names_stay_text() {
        let axis = Range { name: "delta <1>", low: -1.0, high: 1.0 };
        let bars = histogram("a & b", &axis, "primitives", &[1, 5, 0]);
        assert_eq!(bars.matches("<rect x=").count(), 3);
        assert!(bars.contains("a &amp; b") && bars.contains("delta &lt;1&gt;") && bars.ends_with("</svg>\n"));
        let dots = scatter("t", [axis, axis], &[[0.0, 0.0], [9.0, -3.0]]);
        assert_eq!((dots.matches("<circle").count(), dots.matches("<polyline").count()), (2, 2));
    }

    #[test]
    fn curves_have_their_names_and_nothing_makes_no_picture() {
        let axes = [Axis::new("step", Scale::Even), Axis::new("", Scale::Even)];
        let frame = CurvesFrame { title: "two", axes, dots: 3.0 };
        let curve = |name: &str, points: &[[f64; 2]]| Curve { name: name.to_owned(), points: points.to_vec() };
        let svg = curves(&frame, &[curve("a", &[[0.0, 1.0], [1.0, 2.0]]), curve("b<", &[[0.0, 1.0]])]);
        assert_eq!((svg.matches("<polyline").count(), svg.matches("<circle").count()), (1, 3));
        assert!(svg.contains(">a</text>") && svg.contains(">b&lt;</text>"));
        assert_eq!(curves(&frame, &[curve("a", &[])]), "");
    }
}
