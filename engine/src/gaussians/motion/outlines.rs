//! When the returns of what moves were measured, as its outlines in the images tell.
//!
//! At the moment of an image a thing is where its returns were, plus its velocity times the time since then. With the right times its outermost
//! returns then lie just inside of an edge of the image; with wrong ones beside it.

use std::collections::BTreeMap;

use lgs_formats::casts::whole;

use super::{Movement, STANDS};
use crate::{
    parallel,
    points::{PointCloud, moved, sample},
    views::{Projected, View},
};

/// How far outside of an outermost return, and inside, colours are compared, beams ...
const BESIDE: [f32; 2] = [1.5, 0.5];
/// ... which are so many radians apart, and at least a pixel.
const BEAM: f32 = 0.0028;
/// Fewest returns of a thing in a row of an image of which two are outermost.
const IN_A_ROW: usize = 3;
/// What is slower tells nothing, metres a second.
const SLOWEST: f32 = 1.0;
/// Fewest outermost returns that tell.
pub(super) const FEWEST: usize = 40;
/// How many times as strong edges must be than with any other times.
const STRONGER: f64 = 1.25;

/// Which of some times of the returns of a cloud the outlines of what moves fit best; `None` where none is plainly better than all the others
/// and than the cloud's own.
///
/// # Formula
/// The sum over outermost returns of the squared contrast across the outline; asked is 1.25 times that of any other times.
///
/// # Shapes
/// `times` `[N]` each, seconds since the clip's time zero.
pub(crate) fn best_times(cloud: &PointCloud, movement: &Movement, views: &[View], times: &[&[f32]]) -> Option<usize> {
    let outermost = outermosts(cloud, movement, views);
    if outermost.len() < FEWEST {
        return None;
    }
    let squared =
        |end: &Outermost<'_>, times: &[f32]| f64::from(end.contrast(cloud, movement, times[end.point], 0.0)).powi(2);
    let strength = |times: &[f32]| -> f64 { outermost.iter().map(|end| squared(end, times)).sum() };
    let own = strength(&cloud.times);
    let found: Vec<f64> = times.iter().map(|times| strength(times)).collect();
    let best = (0..found.len()).max_by(|&a, &b| found[a].total_cmp(&found[b]))?;
    let others = found.iter().enumerate().filter(|&(k, _)| k != best).map(|(_, &strength)| strength);
    let next = others.fold(own, f64::max);
    (found[best] > STRONGER * next).then_some(best)
}

/// A return at the left or right end of what moves.
pub(super) struct Outermost<'a> {
    /// The view that shows it.
    pub(super) view: &'a View,
    /// Index of the return.
    pub(super) point: usize,
    /// Pixels to the next beam outside; negative to the left.
    outward: f32,
}

/// The ends of what moves in all views.
pub(super) fn outermosts<'a>(cloud: &PointCloud, movement: &Movement, views: &'a [View]) -> Vec<Outermost<'a>> {
    let of_views = parallel::map(views.len(), 1, &|i| outermost(cloud, movement, &views[i]));
    of_views.into_iter().flatten().collect()
}

/// The ends of what moves in every row of a view, by the returns of its own sweep. Rows are as high as beams are apart: in lower ones a line of
/// returns that is not quite level has ends everywhere.
fn outermost<'a>(cloud: &PointCloud, movement: &Movement, view: &'a View) -> Vec<Outermost<'a>> {
    let beam = (BEAM * view.pinhole.fx).max(1.0);
    let mut rows: BTreeMap<(u32, usize), Row> = BTreeMap::new();
    for point in 0..cloud.len() {
        let (thing, velocity) = (movement.things[point], movement.velocities[point]);
        let own = u32::try_from(view.frame) == Ok(cloud.frames[point]);
        if !own || thing == STANDS || velocity.iter().map(|v| v * v).sum::<f32>() < SLOWEST * SLOWEST {
            continue;
        }
        let Some(at) = view.pinhole.project(cloud.positions[point]) else { continue };
        let row = rows.entry((thing, whole(at.v / beam))).or_insert(Row::of(at.u, point));
        row.count += 1;
        row.left = if at.u < row.left.0 { (at.u, point) } else { row.left };
        row.right = if at.u > row.right.0 { (at.u, point) } else { row.right };
    }
    let ends = |row: Row| {
        [(row.left.1, -beam), (row.right.1, beam)].map(|(point, outward)| Outermost { view, point, outward })
    };
    rows.into_values().filter(|row| row.count >= IN_A_ROW).flat_map(ends).collect()
}

/// The returns of a thing in a row of an image: column and index of the first and the last.
#[derive(Clone, Copy)]
struct Row {
    count: usize,
    left: (f32, usize),
    right: (f32, usize),
}

