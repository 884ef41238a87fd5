//! What a recipe would take on a clip, from what it took on others.

use super::record::ClipWork;

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
        let rows: Vec<[f64; TERMS]> =
            samples.iter().map(|(work, seconds)| terms(work).map(|term| term / seconds)).collect();
        let error = |line: &[f64; TERMS]| -> f64 {
            rows.iter().map(|row| (row.iter().zip(line).map(|(x, a)| x * a).sum::<f64>() - 1.0).powi(2)).sum()
        };
        let feasible = |used: u32| solve(&rows, used).filter(|line| line.iter().all(|a| *a >= 0.0));
        let best = (1..1 << TERMS).filter_map(feasible).min_by(|a, b| error(a).total_cmp(&error(b)));
        Self(best.unwrap_or_default())
    }

    pub(super) fn at(&self, work: &ClipWork) -> f64 {
        terms(work).iter().zip(&self.0).map(|(x, a)| x * a).sum()
    }
}

/// Least squares of `rows * line = 1` with the terms of the set bits of `used`; `None` where they are not told apart.
fn solve(rows: &[[f64; TERMS]], used: u32) -> Option<[f64; TERMS]> {
    let columns: Vec<usize> = (0..TERMS).filter(|k| used >> k & 1 == 1).collect();
    let n = columns.len();
    // Terms differ by ten decades: columns are brought to one size first.
    let size: Vec<f64> = columns.iter().map(|&k| rows.iter().map(|row| row[k] * row[k]).sum::<f64>().sqrt()).collect();
    if size.iter().any(|size| !(*size > 0.0 && size.is_finite())) {
        return None;
    }
    let value = |row: &[f64; TERMS], k: usize| row[columns[k]] / size[k];
    let mut system = [[0.0; TERMS + 1]; TERMS];
    for row in rows {
        for (i, line) in system.iter_mut().take(n).enumerate() {
            for (j, cell) in line.iter_mut().take(n).enumerate() {
                *cell += value(row, i) * value(row, j);
            }
            line[TERMS] += value(row, i);
        }
    }
    for pivot in 0..n {
        if system[pivot][pivot] < 1e-9 {
            return None;
        }
        for other in (0..n).filter(|&other| other != pivot) {
            let factor = system[other][pivot] / system[pivot][pivot];
            let row = system[pivot];
            system[other].iter_mut().zip(row).for_each(|(cell, from)| *cell -= factor * from);
        }
    }
    let mut line = [0.0; TERMS];
    (0..n).for_each(|k| line[columns[k]] = system[k][TERMS] / system[k][k] / size[k]);
    Some(line)
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
        let of = |points, pixels| (work(points, pixels), 0.1 + 2e-6 * points as f64 + 3e-7 * pixels as f64);
        let samples = [of(10_000, 1_000_000), of(50_000, 2_000_000), of(300_000, 1_500_000), of(90_000, 9_000_000)];
        let there = work(120_000, 4_000_000);
        assert!((seconds(&samples, &there) - of(120_000, 4_000_000).1).abs() < 1e-6);
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
