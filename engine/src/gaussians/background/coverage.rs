//! How much of a view a set of round Gaussians covers, whatever their order.

use rayon::prelude::*;

use crate::{
    gaussians::{GaussianSet, LOG_SCALE, LOGIT_OPACITY, MEAN, NUM_ATTRIBUTES, physical::sigmoid},
    views::PinholeView,
};

/// Variance that the renderer adds to every projected Gaussian, square pixels.
const BLUR: f32 = 0.3;
/// Weight below which the renderer skips a Gaussian.
const MIN_ALPHA: f32 = 1.0 / 255.0;

/// A pixel needs a background when at least this share of it shows through.
const SHOWS: f32 = 0.3;
/// Logarithm of a transmittance that is surely below [`SHOWS`], by more than rounding: nothing that is added brings it back.
const SURELY_COVERED: f32 = -1.21;

/// Transmittance of a view's pixels through everything that was added, as its logarithm.
#[derive(Clone, Debug)]
pub(super) struct Coverage {
    width: usize,
    height: usize,
    /// `[H, W]` sum of `ln(1 - alpha)`, taken no further where the pixel is [`SURELY_COVERED`].
    log_transmittance: Vec<f32>,
}

impl Coverage {
    /// A view that nothing covers.
    pub(super) fn new(view: &PinholeView) -> Self {
        Self { width: view.width, height: view.height, log_transmittance: vec![0.0; view.num_pixels()] }
    }

    /// Whether so much of a pixel (row-major index) shows through that it needs a background.
    pub(super) fn shows(&self, pixel: usize) -> bool {
        self.log_transmittance[pixel].exp() >= SHOWS
    }

    /// Nothing: adds round Gaussians.
    pub(super) fn add(&mut self, view: &PinholeView, rounds: &[Round]) {
        for round in rounds {
            let [x, y, z] = view.to_camera(round.at(view.time));
            if z <= crate::views::NEAR {
                continue;
            }
            let sigma = round.scale * view.fx / z;
            let at = (view.fx * x / z + view.cx, view.fy * y / z + view.cy);
            self.splat(at, sigma * sigma + BLUR, round);
        }
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the image before the cast")]
    fn splat(&mut self, (u, v): (f32, f32), variance: f32, round: &Round) {
        let reach = 2.0 * variance * round.log_opacity; // square of the radius, pixels
        if reach <= 0.0 {
            return;
        }
        let radius = reach.sqrt();
        let range = |centre: f32, size: usize| {
            let low = (centre - radius - 0.5).ceil().clamp(0.0, size as f32) as usize;
            let high = (centre + radius + 0.5).floor().clamp(0.0, size as f32) as usize;
            low..high
        };
        let columns = range(u, self.width);
        if columns.is_empty() {
            return;
        }
        for row in range(v, self.height) {
            let dy = row as f32 + 0.5 - v;
            let line = &mut self.log_transmittance[row * self.width..(row + 1) * self.width];
            for (column, cell) in columns.clone().zip(&mut line[columns.clone()]) {
                let dx = column as f32 + 0.5 - u;
                let q = dx * dx + dy * dy;
                if q < reach && *cell > SURELY_COVERED {
                    *cell += (1.0 - (round.opacity * (-0.5 * q / variance).exp()).min(0.999)).ln();
                }
            }
        }
    }
}

/// A round Gaussian.
#[derive(Clone, Copy, Debug)]
pub(super) struct Round {
    mean: [f32; 3],
    /// Moment at which it is there, seconds, and its velocity, metres a second.
    time: f32,
    velocity: [f32; 3],
    /// Standard deviation, metres.
    scale: f32,
    opacity: f32,
    /// Logarithm of the opacity over the smallest weight.
    log_opacity: f32,
}

impl Round {
    /// Those of a set, which move; the first log scale counts.
    pub(super) fn moving(set: &GaussianSet) -> Vec<Self> {
        let mut rounds = Self::of(&set.attributes);
        for (round, (&time, &velocity)) in rounds.iter_mut().zip(set.times.iter().zip(&set.velocities)) {
            (round.time, round.velocity) = (time, velocity);
        }
        rounds
    }

    /// Its mean at a moment, metres.
    fn at(&self, time: f32) -> [f32; 3] {
        std::array::from_fn(|k| self.mean[k] + self.velocity[k] * (time - self.time))
    }

    /// Those of raw attributes, which stand still; the first log scale counts.
    pub(super) fn of(rows: &[[f32; NUM_ATTRIBUTES]]) -> Vec<Self> {
        let of = |row: &[f32; NUM_ATTRIBUTES]| {
            let opacity = sigmoid(row[LOGIT_OPACITY]);
            Self {
                mean: [row[MEAN.start], row[MEAN.start + 1], row[MEAN.start + 2]],
                time: 0.0,
                velocity: [0.0; 3],
                scale: row[LOG_SCALE.start].exp(),
                opacity,
                log_opacity: (opacity / MIN_ALPHA).ln(),
            }
        };
        rows.par_iter().with_min_len(4096).map(of).collect()
    }
}
