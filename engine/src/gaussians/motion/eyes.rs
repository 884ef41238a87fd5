//! What the images say of something that moves: it keeps its colour where it would be at the moment of each.

use crate::{
    points::sample,
    views::{Role, View},
};

/// Difference of colours (mean over the channels) from which on they have nothing to do with each other.
const DIFFERENT: f32 = 0.15;
/// Most images that one is compared with.
const MOST: usize = 4;

/// An image of a sweep's own frame and those that it is compared with.
#[derive(Clone, Debug)]
struct Own<'a> {
    view: &'a View,
    others: Vec<&'a View>,
}

/// The input images, by sweep.
#[derive(Clone, Debug)]
pub(super) struct Eyes<'a> {
    own: Vec<Vec<Own<'a>>>,
}

impl<'a> Eyes<'a> {
    /// The images of the frames of some sweeps; those of the same camera nearest in time are compared.
    pub(super) fn of(views: &'a [View], frames: &[u32], steady: f32) -> Self {
        let inputs = || views.iter().filter(|view| view.role == Role::Input);
        let others = |view: &View| {
            let apart = |other: &View| (other.pinhole.time - view.pinhole.time).abs();
            let mut others: Vec<&View> = inputs()
                .filter(|other| other.camera == view.camera && other.frame != view.frame && apart(other) <= steady)
                .collect();
            others.sort_by(|a, b| apart(a).total_cmp(&apart(b)));
            others.truncate(MOST);
            others
        };
        let frame_views = |&frame: &u32| {
            let own = inputs().filter(|view| u32::try_from(view.frame) == Ok(frame));
            own.map(|view| Own { view, others: others(view) }).collect()
        };
        Self { own: frames.iter().map(frame_views).collect() }
    }

    /// How much the colours of a point of a sweep differ, were it to move so: 0 (not at all, or nobody knows) to 1.
    pub(super) fn differ(&self, sweep: usize, point: [f32; 3], time: f32, velocity: [f32; 2]) -> f32 {
        let (mut sum, mut count) = (0.0, 0.0);
        for Own { view, others } in &self.own[sweep] {
            let Some(own) = colour(view, point, time, velocity) else { continue };
            for other in others {
                let Some(there) = colour(other, point, time, velocity) else { continue };
                let apart: f32 = own.iter().zip(there).map(|(a, b)| (a - b).abs()).sum();
                sum += (apart / (3.0 * DIFFERENT)).min(1.0);
                count += 1.0;
            }
        }
        if count > 0.0 { sum / count } else { 0.0 }
    }
}

fn colour(view: &View, [x, y, z]: [f32; 3], time: f32, velocity: [f32; 2]) -> Option<[f32; 3]> {
    let seconds = view.pinhole.time - time;
    let place = [x + velocity[0] * seconds, y + velocity[1] * seconds, z];
    let at = view.pinhole.project_moving(place, [velocity[0], velocity[1], 0.0])?;
    sample(view, at)
}
