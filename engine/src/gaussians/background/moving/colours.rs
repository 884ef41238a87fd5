//! Whether the colours of pixels go with a moving thing or with what stands.

use lgs_formats::casts::whole;
use rayon::prelude::*;

use super::{Thing, outline::Outline};
use crate::{
    gaussians::background::Sheet,
    points::{moved, sample},
    views::{Projected, View},
};

/// Difference of colours (mean over the channels) from which on they have nothing to do with each other.
const DIFFERENT: f32 = 0.2;
/// Side of the window in which pixels decide together, shares of the height of a thing, and at most, pixels.
const WINDOW: (f32, usize) = (0.06, 4);
/// Difference of colours at which pixels of a window no longer decide together.
const SAME_SURFACE: f32 = 0.06;

/// How much better each pixel is explained by the thing than by what stands, by colours.
pub(super) struct Pixels {
    /// Of the outline; 0 where no other image tells.
    advantage: Vec<f32>,
}

impl Pixels {
    /// Those of an outline; `inverse` inverse depths of the thing in it, 1 / metres.
    pub(super) fn of(
        view: &View,
        sheet: &Sheet,
        thing: &Thing,
        outline: &Outline,
        inverse: &[f32],
        sources: &[&View],
    ) -> Self {
        let width = view.pinhole.width;
        let advantage = |(pixel, inverse): (usize, &f32)| {
            let [u, v] = [(pixel % width) as f32 + 0.5, (pixel / width) as f32 + 0.5];
            let colour: [f32; 3] = std::array::from_fn(|k| view.image.data[3 * pixel + k]);
            let at = |inverse: f32| view.pinhole.unproject(Projected { u, v, depth: 1.0 / inverse });
            let place = at(*inverse);
            let taken = view.pinhole.time_at([u, v]);
            let velocity = thing.velocity_of(place, taken - thing.time);
            let there = |source: &View| {
                let seconds = source.pinhole.time - taken;
                source.pinhole.project_moving(moved(place, velocity, seconds), velocity)
            };
            let still = sheet.inverse_depths[pixel];
            let differ = |place: &dyn Fn(&View) -> Option<Projected>| {
                let source_difference = |source: &&View| Some(difference(colour, sample(source, place(source)?)?));
                sources.iter().filter_map(source_difference).reduce(f32::min)
            };
            let moves = differ(&there)?;
            let stands = differ(&|source| source.pinhole.project((still > 0.0).then(|| at(still))?))?;
            Some(stands - moves)
        };
        let each = outline.pixels(width).zip(inverse).map(|pixel| advantage(pixel).unwrap_or(0.0));
        Self { advantage: each.collect() }
    }

    /// The mean over a window of what has the colour of its middle.
    pub(super) fn advantage(&self, view: &View, outline: &Outline, pixel: usize) -> f32 {
        let width = view.pinhole.width;
        let (column, row) = (pixel % width, pixel / width);
        let reach = whole(WINDOW.0 * outline.height).clamp(1, WINDOW.1);
        let colour = |pixel: usize| -> [f32; 3] { std::array::from_fn(|k| view.image.data[3 * pixel + k]) };
        let own = colour(pixel);
        let (mut sum, mut total) = (0.0, 0.0);
        for r in row.saturating_sub(reach).max(outline.rows.start)..(row + reach + 1).min(outline.rows.end) {
            for c in
                column.saturating_sub(reach).max(outline.columns.start)..(column + reach + 1).min(outline.columns.end)
            {
                let weight = (-difference(own, colour(r * width + c)) / SAME_SURFACE).exp();
                sum += weight * self.advantage[outline.index(r, c)];
                total += weight;
            }
        }
        sum / total
    }
}

fn difference(a: [f32; 3], b: [f32; 3]) -> f32 {
    ((0..3).map(|k| (a[k] - b[k]).abs()).sum::<f32>() / 3.0).min(DIFFERENT)
}
