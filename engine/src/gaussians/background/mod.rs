//! The background branch: what stands behind, between and above the returns.

mod backstop;
mod coverage;
mod depth;
mod emit;
mod sky;

use rayon::prelude::*;

use self::{coverage::Coverage, depth::Trust};
use super::{GaussianSet, NUM_ATTRIBUTES};
use crate::{
    points::PointCloud,
    views::{PinholeView, Role, View},
};

/// Where the background comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// The one that scored best on held-out frames: [`Mode::Depth`].
    #[default]
    Auto,
    /// No background.
    Off,
    /// A hemisphere far away, above the horizon.
    Sky,
    /// Depth maps that the input images and sweeps agree on.
    Depth,
}

/// What stands behind a view's pixels.
#[derive(Clone, Debug, PartialEq)]
struct Sheet {
    /// `[H, W]` inverse depths, 1 / metres along the camera's z axis; NaN where nothing is known.
    inverse_depths: Vec<f32>,
    /// `[H, W]` how far they can be trusted.
    trust: Vec<Trust>,
}

/// Nothing: appends Gaussians to `set` where its `LiDAR` branch leaves pixels of the input views uncovered.
///
/// What views agree on comes first, then what one alone knows, then what is contradicted; within each, view after view.
/// Pixels that an earlier Gaussian covers get no other. All of them are static but the own vehicle's, which moves with the
/// sensors.
pub fn add_background(set: &mut GaussianSet, views: &[View], cloud: &PointCloud, mode: Mode) {
    let inputs: Vec<&View> = views.iter().filter(|view| view.role == Role::Input).collect();
    let radius = sky::radius(cloud);
    let sheets: Vec<Sheet> = match mode {
        Mode::Off => return,
        Mode::Sky => sky::sheets(&inputs, radius),
        Mode::Auto | Mode::Depth => depth::sheets(&inputs, cloud, radius),
    };
    add_pixels(set, &inputs, &sheets);
    if mode == Mode::Sky {
        return;
    }
    for k in 0..inputs.len() {
        let sources = depth::sources(&inputs, k);
        let first = !inputs[..k].iter().any(|view| view.camera == inputs[k].camera);
        if let Some(&other) = sources.first().filter(|_| first) {
            let rows = emit::rows(inputs[k], &sheets[k], &Coverage::new(&inputs[k].pinhole), Trust::OwnVehicle, &[]);
            let velocity = velocity(&inputs[k].pinhole, &inputs[other].pinhole);
            append(set, rows, inputs[k].pinhole.time, velocity);
        }
    }
    for (view, sheet) in inputs.iter().zip(&sheets) {
        append(set, backstop::rows(view, sheet), 0.0, [0.0; 3]);
    }
}

/// Nothing: appends one Gaussian for every uncovered pixel of a known depth.
fn add_pixels(set: &mut GaussianSet, inputs: &[&View], sheets: &[Sheet]) {
    let covered = |view: &&View| {
        let mut coverage = Coverage::new(&view.pinhole);
        coverage.add(&view.pinhole, &set.attributes);
        coverage
    };
    let mut coverages: Vec<Coverage> = inputs.par_iter().map(covered).collect();
    for trust in [Trust::Confirmed, Trust::Alone, Trust::Contradicted] {
        for k in 0..inputs.len() {
            let sources: Vec<&View> = depth::sources(inputs, k).into_iter().map(|j| inputs[j]).collect();
            let rows = emit::rows(inputs[k], &sheets[k], &coverages[k], trust, &sources);
            inputs.par_iter().zip(&mut coverages).for_each(|(view, coverage)| coverage.add(&view.pinhole, &rows));
            append(set, rows, 0.0, [0.0; 3]);
        }
    }
}

fn append(set: &mut GaussianSet, rows: Vec<[f32; NUM_ATTRIBUTES]>, time: f32, velocity: [f32; 3]) {
    set.attributes.extend(rows);
    set.times.resize(set.len(), time);
    set.velocities.resize(set.len(), velocity);
}

/// Velocity (metres a second) of a camera between two of its images; 0 when they were taken at the same moment.
fn velocity(from: &PinholeView, to: &PinholeView) -> [f32; 3] {
    let (a, b, seconds) = (from.centre(), to.centre(), to.time - from.time);
    if seconds == 0.0 { [0.0; 3] } else { std::array::from_fn(|k| (b[k] - a[k]) / seconds) }
}

/// Length of the ray through a pixel's centre to the depth of one metre.
fn slant(view: &PinholeView, pixel: usize) -> f32 {
    let x = ((pixel % view.width) as f32 + 0.5 - view.cx) / view.fx;
    let y = ((pixel / view.width) as f32 + 0.5 - view.cy) / view.fy;
    (1.0 + x * x + y * y).sqrt()
}
