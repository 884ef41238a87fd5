//! Plots as SVG: what configurations cost against what they give.

use std::fmt::Write;

use lgs_pages::{self as pages, Axis, FRAME, escape};

use crate::sweep::front::{Offer, on_front};

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
    /// Passes of per-scene optimisation; `None` for the others.
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

impl Plot<'_> {
    /// The plot as SVG; empty without a dot.
    pub(super) fn svg(&self) -> String {
        if self.dots.is_empty() {
            return String::new();
        }
        let sign = if self.better == Better::Up { 1.0 } else { -1.0 };
        let offers: Vec<_> = self.dots.iter().map(|dot| Some(Offer { cost: dot.x, quality: sign * dot.y })).collect();
        let front = on_front(&offers);
        let costs = self.dots.iter().flat_map(|dot| [dot.x].into_iter().chain(dot.spread.into_iter().flatten()));
        let mut plot = pages::Plot::around([self.x, self.y], costs, self.dots.iter().map(|dot| dot.y));
        for series in 0..=self.dots.iter().map(|dot| dot.series).max().unwrap_or(0) {
            let in_series = |dot: &&Dot| dot.series == series && dot.reference_steps.is_some();
            plot.line("class=\"reference\"", from_left(self.dots.iter().filter(in_series)));
        }
        let on_it = self.dots.iter().zip(&front).filter(|(_, on)| **on).map(|(dot, _)| dot);
        plot.line("class=\"front\"", from_left(on_it));
        let mut order: Vec<usize> = (0..self.dots.len()).collect();
        order.sort_by_key(|&k| (front[k], self.dots[k].reference_steps.is_none()));
        let texts = self.texts(&order, &front, &plot);
        for k in order {
            plot.add(&dot(&self.dots[k], front[k], texts[k].as_deref(), &plot));
        }
        plot.figure(&escape(self.title))
    }

    /// What is written at each dot: nothing where it would cover what a dot later in the order says.
    fn texts(&self, order: &[usize], front: &[bool], plot: &pages::Plot) -> Vec<Option<String>> {
        let (mut texts, mut taken) = (vec![None; self.dots.len()], Vec::<[f64; 2]>::new());
        for &k in order.iter().rev() {
            let dot = &self.dots[k];
            let text = match (dot.reference_steps, front[k]) {
                (Some(steps), _) => steps.to_string(),
                (None, true) => format!("#{}", dot.row),
                (None, false) => continue,
            };
            let at = plot.place([dot.x, dot.y]);
            if taken.iter().all(|other| (0..2).any(|k| (other[k] - at[k]).abs() >= TEXT[k])) {
                taken.push(at);
                texts[k] = Some(text);
            }
        }
        texts
    }
}

/// The dots as points from left to right.
fn from_left<'a>(dots: impl Iterator<Item = &'a Dot>) -> Vec<[f64; 2]> {
    let mut points: Vec<[f64; 2]> = dots.map(|dot| [dot.x, dot.y]).collect();
    points.sort_by(|a, b| a[0].total_cmp(&b[0]));
    points
}

fn dot(dot: &Dot, on_front: bool, text: Option<&str>, plot: &pages::Plot) -> String {
    let [at_x, at_y] = plot.place([dot.x, dot.y]);
    let class = match (dot.reference_steps, on_front) {
        (Some(_), true) => "reference best",
        (Some(_), false) => "reference",
        (None, true) => "best",
        (None, false) => "beaten",
    };
    let mut svg = format!("<g class=\"{class}\" data-row=\"{}\"><title>{}</title>", dot.row, escape(&dot.name));
    if let Some([low, high]) = dot.spread {
        let [[low, _], [high, _]] = [low, high].map(|x| plot.place([x, dot.y]));
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
    use lgs_pages::Scale;

    use super::*;

    fn plot(dots: &[[f64; 2]]) -> String {
        let axis = |scale| Axis::new("a < b", scale);
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
}
