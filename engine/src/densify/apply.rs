//! The set after the actions.

use rand_chacha::rand_core::Rng;

use super::random::generator;
use super::{Action, count};
use crate::error::{EngineError, Result};
use crate::gaussians::{Branch, GaussianSet, MEAN};

/// Standard deviation of a copy's displacement per axis, metres.
pub const COPY_NOISE: f64 = 0.01;

/// The set after the actions: what is kept, the copies, the background; each in the order of the set.
///
/// # Shapes
/// `actions` `[num_lidar]`.
///
/// # Errors
/// When there are not as many actions as primitives in the `LiDAR` branch.
pub fn apply(set: &GaussianSet, actions: &[Action], seed: u64) -> Result<GaussianSet> {
    if actions.len() != set.num_lidar {
        return Err(EngineError::Setting {
            setting: "densify actions",
            expected: format!("one per primitive of the LiDAR branch ({})", set.num_lidar),
            found: actions.len().to_string(),
        });
    }
    let origins = origins(actions);
    let rows: Vec<usize> = origins.iter().copied().chain(set.rows(Branch::Background)).collect();
    let mut updated = set.select(&rows, origins.len());
    let copies = set.num_lidar - count(actions).pruned..origins.len();
    for (row, &i) in updated.attributes[copies.clone()].iter_mut().zip(&origins[copies]) {
        row[MEAN].iter_mut().zip(displacement(seed, i)).for_each(|(x, o)| *x += o);
    }
    Ok(updated)
}

/// The primitive that each primitive of the `LiDAR` branch after the actions comes from: what is kept, then the copies.
pub fn origins(actions: &[Action]) -> Vec<usize> {
    let places = |wanted: fn(Action) -> bool| (0..actions.len()).filter(move |&i| wanted(actions[i]));
    places(|a| a != Action::Prune).chain(places(|a| a == Action::Copy)).collect()
}

/// Displacement of the copy of primitive i: the same for a seed, whatever else is copied and on any number of threads.
#[expect(clippy::cast_possible_truncation, reason = "positions are stored in f32")]
fn displacement(seed: u64, i: usize) -> [f32; 3] {
    let mut rng = generator(seed, i, 0);
    let mut unit = || (f64::from(rng.next_u32()) + 0.5) / 4_294_967_296.0;
    std::array::from_fn(|_| {
        let (radius, angle) = ((-2.0 * unit().ln()).sqrt(), std::f64::consts::TAU * unit());
        (COPY_NOISE * radius * angle.cos()) as f32
    })
}
