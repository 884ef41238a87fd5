//! Cost as a power of work.

use lgs_engine::plan::non_negative;
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

/// Kinds of work that a part has at most.
pub const KINDS: usize = 3;
/// How much there is of each kind of work.
pub type Counts = [f64; KINDS];

/// What one unit of each kind of work costs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Rates(pub Counts);

impl Rates {
    /// The rates of costs that work made, none below 0; costs of 0 do not count.
    ///
    /// # Formula
    /// Least squares of `sum_k rate_k work_k / cost - 1`, so that small and large costs count alike.
    pub fn of(samples: &[(Counts, f64)]) -> Self {
        let known = samples.iter().filter(|(_, cost)| *cost > 0.0);
        Self(non_negative(&known.map(|(work, cost)| work.map(|w| w / cost)).collect::<Vec<_>>()))
    }

    /// What work costs by the rates.
    fn cost(&self, work: Counts) -> f64 {
        self.0.iter().zip(work).map(|(rate, count)| rate * count).sum()
    }

    /// The kind that the others are counted in: the first that costs something.
    pub fn first(&self) -> usize {
        self.0.iter().position(|rate| *rate > 0.0).unwrap_or(0)
    }

    /// Work of several kinds, counted in units of [`Rates::first`].
    pub fn joined(&self, work: Counts) -> f64 {
        let unit = self.0[self.first()];
        if unit > 0.0 { self.cost(work) / unit } else { work[0] }
    }
}

impl PowerLaw {
    /// The law of samples that cost at least `floor`, below which fixed costs decide; `None` for fewer than [`FEWEST`] or where the
    /// work hardly changes.
    ///
    /// # Formula
    /// Least squares of the logarithms: exponent `Sxy / Sxx`, its standard error `sqrt(sum of squared residuals / (n - 2) / Sxx)`.
    pub fn of(samples: &[Sample], floor: f64) -> Option<Self> {
        let is_known = |value: f64| value > 0.0 && value.is_finite();
        let counts = |sample: &&Sample| is_known(sample.work) && is_known(sample.cost) && sample.cost >= floor;
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
        // Work over a rate next to nothing may differ beyond what logarithms say.
        let is_sound = exponent.is_finite() && standard_error.is_finite();
        is_sound.then(|| Self { exponent, standard_error, factor: (y0 - exponent * x0).exp(), sizes: logs.len() })
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
    fn what_is_not_finite_does_not_count() {
        let sound = [[1e3, 1.0], [1e4, 10.0], [1e5, 100.0]];
        let spoiled = [sound.as_slice(), &[[f64::INFINITY, 3.0], [10.0, f64::NAN]]].concat();
        assert_eq!(law(&spoiled, 0.0), law(&sound, 0.0));
        assert!(law(&spoiled[2..], 0.0).is_none());
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
    fn work_is_counted_in_the_first_kind_that_costs_something() {
        let works = [[1e3, 5e2, 7.0], [2e3, 9e3, 1.0], [5e4, 1e4, 90.0], [8e4, 3e5, 2.0], [1e5, 1e3, 900.0]];
        let rates = Rates([0.0, 2.0, 1.0]);
        let mut samples = works.map(|work| (work, rates.cost(work))).to_vec();
        // A cost of nothing says nothing.
        samples.push(([1.0; KINDS], 0.0));
        for (got, want) in Rates::of(&samples).0.iter().zip(rates.0) {
            assert!((got - want).abs() <= 1e-9, "{got} {want}");
        }
        assert_eq!((rates.first(), rates.joined([5.0, 10.0, 4.0])), (1, 12.0));
        assert_eq!(Rates::of(&[]), Rates::default());
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
