//! Cost as a power of work.

use serde::Serialize;

/// Fewest sizes that a law is fitted to.
pub const FEWEST: usize = 3;
/// The largest work is at least so many times the smallest.
const LEAST_SPAN: f64 = 3.0;
/// An exponent above this needs an explanation.
pub const STEEP: f64 = 1.05;

/// `cost = factor * work^exponent`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PowerLaw {
    /// The exponent.
    pub exponent: f64,
    /// Its standard error.
    pub standard_error: f64,
    /// Cost of a work of 1.
    pub factor: f64,
    /// Sizes that it was fitted to.
    pub sizes: usize,
}

/// What something cost.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// How much was done.
    pub work: f64,
    /// What it cost.
    pub cost: f64,
}

impl PowerLaw {
    /// The law of samples that cost at least `floor`, below which fixed costs decide; `None` for fewer than [`FEWEST`] or where the
    /// work hardly changes.
    ///
    /// # Formula
    /// Least squares of the logarithms: exponent `Sxy / Sxx`, its standard error `sqrt(sum of squared residuals / (n - 2) / Sxx)`.
    pub fn of(samples: &[Sample], floor: f64) -> Option<Self> {
        let counts = |sample: &&Sample| sample.work > 0.0 && sample.cost >= floor && sample.cost > 0.0;
        let logs: Vec<[f64; 2]> = samples.iter().filter(counts).map(|s| [s.work.ln(), s.cost.ln()]).collect();
        let ends = |k: usize| {
            let values = || logs.iter().map(move |point| point[k]);
            values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min)
        };
        if logs.len() < FEWEST || ends(0) < LEAST_SPAN.ln() {
            return None;
        }
        let n = logs.len() as f64;
        let mean = |k: usize| logs.iter().map(|point| point[k]).sum::<f64>() / n;
        let [x0, y0] = [mean(0), mean(1)];
        let sxx: f64 = logs.iter().map(|[x, _]| (x - x0).powi(2)).sum();
        let sxy: f64 = logs.iter().map(|[x, y]| (x - x0) * (y - y0)).sum();
        let exponent = sxy / sxx;
        let squares: f64 = logs.iter().map(|[x, y]| (y - y0 - exponent * (x - x0)).powi(2)).sum();
        let standard_error = (squares / (n - 2.0) / sxx).sqrt();
        Some(Self { exponent, standard_error, factor: (y0 - exponent * x0).exp(), sizes: logs.len() })
    }

    /// The cost of a work.
    pub fn cost(&self, work: f64) -> f64 {
        self.factor * work.powf(self.exponent)
    }

    /// Whether cost grows clearly faster than work.
    pub fn is_steep(&self) -> bool {
        self.exponent > STEEP
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn law(samples: &[[f64; 2]], floor: f64) -> Option<PowerLaw> {
        let samples: Vec<Sample> = samples.iter().map(|&[work, cost]| Sample { work, cost }).collect();
        PowerLaw::of(&samples, floor)
    }

    #[test]
    fn a_power_is_found_again() {
        let samples = [1e3, 2e4, 5e5, 1e6].map(|work: f64| [work, 3e-7 * work.powf(1.25)]);
        let found = law(&samples, 0.0).unwrap();
        assert!((found.exponent - 1.25).abs() < 1e-12 && found.standard_error < 1e-9 && found.sizes == 4, "{found:?}");
        assert!((found.factor / 3e-7 - 1.0).abs() < 1e-9 && found.is_steep());
        assert!((found.cost(1e5) / (3e-7 * 1e5_f64.powf(1.25)) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn the_standard_error_is_that_of_the_slope() {
        // Logarithms (0, 0), (1, 1), (2, 1): slope 1/2, residuals -1/6, 1/3, -1/6, so 1/6 in squares, over 1 and over 2.
        let e = std::f64::consts::E;
        let found = law(&[[1.0, 1.0], [e, e], [e * e, e]], 0.0).unwrap();
        assert!((found.exponent - 0.5).abs() < 1e-12 && (found.standard_error - (1.0_f64 / 12.0).sqrt()).abs() < 1e-12);
        assert!(!found.is_steep());
    }

    #[test]
    fn fixed_costs_do_not_count_and_too_little_says_nothing() {
        let samples = [[1e2, 1e-3], [1e3, 1e-3], [1e4, 1e-2], [1e5, 1e-1], [1e6, 1.0]];
        let found = law(&samples, 5e-3).unwrap();
        assert!((found.exponent - 1.0).abs() < 1e-12 && found.sizes == 3);
        assert_eq!(law(&samples, 5e-2), None);
        assert_eq!(law(&[[1.0, 1.0], [1.5, 2.0], [2.0, 3.0]], 0.0), None, "the work hardly changes");
        assert_eq!(law(&[[0.0, 1.0], [1.0, f64::NAN], [10.0, 3.0], [20.0, 3.0]], 0.0), None);
        assert_eq!(law(&[], 0.0), None);
    }
}