impl Row {
    const fn of(column: f32, point: usize) -> Self {
        Self { count: 0, left: (column, point), right: (column, point) }
    }
}

impl Outermost<'_> {
    /// Width of a beam in its view, pixels.
    pub(super) const fn beam(&self) -> f32 {
        self.outward.abs()
    }

    /// Where its view shows it.
    fn place(&self, cloud: &PointCloud, movement: &Movement, time: f32) -> Option<Projected> {
        let (view, velocity) = (&self.view.pinhole, movement.velocities[self.point]);
        view.project_moving(moved(cloud.positions[self.point], velocity, view.time - time), velocity)
    }

    /// The column of its view in which it is if it was measured at `time` (seconds).
    pub(super) fn column(&self, cloud: &PointCloud, movement: &Movement, time: f32) -> Option<f32> {
        self.place(cloud, movement, time).map(|at| at.u)
    }

    /// How much the colours outside and inside of it differ if it was measured at `time` (seconds) and the camera is turned to the left by
    /// `turn` (radians): mean over the channels, 0 where the view does not show it.
    pub(super) fn contrast(&self, cloud: &PointCloud, movement: &Movement, time: f32, turn: f32) -> f32 {
        let Some(at) = self.place(cloud, movement, time) else { return 0.0 };
        let view = &self.view.pinhole;
        let beside = |pixels: f32| {
            let u = at.u + turn * view.fx + pixels;
            (0.0..view.width as f32).contains(&u).then(|| sample(self.view, Projected { u, ..at })).flatten()
        };
        let Some((outside, inside)) = beside(BESIDE[0] * self.outward).zip(beside(-BESIDE[1] * self.outward)) else {
            return 0.0;
        };
        outside.iter().zip(inside).map(|(a, b)| (a - b).abs()).sum::<f32>() / 3.0
    }
}

#[cfg(test)]
mod tests {
    use super::best_times;
    use crate::{
        gaussians::motion::{Flow, Movement},
        points::PointCloud,
        views::{
            Projected, View,
            samples::{ahead, seen},
        },
    };

    const SIZE: [usize; 2] = [200, 60];
    const SPEED: f32 = 12.0;

    /// A dark thing with a pattern before a bright wall, 10 m away.
    fn image() -> View {
        let shade = |i: usize| {
            let (row, column) = (i / SIZE[0], i % SIZE[0]);
            let inside = (60..140).contains(&column) && (10..50).contains(&row);
            if inside { 0.2 + 0.1 * (column as f32 * 0.4).sin() } else { 0.7 + 0.1 * (column as f32 * 0.3).cos() }
        };
        seen(ahead(SIZE[0], SIZE[1], 200.0), (0..SIZE[0] * SIZE[1]).flat_map(|i| [shade(i); 3]).collect())
    }

    /// The returns of the thing, which moves to the right, if they were measured from left to right (or back) around the image's moment.
    fn returns(sense: f32) -> (PointCloud, Movement, Vec<f32>) {
        let view = image();
        let mut cloud = PointCloud::default();
        let mut times = Vec::new();
        for (row, column) in (12..48).flat_map(|row| (61..140).step_by(2).map(move |column| (row, column))) {
            let at = Projected { u: column as f32 + 0.5, v: row as f32 + 0.5, depth: 10.0 };
            let time = sense * 4e-4 * (at.u - 100.0);
            let [x, y, z] = view.pinhole.unproject(at);
            cloud.positions.push([x + SPEED * time, y, z]);
            cloud.origins.push([0.0; 3]);
            cloud.times.push(view.pinhole.time);
            cloud.frames.push(0);
            times.push(view.pinhole.time + time);
        }
        let flow = Flow { frame: 0, rows: [[0.0, 0.0, 0.0, SPEED], [0.0; 4], [0.0; 4]] };
        let movement = Movement {
            velocities: vec![[SPEED, 0.0, 0.0]; cloud.len()],
            things: vec![0; cloud.len()],
            flows: vec![flow],
        };
        (cloud, movement, times)
    }

    #[test]
    fn outlines_tell_when_returns_were_measured_and_when_at_once() {
        for (sense, best) in [(1.0, Some(0)), (-1.0, Some(1)), (0.0, None)] {
            let (cloud, movement, _) = returns(sense);
            let [with, against] = [returns(1.0).2, returns(-1.0).2];
            assert_eq!(best_times(&cloud, &movement, &[image()], &[&with, &against]), best, "sense {sense}");
        }
        let (cloud, movement, times) = returns(1.0);
        let still = Movement { velocities: vec![[0.0; 3]; cloud.len()], ..movement };
        assert_eq!(best_times(&cloud, &still, &[image()], &[&times]), None);
    }
}
