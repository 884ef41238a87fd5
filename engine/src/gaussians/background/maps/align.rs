//! The scale and the shift that bring a depth map to metres: a line through the returns that fall on it, in inverse depth.
//!
//! # Source
//! Rousseeuw, Least median of squares regression, 1984, over fixed pairs instead of random ones; then weights of Beaton and Tukey, 1974.
//! Inverse depth and the two unknowns after Ranftl et al., Towards robust monocular depth estimation, 2020.

/// Lines are proposed by pairs among so many returns, spread evenly over the map's values.
const PIVOTS: usize = 32;
/// Lines are judged by so many returns at most.
const JUDGES: usize = 768;
/// Residuals are taken relative to the inverse depth plus this, 1 / metres: near returns, which are most, do not decide alone, nor do those
/// of which nothing but "far" is known.
const FAR: f64 = 0.01;
/// Rounds of the weighted fit that follows.
const ROUNDS: usize = 12;
/// Returns farther from the line than this many standard deviations of the better half do not count.
const CUT: f64 = 4.0;
/// Standard deviations of a normal distribution in its median of absolute values.
const DEVIATIONS: f64 = 1.4826;
/// A residual that is as good as none.
const EXACT: f64 = 1e-6;
/// Smallest spread of a map's values at the returns, as a share of their size.
const MIN_SPREAD: f64 = 1e-3;

/// A return on a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pair {
    /// Value of the map.
    pub(super) value: f64,
    /// Inverse depth of the return, 1 / metres.
    pub(super) inverse: f64,
}

/// `inverse depth = scale * value + shift`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Line {
    pub(super) scale: f64,
    pub(super) shift: f64,
}

impl Line {
    /// The line of a map that is in 1 / metres already.
    pub(super) const IDENTITY: Self = Self { scale: 1.0, shift: 0.0 };

    /// The inverse depth of a value, 1 / metres.
    pub(super) fn at(self, value: f64) -> f64 {
        self.scale * value + self.shift
    }

    fn residual(self, pair: Pair) -> f64 {
        (self.at(pair.value) - pair.inverse) / (pair.inverse + FAR)
    }

    /// The median of the absolute residuals.
    pub(super) fn error(self, pairs: &[Pair]) -> f64 {
        median(pairs.iter().map(|&pair| self.residual(pair).abs()).collect())
    }

    /// The share of the pairs that are within a tenth of the line.
    pub(super) fn inliers(self, pairs: &[Pair]) -> f64 {
        let near = pairs.iter().filter(|&&pair| self.residual(pair).abs() < 0.1).count();
        near as f64 / pairs.len().max(1) as f64
    }
}

/// The line of most of the pairs; `None` where they do not tell one that grows. The same for any order of the pairs.
pub(super) fn fit(pairs: &[Pair]) -> Option<Line> {
    let mut sorted = pairs.to_vec();
    sorted.sort_by(|a, b| a.value.total_cmp(&b.value).then(a.inverse.total_cmp(&b.inverse)));
    let (low, high) = (sorted.first()?.value, sorted.last()?.value);
    if high - low <= MIN_SPREAD * low.abs().max(high.abs()) {
        return None;
    }
    let (pivots, judges) = (spread(&sorted, PIVOTS), spread(&sorted, JUDGES));
    let mut best: Option<(f64, Line)> = None;
    for (i, a) in pivots.iter().enumerate() {
        for b in &pivots[i + 1..] {
            let Some(line) = through(*a, *b) else { continue };
            let error = line.error(&judges);
            if best.is_none_or(|(least, _)| error < least) {
                best = Some((error, line));
            }
        }
    }
    let (_, mut line) = best?;
    for _ in 0..ROUNDS {
        let Some(next) = weighted(&sorted, line) else { break };
        line = next;
    }
    (line.scale > 0.0 && line.scale.is_finite() && line.shift.is_finite()).then_some(line)
}

/// At most `count` of a list, evenly spread, its ends among them.
fn spread(pairs: &[Pair], count: usize) -> Vec<Pair> {
    if pairs.len() <= count {
        return pairs.to_vec();
    }
    (0..count).map(|k| pairs[k * (pairs.len() - 1) / (count - 1)]).collect()
}

fn through(a: Pair, b: Pair) -> Option<Line> {
    let scale = (b.inverse - a.inverse) / (b.value - a.value);
    (scale > 0.0 && scale.is_finite()).then_some(Line { scale, shift: a.inverse - scale * a.value })
}

