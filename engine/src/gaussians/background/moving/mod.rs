//! Pixels of what moves: windows, dark paint and roofs, on which no return falls.
//!
//! Around the returns of a moving thing, each pixel is compared with where it would be in the other images: moved with the thing, or
//! standing behind it.

mod colours;
mod nearest;
mod outline;

use std::ops::Range;

use self::{colours::Advantage, nearest::Nearest, outline::Outline};
use super::{Sheet, depth::Trust, gaps::continued, is_ignored};
use crate::{
    gaussians::{
        Gaussian, GaussianSet, NUM_ATTRIBUTES, mean_of,
        motion::{Flow, Movement, STANDS},
    },
    parallel,
    points::{PointCloud, moved, samples_of},
    views::{DepthSample, View},
};

/// Fewest returns in an image that show where a thing is.
const FEWEST: usize = 6;
/// Gaussians that a thread makes at once.
const GRAIN: usize = 64;

/// A moving thing as one sweep sees it.
#[derive(Clone, Debug)]
pub(super) struct Thing {
    pub(super) flow: Flow,
    /// Mean time of its returns, seconds.
    pub(super) time: f32,
    /// Its returns, metres, and when each was taken, seconds.
    returns: Vec<([f32; 3], f32)>,
}

impl Thing {
    /// The velocity of a point of it that stands at `place` so many seconds after its own time.
    pub(super) fn velocity_of(&self, place: [f32; 3], seconds: f32) -> [f32; 3] {
        let velocity = self.flow.at(place);
        self.flow.at(moved(place, velocity, -seconds))
    }
}

/// The things that move, each as each sweep sees it.
pub(super) fn things(cloud: &PointCloud, movement: &Movement) -> Vec<Thing> {
    let mut things: Vec<Thing> =
        movement.flows.iter().map(|&flow| Thing { flow, time: 0.0, returns: Vec::new() }).collect();
    for (point, &thing) in movement.things.iter().enumerate().filter(|&(_, &thing)| thing != STANDS) {
        things[thing as usize].returns.push((cloud.positions[point], cloud.times[point]));
    }
    for thing in &mut things {
        let sum: f64 = thing.returns.iter().map(|&(_, time)| f64::from(time)).sum();
        thing.time = lgs_formats::casts::to_f32(sum / thing.returns.len().max(1) as f64);
    }
    things
}

/// The returns that stand still.
pub(super) fn still(cloud: &PointCloud, movement: &Movement) -> PointCloud {
    let kept = || (0..cloud.len()).filter(|&point| movement.things[point] == STANDS);
    PointCloud {
        positions: kept().map(|point| cloud.positions[point]).collect(),
        times: kept().map(|point| cloud.times[point]).collect(),
        frames: kept().map(|point| cloud.frames[point]).collect(),
        origins: kept().map(|point| cloud.origins[point]).collect(),
        num_missing: cloud.num_missing,
    }
}

/// What a view shows of a thing.
pub(super) struct Shown {
    /// Row-major indices of its pixels, ascending, and their inverse depths, 1 / metres.
    pub(super) pixels: Vec<(usize, f32)>,
    /// The rows of the image that they are in.
    pub(super) rows: Range<usize>,
    /// Row-major indices of the other pixels where it may be.
    pub(super) around: Vec<usize>,
}

/// What `view` shows of each of `things`, those of its own frame; `None` for those that it does not show.
///
/// `still`: the returns of what stands that the view shows; `sources`: images that are compared.
pub(super) fn shown(
    view: &View,
    sheet: &Sheet,
    still: &[DepthSample],
    things: &[&Thing],
    sources: &[&View],
) -> Vec<Option<Shown>> {
    let samples: Vec<Vec<DepthSample>> = parallel::map(things.len(), 1, &|k| samples(view, things[k]));
    let width = view.pinhole.width;
    let shown = |k: usize| {
        let (thing, own) = (things[k], &samples[k]);
        if own.len() < FEWEST {
            return None;
        }
        let outline = Outline::of(view, own);
        let inverse_depths = continued(outline.size(), &outline.inside(width, own), 0.0);
        let advantage = Advantage::of(view, sheet, thing, &outline, &inverse_depths, sources);
        let others = samples.iter().enumerate().filter(|&(other, _)| other != k).flat_map(|(_, samples)| samples);
        let near = Nearest::of(&outline, width, own, others.chain(still));
        let shows = |pixel: usize| {
            !is_ignored(view, pixel)
                && sheet.trust[pixel] != Trust::OwnVehicle
                && advantage.at(pixel / width, pixel % width) + near.prior(&outline, pixel, width) > 0.0
        };
        let (mut pixels, mut around) = (Vec::new(), Vec::new());
        for ((pixel, shows), &inverse) in outline.pixels(width, &shows).into_iter().zip(&inverse_depths) {
            if shows {
                pixels.push((pixel, inverse));
            } else {
                around.push(pixel);
            }
        }
        Some(Shown { pixels, around, rows: outline.rows })
    };
    parallel::map(things.len(), 1, &shown)
}

