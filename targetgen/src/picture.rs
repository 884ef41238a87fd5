//! Small vector pictures: histograms and scatter plots as SVG.

use std::fmt::Write;

use lgs_engine::report::escape;

const WIDTH: f64 = 420.0;
const HEIGHT: f64 = 260.0;
/// Room around the plot: left, top, right, bottom.
const MARGIN: [f64; 4] = [46.0, 28.0, 14.0, 42.0];

/// An axis: what it shows and from where to where.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis<'a> {
    /// Name, with the unit.
    pub name: &'a str,
    /// First value.
    pub low: f64,
    /// Last value.
    pub high: f64,
}

impl Axis<'_> {
    /// Place of a value between 0 and 1, held to the axis.
    fn place(&self, value: f64) -> f64 {
        if self.high > self.low { ((value - self.low) / (self.high - self.low)).clamp(0.0, 1.0) } else { 0.5 }
    }
}

/// One histogram: bars of counts over equal parts of the axis.
pub fn histogram(title: &str, axis: &Axis<'_>, counts: &[u64]) -> String {
    let largest = counts.iter().copied().max().unwrap_or(0).max(1) as f64;
    let y = Axis { name: "primitives", low: 0.0, high: largest };
    let mut svg = frame(title, axis, &y);
    let width = plot_width() / counts.len().max(1) as f64;
    for (k, &count) in counts.iter().enumerate() {
        let height = plot_height() * count as f64 / largest;
        let (left, top) = (MARGIN[0] + k as f64 * width, MARGIN[1] + plot_height() - height);
        line(
            &mut svg,
            &format!(
                "<rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{:.1}\" height=\"{height:.1}\" fill=\"#3465a4\"/>",
                (width - 0.5).max(0.3)
            ),
        );
    }
    svg + "</svg>\n"
}

/// One scatter plot; points beyond an axis stand at its end.
pub fn scatter(title: &str, x: &Axis<'_>, y: &Axis<'_>, points: &[[f64; 2]]) -> String {
    let mut svg = frame(title, x, y);
    for axis in [0, 1] {
        let zero = [x, y][axis];
        if zero.low < 0.0 && zero.high > 0.0 {
            let at = zero.place(0.0);
            let (left, top) = (MARGIN[0] + at * plot_width(), MARGIN[1] + (1.0 - at) * plot_height());
            let ends = if axis == 0 {
                [left, MARGIN[1], left, MARGIN[1] + plot_height()]
            } else {
                [MARGIN[0], top, MARGIN[0] + plot_width(), top]
            };
            let [x1, y1, x2, y2] = ends;
            line(
                &mut svg,
                &format!("<line x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\" stroke=\"#bbb\"/>"),
            );
        }
    }
    for [a, b] in points {
        let (cx, cy) = (MARGIN[0] + x.place(*a) * plot_width(), MARGIN[1] + (1.0 - y.place(*b)) * plot_height());
        line(
            &mut svg,
            &format!("<circle cx=\"{cx:.1}\" cy=\"{cy:.1}\" r=\"1.8\" fill=\"#3465a4\" fill-opacity=\"0.45\"/>"),
        );
    }
    svg + "</svg>\n"
}

const fn plot_width() -> f64 {
    WIDTH - MARGIN[0] - MARGIN[2]
}

const fn plot_height() -> f64 {
    HEIGHT - MARGIN[1] - MARGIN[3]
}

fn line(svg: &mut String, text: &str) {
    // writing to a String cannot fail
    let _ = writeln!(svg, "{text}");
}

/// The picture up to its content: title, frame, axes with both ends.
fn frame(title: &str, x: &Axis<'_>, y: &Axis<'_>) -> String {
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" width=\"{WIDTH}\" height=\"{HEIGHT}\" \
         font-family=\"sans-serif\" font-size=\"11\">\n<rect width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"#fff\"/>\n"
    );
    let (right, bottom) = (MARGIN[0] + plot_width(), MARGIN[1] + plot_height());
    let mut text = |at: [f64; 2], anchor: &str, text: &str| {
        let [left, top] = at;
        line(
            &mut svg,
            &format!("<text x=\"{left:.1}\" y=\"{top:.1}\" text-anchor=\"{anchor}\">{}</text>", escape(text)),
        );
    };
    text([WIDTH / 2.0, 17.0], "middle", title);
    text([MARGIN[0], bottom + 15.0], "start", &number(x.low));
    text([right, bottom + 15.0], "end", &number(x.high));
    text([(MARGIN[0] + right) / 2.0, bottom + 30.0], "middle", x.name);
    text([MARGIN[0] - 4.0, bottom], "end", &number(y.low));
    text([MARGIN[0] - 4.0, MARGIN[1] + 9.0], "end", &number(y.high));
    let middle = MARGIN[1] + plot_height() / 2.0;
    line(
        &mut svg,
        &format!(
            "<text transform=\"translate(12 {middle}) rotate(-90)\" text-anchor=\"middle\">{}</text>\n\
         <rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" fill=\"none\" stroke=\"#888\"/>",
            escape(y.name),
            MARGIN[0],
            MARGIN[1],
            plot_width(),
            plot_height()
        ),
    );
    svg
}

/// A number in a few characters.
pub fn number(value: f64) -> String {
    if value == 0.0 {
        "0".to_owned()
    } else if (1e-3..1e5).contains(&value.abs()) {
        let text = format!("{value:.4}");
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        format!("{value:.1e}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_hold_their_points_and_names_stay_text() {
        let axis = Axis { name: "delta <1>", low: -1.0, high: 1.0 };
        let bars = histogram("a & b", &axis, &[1, 5, 0]);
        assert_eq!(bars.matches("fill=\"#3465a4\"").count(), 3);
        assert!(bars.contains("a &amp; b") && bars.contains("delta &lt;1&gt;") && bars.ends_with("</svg>\n"));
        let dots = scatter("t", &axis, &axis, &[[0.0, 0.0], [9.0, f64::NAN]]);
        assert_eq!(dots.matches("<circle").count(), 2);
        assert_eq!([0.0, 0.25, 1e-7, 123_456.0].map(number), ["0", "0.25", "1.0e-7", "1.2e5"]);
    }
}