/// The line of least squares, each pair weighted by how near it is to `line`.
fn weighted(pairs: &[Pair], line: Line) -> Option<Line> {
    let cut = CUT * DEVIATIONS * line.error(pairs).max(EXACT);
    let [mut n, mut sx, mut sy, mut sxx, mut sxy] = [0.0; 5];
    // Values around their middle, so that a large shift costs no digits.
    let middle = pairs.get(pairs.len() / 2)?.value;
    for &pair in pairs {
        let share = line.residual(pair) / cut;
        if share.abs() < 1.0 {
            let unit = pair.inverse + FAR;
            let weight = (1.0 - share * share) * (1.0 - share * share) / (unit * unit);
            let x = pair.value - middle;
            n += weight;
            sx += weight * x;
            sy += weight * pair.inverse;
            sxx += weight * x * x;
            sxy += weight * x * pair.inverse;
        }
    }
    let determinant = n * sxx - sx * sx;
    if determinant.is_nan() || determinant <= 1e-12 * n * sxx {
        return None;
    }
    let scale = (n * sxy - sx * sy) / determinant;
    let shift = (sy - scale * sx) / n - scale * middle;
    (scale > 0.0).then_some(Line { scale, shift })
}

/// The middle value of a list; infinity of an empty one.
fn median(mut values: Vec<f64>) -> f64 {
    let middle = values.len() / 2;
    if values.is_empty() {
        return f64::INFINITY;
    }
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns at depths from 3 to 90 m on a map of `inverse = scale * value + shift`, every `wrong`-th of them far off.
    fn pairs(scale: f64, shift: f64, wrong: usize) -> Vec<Pair> {
        let pair = |k: u32| {
            let inverse = 1.0 / (3.0 + 0.3 * f64::from(k));
            let value = (inverse - shift) / scale;
            let outlier = wrong > 0 && (k as usize).is_multiple_of(wrong);
            Pair { value, inverse: if outlier { 0.4 - 0.3 * inverse } else { inverse } }
        };
        (0..290).map(pair).collect()
    }

    #[test]
    fn scale_and_shift_come_back_through_outliers() {
        for (scale, shift) in [(1.0, 0.0), (0.0004, -0.01), (17.0, 0.3), (1e-6, 0.002)] {
            for wrong in [0, 5, 3] {
                let line = fit(&pairs(scale, shift, wrong)).unwrap();
                assert!((line.scale / scale - 1.0).abs() < 1e-6, "{line:?} of {scale}, {shift}, {wrong}");
                assert!((line.shift - shift).abs() < 1e-8, "{line:?} of {scale}, {shift}, {wrong}");
            }
        }
    }

    #[test]
    fn noise_moves_the_line_little_and_is_reported() {
        let noisy = |(k, pair): (u32, Pair)| {
            let noise = 0.05 * (f64::from(k) * 2.4).sin();
            Pair { inverse: pair.inverse * (1.0 + noise), ..pair }
        };
        let noisy: Vec<Pair> = (0..).zip(pairs(0.5, 0.02, 4)).map(noisy).collect();
        let line = fit(&noisy).unwrap();
        assert!((line.scale / 0.5 - 1.0).abs() < 0.02 && (line.shift - 0.02).abs() < 5e-4, "{line:?}");
        assert!((0.01..0.06).contains(&line.error(&noisy)), "{}", line.error(&noisy));
        assert!((0.7..0.8).contains(&line.inliers(&noisy)), "{}", line.inliers(&noisy));
    }

    #[test]
    fn what_tells_no_line_gives_none() {
        let flat = vec![Pair { value: 7.0, inverse: 0.1 }; 50];
        let falling: Vec<Pair> = pairs(1.0, 0.0, 0).iter().map(|p| Pair { value: -p.value, ..*p }).collect();
        for bad in [Vec::new(), flat[..1].to_vec(), flat, falling] {
            assert_eq!(fit(&bad), None, "{} pairs", bad.len());
        }
        let huge = [Pair { value: 1e300, inverse: 0.1 }, Pair { value: -1e300, inverse: 0.01 }];
        assert!(fit(&huge).is_none_or(|line| line.scale > 0.0 && line.shift.is_finite()));
    }

    #[test]
    fn the_order_of_the_returns_does_not_matter() {
        let mut all = pairs(0.3, 0.01, 4);
        let line = fit(&all).unwrap();
        all.reverse();
        assert_eq!(fit(&all), Some(line));
    }
}