/// Appends Gaussians of a thing that an image asked for, by their raw attributes.
pub(super) fn append(set: &mut GaussianSet, view: &View, thing: &Thing, rows: &[[f32; NUM_ATTRIBUTES]]) {
    let gaussian = |i: usize| {
        let attributes = rows[i];
        let mean = mean_of(&attributes);
        let time = view.pinhole.exposed_at(mean);
        let velocity = thing.velocity_of(mean, time - thing.time);
        Gaussian { attributes, time, frame: thing.flow.frame, velocity }
    };
    let gaussians: Vec<Gaussian> = parallel::map(rows.len(), GRAIN, &gaussian);
    gaussians.into_iter().for_each(|gaussian| set.push(gaussian));
}

/// Where the returns of a thing are in an image, at its moment.
fn samples(view: &View, thing: &Thing) -> Vec<DepthSample> {
    let moving = |i: usize| {
        let (place, time) = thing.returns[i];
        (place, thing.flow.at(place), time)
    };
    samples_of(thing.returns.len(), &moving, &view.pinhole)
}

#[cfg(test)]
mod tests {
    use super::{Sheet, Thing, Trust, shown};
    use crate::{
        gaussians::motion::Flow,
        views::{
            View,
            samples::{ahead, seen},
        },
    };

    const SIZE: [usize; 2] = [96, 48];
    /// Columns and rows of the thing in the first image; returns fall on the lower half of it.
    const THING: [std::ops::Range<usize>; 2] = [30..60, 12..36];
    /// Columns that it moves until the second image.
    const MOVED: usize = 30;

    /// A striped wall 40 m away, before which something dark with a few marks stands 10 m away.
    fn image(moved: usize, frame: usize, time: f32) -> View {
        let mut colours = Vec::new();
        for row in 0..SIZE[1] {
            for column in 0..SIZE[0] {
                let inside = THING[0].contains(&(column.wrapping_sub(moved))) && THING[1].contains(&row);
                let shade = if inside {
                    0.2 + 0.1 * ((column - moved) * 7 % 5) as f32 / 5.0
                } else {
                    0.5 + 0.4 * (column * 3 % 7) as f32 / 7.0
                };
                colours.extend([shade; 3]);
            }
        }
        let view = seen(ahead(SIZE[0], SIZE[1], 100.0), colours);
        View { frame, pinhole: crate::views::PinholeView { time, ..view.pinhole }, ..view }
    }

    #[test]
    fn pixels_without_returns_go_with_the_thing_whose_colours_do() {
        let (first, second) = (image(0, 0, 0.0), image(MOVED, 2, 0.2));
        let place = |pixel: usize| {
            let at = crate::views::Projected {
                u: (pixel % SIZE[0]) as f32 + 0.5,
                v: (pixel / SIZE[0]) as f32 + 0.5,
                depth: 10.0,
            };
            (first.pinhole.unproject(at), 0.0)
        };
        let lower = (24..36).flat_map(|row| (30..60).map(move |column| row * SIZE[0] + column));
        let metres = MOVED as f32 / 100.0 * 10.0;
        let flow = Flow { frame: 0, rows: [[0.0, 0.0, 0.0, metres / 0.2], [0.0; 4], [0.0; 4]] };
        let thing = Thing { flow, time: 0.0, returns: lower.step_by(5).map(place).collect() };
        let count = SIZE[0] * SIZE[1];
        let wall = Sheet { inverse_depths: vec![1.0 / 40.0; count], trust: vec![Trust::Alone; count] };
        let found = shown(&first, &wall, &[], &[&thing], &[&second]).remove(0).unwrap();
        assert!(found.pixels.iter().all(|(pixel, _)| found.rows.contains(&(pixel / SIZE[0]))));
        let inverse = |pixel: usize| found.pixels.iter().find(|at| at.0 == pixel).map(|at| at.1);
        let share = |rows: std::ops::Range<usize>, columns: std::ops::Range<usize>| {
            let pixels: Vec<usize> =
                rows.flat_map(|row| columns.clone().map(move |column| row * SIZE[0] + column)).collect();
            let moves = pixels.iter().filter(|&&pixel| inverse(pixel).is_some()).count();
            moves as f32 / pixels.len() as f32
        };
        assert!(share(25..35, 31..59) > 0.95, "where returns are");
        assert!(share(18..23, 31..59) > 0.9, "above them");
        assert!(share(0..10, 0..96) < 0.05 && share(12..36, 68..96) < 0.05, "the wall");
        let depth = inverse(18 * SIZE[0] + 45).unwrap();
        assert!((depth - 0.1).abs() < 0.01, "{depth}");
    }

    #[test]
    fn a_thing_outside_of_the_image_has_no_pixels() {
        let view = image(0, 0, 0.0);
        let flow = Flow { frame: 0, rows: [[0.0, 0.0, 0.0, 1.0], [0.0; 4], [0.0; 4]] };
        let thing = Thing { flow, time: 0.0, returns: vec![([0.0, 0.0, -5.0], 0.0); 20] };
        let count = SIZE[0] * SIZE[1];
        let wall = Sheet { inverse_depths: vec![0.1; count], trust: vec![Trust::Alone; count] };
        assert!(shown(&view, &wall, &[], &[&thing], &[])[0].is_none());
    }
}
