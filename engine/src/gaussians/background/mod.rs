//! The background branch: static Gaussians behind what the sweeps leave uncovered.

mod coverage;
mod depth;
mod emit;
mod sky;

use rayon::prelude::*;

use self::coverage::{Coverage, Round};
use super::GaussianSet;
use crate::{
    points::PointCloud,
    views::{Role, View},
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
    /// Where the returns around an uncovered pixel continue to.
    Depth,
}

/// Inverse depths (1 / metres, along the camera's z axis) of a view's pixels; NaN where nothing is known.
#[derive(Clone, Debug)]
struct Sheet(Vec<f32>);

/// Nothing: appends static Gaussians to `set` where its `LiDAR` branch leaves pixels of the input views uncovered.
///
/// View after view, in their order: a Gaussian that an earlier view asked for covers pixels of the later ones.
pub fn add_background(set: &mut GaussianSet, views: &[View], cloud: &PointCloud, mode: Mode) {
    let inputs: Vec<&View> = views.iter().filter(|view| view.role == Role::Input).collect();
    let sheets: Vec<Sheet> = match mode {
        Mode::Off => return,
        Mode::Sky => sky::sheets(&inputs, cloud),
        Mode::Auto | Mode::Depth => depth::sheets(&inputs, sky::radius(cloud)),
    };
    let rounds = Round::of(&set.attributes);
    let mut coverages: Vec<Coverage> = inputs
        .par_iter()
        .map(|view| {
            let mut coverage = Coverage::new(&view.pinhole);
            coverage.add(&view.pinhole, &rounds);
            coverage
        })
        .collect();
    for k in 0..inputs.len() {
        let rows = emit::rows(inputs[k], &sheets[k], &coverages[k]);
        let rounds = Round::of(&rows);
        let later = inputs.par_iter().zip(&mut coverages).skip(k + 1);
        later.for_each(|(view, coverage)| coverage.add(&view.pinhole, &rounds));
        set.attributes.extend(rows);
    }
    set.times.resize(set.len(), 0.0);
    set.velocities.resize(set.len(), [0.0; 3]);
}
