//! What a recipe would take on a clip, from what it took on others.

use super::{least_squares::non_negative, work::ClipWork};

/// Constant, points, pixels.
const TERMS: usize = 3;
/// Square of the distance, in logarithms of the work, at which a clip stops to count as the same.
const SAME: f64 = 1e-4;

/// `a + b points + c pixels`, none of them negative.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Line([f64; TERMS]);

fn terms(work: &ClipWork) -> [f64; TERMS] {
    [1.0, work.points as f64, work.pixels as f64]
}

impl Line {
    /// The line with the least squares of relative errors through `samples` of work and seconds, all above zero.
    pub(super) fn through(samples: &[(ClipWork, f64)]) -> Self {
        let row = |(work, seconds): &(ClipWork, f64)| terms(work).map(|term| term / seconds);
        Self(non_negative(&samples.iter().map(row).collect::<Vec<_>>()))
    }

    pub(super) fn at(&self, work: &ClipWork) -> f64 {
        terms(work).iter().zip(&self.0).map(|(x, a)| x * a).sum()
    }
}

/// The mean of `values` of clips for a clip of other work: those that are alike count most, and one that is the same alone.
pub(super) fn alike(values: &[(ClipWork, f64)], work: &ClipWork) -> f64 {
    let log = |work: &ClipWork| [work.points, work.pixels].map(|count| (count.max(1) as f64).ln());
    let here = log(work);
    let weight = |other: &ClipWork| -> f64 {
        let apart: f64 = log(other).iter().zip(here).map(|(a, b)| (a - b).powi(2)).sum();
        1.0 / (apart + SAME)
    };
    let total: f64 = values.iter().map(|(other, _)| weight(other)).sum();
    values.iter().map(|(other, value)| weight(other) * value).sum::<f64>() / total
}

/// Seconds on a clip, from `samples` of work and seconds on others: the line through them, with what it misses on clips that are alike.
/// Samples that are not above zero say nothing; 0 without any.
pub(super) fn seconds(samples: &[(ClipWork, f64)], work: &ClipWork) -> f64 {
    let samples: Vec<_> = samples.iter().copied().filter(|(_, s)| *s > 0.0 && s.is_finite()).collect();
    if samples.is_empty() {
        return 0.0;
    }
    let line = Line::through(&samples);
    let missed: Vec<_> = samples.iter().map(|(work, seconds)| (*work, (seconds / line.at(work)).ln())).collect();
    line.at(work) * alike(&missed, work).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn work(points: usize, pixels: usize) -> ClipWork {
        ClipWork { points, pixels, views: 1 }
    }

    #[test]
    fn a_line_is_found_and_never_falls() {
        let sample = |points, pixels| (work(points, pixels), 0.1 + 2e-6 * points as f64 + 3e-7 * pixels as f64);
        let samples = [
            sample(10_000, 1_000_000),
            sample(50_000, 2_000_000),
            sample(300_000, 1_500_000),
            sample(90_000, 9_000_000),
        ];
        let there = work(120_000, 4_000_000);
        assert!((seconds(&samples, &there) - sample(120_000, 4_000_000).1).abs() < 1e-6);
        // Less time for more points is chance: no term is negative.
        let odd = [(work(10, 10), 2.0), (work(1000, 10), 1.0), (work(100, 10), 1.5)];
        let Line(found) = Line::through(&odd);
        assert!(found.iter().all(|a| *a >= 0.0), "{found:?}");
        assert!(seconds(&odd, &work(1_000_000, 10)) >= seconds(&odd, &work(100_000, 10)));
    }

    #[test]
    fn a_clip_that_was_measured_takes_what_it_took() {
        let samples = [(work(10_000, 1_000_000), 1.0), (work(20_000, 1_000_000), 5.0), (work(90_000, 7_000_000), 3.0)];
        for (work, taken) in &samples {
            assert!((seconds(&samples, work) / taken - 1.0).abs() < 0.01);
        }
        assert!(seconds(&samples[..1], &work(5, 5)) > 0.0);
        assert_eq!(seconds(&[], &work(5, 5)), 0.0);
        assert_eq!(seconds(&[(work(1, 1), f64::NAN)], &work(5, 5)), 0.0);
    }
}
