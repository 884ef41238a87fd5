//! Rank correlation and sign agreement.

/// A rank correlation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Correlation {
    /// Spearman's coefficient, -1..=1; 0 where one of the two has no variance.
    pub value: f64,
    /// Its standard error.
    pub error: f64,
}

/// Spearman's rank correlation of pairs; ties share the mean of their ranks.
///
/// # Formula
/// Pearson's coefficient of the ranks; standard error `(1 - r^2) sqrt((1 + r^2 / 2) / (n - 3))`.
///
/// # Source
/// Bonett and Wright, Sample size requirements for estimating Pearson, Kendall and Spearman correlations, 2000.
pub fn rank_correlation(a: &[f64], b: &[f64]) -> Correlation {
    let (a, b) = (ranks(a), ranks(b));
    let mean = (a.len() as f64 + 1.0) / 2.0;
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - mean) * (b - mean)).sum::<f64>();
    let size = (product(&a, &a) * product(&b, &b)).sqrt();
    let value = if size > 0.0 { product(&a, &b) / size } else { 0.0 };
    let error = (1.0 - value * value) * ((1.0 + value * value / 2.0) / (a.len() as f64 - 3.0).max(1.0)).sqrt();
    Correlation { value, error }
}

/// Share of pairs whose signs agree, of those of which neither is 0.
pub fn sign_agreement(a: &[f64], b: &[f64]) -> f64 {
    let pairs: Vec<bool> =
        a.iter().zip(b).filter(|(a, b)| **a != 0.0 && **b != 0.0).map(|(a, b)| a * b > 0.0).collect();
    pairs.iter().filter(|agree| **agree).count() as f64 / pairs.len().max(1) as f64
}

/// Ranks from 1.
fn ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
    let mut ranks = vec![0.0; values.len()];
    let mut next = 0;
    for tied in order.chunk_by(|&a, &b| values[a] == values[b]) {
        let rank = next as f64 + (tied.len() as f64 + 1.0) / 2.0;
        tied.iter().for_each(|&i| ranks[i] = rank);
        next += tied.len();
    }
    ranks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_correlate_whatever_the_scale_and_ties_share() {
        let a = [1.0, 5.0, 2.0, 9.0, 3.0];
        assert_eq!(rank_correlation(&a, &a.map(|x: f64| x.exp())).value, 1.0);
        assert_eq!(rank_correlation(&a, &a.map(|x| -x)).value, -1.0);
        assert_eq!(rank_correlation(&a, &[0.0; 5]).value, 0.0);
        assert_eq!(ranks(&[3.0, 1.0, 3.0]), [2.5, 1.0, 2.5]);
        // 1 - 6 sum d^2 / (n (n^2 - 1)) with d = 1, -1, 0, 0
        let got = rank_correlation(&[1.0, 2.0, 3.0, 4.0], &[2.0, 1.0, 3.0, 4.0]);
        assert!((got.value - 0.8).abs() < 1e-12 && got.error > 0.0);
    }

    #[test]
    fn signs_agree_where_both_have_one() {
        assert_eq!(sign_agreement(&[1.0, -1.0, 0.0, 2.0], &[2.0, 1.0, 1.0, 0.0]), 0.5);
    }
}
