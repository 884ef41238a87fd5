//! Raw parameters: their physical values, and the chain rule back, against finite differences through the twin in f64.

use lgs_engine::gaussians::physical::{SplatGradient, to_physical, to_raw_gradient};
use lgs_engine::gaussians::{GaussianSet, NUM_ATTRIBUTES};
use lgs_engine::render::reference::{self, Camera, Gaussian, Images, fragile_pixels};
use lgs_tests::compare::{close, close_l2, relative};
use lgs_tests::scenes::{Look, random_scene, random_weights, splats, weighted_sum};
use lgs_tests::{Outcome, case};
use libtest_mimic::Trial;

use super::renderer::BACKGROUND;

const LOOK: Look = Look { num: 16, width: 40, height: 28, opacities: [0.3, 0.9] };
const STEP: f64 = 1e-6;
/// Rows of the set that belong to the background.
const NUM_BACKGROUND: usize = 6;

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("gaussians::physical_values_are_their_formulas", physical_values_are_their_formulas),
        case("gaussians::raw_gradients_are_finite_differences", raw_gradients_are_finite_differences),
    ]
}

type Row = [f64; NUM_ATTRIBUTES];

/// A set with one LiDAR row and one background row at each end of the clamp, and times and velocities.
struct Raw {
    rows: Vec<Row>,
    rest: Vec<Gaussian>,
    camera: Camera,
}

impl Raw {
    fn new(seed: u64) -> Self {
        let scene = random_scene(LOOK, seed);
        let mut rows: Vec<Row> = scene.gaussians.iter().map(raw_row).collect();
        let first_background = rows.len() - NUM_BACKGROUND;
        for (row, log_scale) in [(0, 0.5), (1, -12.0), (first_background, 0.5), (first_background + 1, -12.0)] {
            rows[row][7] = log_scale;
        }
        let single = |row: Row| row.map(|v| f64::from(narrow(v)));
        Self { rows: rows.into_iter().map(single).collect(), rest: scene.gaussians, camera: scene.camera }
    }

    fn set(&self) -> GaussianSet {
        GaussianSet {
            attributes: self.rows.iter().map(|row| row.map(narrow)).collect(),
            times: self.rest.iter().map(|g| narrow(g.time)).collect(),
            frames: vec![0; self.rest.len()],
            velocities: self.rest.iter().map(|g| g.velocity.map(narrow)).collect(),
            num_lidar: self.rows.len() - NUM_BACKGROUND,
        }
    }

    /// The specification's formulas, in f64.
    fn physical(&self) -> Vec<Gaussian> {
        let gaussian = |i: usize| {
            let row = &self.rows[i];
            let upper = if i < self.rows.len() - NUM_BACKGROUND { 1.0 } else { f64::INFINITY };
            let sigmoid = |x: f64| 1.0 / (1.0 + (-x).exp());
            Gaussian {
                mean: std::array::from_fn(|k| row[k]),
                quat: std::array::from_fn(|k| row[3 + k]),
                scale: std::array::from_fn(|k| row[7 + k].exp().clamp(1e-4, upper)),
                opacity: sigmoid(row[10]),
                colour: std::array::from_fn(|k| sigmoid(row[11 + k])),
                ..self.rest[i]
            }
        };
        (0..self.rows.len()).map(gaussian).collect()
    }
}

fn raw_row(g: &Gaussian) -> Row {
    let logit = |p: f64| (p / (1.0 - p)).ln();
    let mut row = [0.0; NUM_ATTRIBUTES];
    row[..3].copy_from_slice(&g.mean);
    row[3..7].copy_from_slice(&g.quat);
    row[7..10].copy_from_slice(&g.scale.map(f64::ln));
    row[10] = logit(g.opacity);
    row[11..].copy_from_slice(&g.colour.map(|c| logit(c.clamp(0.05, 0.95))));
    row
}

#[expect(clippy::cast_possible_truncation, reason = "rounding to f32 is the point")]
fn narrow(value: f64) -> f32 {
    value as f32
}

fn physical_values_are_their_formulas() -> Outcome {
    let raw = Raw::new(41);
    let (got, want) = (to_physical(&raw.set()), splats(&raw.physical()));
    for (i, (got, want)) in got.iter().zip(&want).enumerate() {
        let numbers = |s: &lgs_engine::gaussians::physical::Splat| -> Vec<f64> {
            let parts = [s.mean.as_slice(), &s.quat, &s.scale, &[s.opacity], &s.colour, &s.velocity, &[s.time]];
            parts.concat().iter().map(|&v| f64::from(v)).collect()
        };
        close(&format!("Gaussian {i}"), &numbers(got), &numbers(want), relative(1e-6, 0.0))?;
    }
    Ok(())
}

fn raw_gradients_are_finite_differences() -> Outcome {
    let mut raw = Raw::new(42);
    let physical = raw.physical();
    let skip = fragile_pixels(&physical, &raw.camera, 1e-3);
    let weights = random_weights(&raw.camera, &skip, 43);
    let by_physical: Vec<SplatGradient> = reference::backward(&physical, &raw.camera, BACKGROUND, &weights)
        .iter()
        .map(|g| SplatGradient {
            mean: g.mean.map(narrow),
            quat: g.quat.map(narrow),
            scale: g.scale.map(narrow),
            opacity: narrow(g.opacity),
            colour: g.colour.map(narrow),
            velocity: g.velocity.map(narrow),
        })
        .collect();
    let (got, velocities) = to_raw_gradient(&raw.set(), &by_physical);
    if velocities != by_physical.iter().map(|g| g.velocity).collect::<Vec<_>>() {
        return Err("the gradient by the velocity is not passed on as it is".into());
    }
    for (first, last, name) in
        [(0, 3, "mean"), (3, 7, "quat"), (7, 10, "log scale"), (10, 11, "opacity"), (11, 14, "colour")]
    {
        let got: Vec<f64> = got.iter().flat_map(|row| row[first..last].iter().map(|&v| f64::from(v))).collect();
        let mut want = Vec::new();
        for row in 0..raw.rows.len() {
            for column in first..last {
                want.push(central_difference(&mut raw, &weights, row, column));
            }
        }
        close_l2(&format!("gradient by {name}"), &got, &want, 1e-4, 1e-3)?;
    }
    Ok(())
}

fn central_difference(raw: &mut Raw, weights: &Images, row: usize, column: usize) -> f64 {
    let start = raw.rows[row][column];
    let mut value = |at: f64| {
        raw.rows[row][column] = at;
        weighted_sum(&reference::render(&raw.physical(), &raw.camera, BACKGROUND), weights)
    };
    let slope = (value(start + STEP) - value(start - STEP)) / (2.0 * STEP);
    raw.rows[row][column] = start;
    slope
}
