//! Order statistics of repeated measurements; means, spreads and paired tests over scenes.

use serde::Serialize;
use statrs::distribution::{Binomial, ContinuousCDF, DiscreteCDF, StudentsT};

/// The middle of some values and how far they are spread.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Quartiles {
    /// A quarter of the values is below.
    pub q1: f64,
    /// Half of the values is below.
    pub median: f64,
    /// Three quarters of the values are below.
    pub q3: f64,
}

impl Quartiles {
    /// Of some values, in between linearly; `None` of none.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Option<Self> {
        let mut sorted: Vec<f64> = values.into_iter().collect();
        sorted.sort_by(f64::total_cmp);
        let last = sorted.len().checked_sub(1)?;
        let at = |quarters: usize| {
            let (whole, rest) = (quarters * last / 4, (quarters * last % 4) as f64 / 4.0);
            sorted[whole] + rest * (sorted[(whole + 1).min(last)] - sorted[whole])
        };
        Some(Self { q1: at(1), median: at(2), q3: at(3) })
    }
}

/// The mean; `None` of none.
pub fn mean(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let all: Vec<f64> = values.into_iter().collect();
    (!all.is_empty()).then(|| all.iter().sum::<f64>() / all.len() as f64)
}

/// Mean and spread of some values.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// How many values there are.
    pub count: usize,
    /// Their mean.
    pub mean: f64,
    /// Their standard deviation (n - 1); 0 for one value.
    pub deviation: f64,
}

/// A paired comparison over scenes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Paired {
    /// The differences.
    pub difference: Spread,
    /// Probability of a mean difference as far from 0 by chance: Student's t, two sides; `None` for fewer than two scenes, or where all
    /// differences are the same.
    pub p_t: Option<f64>,
    /// Scenes with a difference above 0.
    pub wins: usize,
    /// Probability of as uneven a count of wins and losses by chance: the sign test, two sides, without ties; `None` without any.
    pub p_sign: Option<f64>,
}

impl Spread {
    /// Of some values; `None` for none.
    pub fn of(values: &[f64]) -> Option<Self> {
        let count = values.len();
        if count == 0 {
            return None;
        }
        let mean = values.iter().sum::<f64>() / count as f64;
        let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
        let deviation = if count > 1 { (squares / (count - 1) as f64).sqrt() } else { 0.0 };
        Some(Self { count, mean, deviation })
    }
}

impl Paired {
    /// Of the differences of each scene; `None` for none.
    pub fn of(differences: &[f64]) -> Option<Self> {
        let difference = Spread::of(differences)?;
        let wins = differences.iter().filter(|d| **d > 0.0).count();
        let losses = differences.iter().filter(|d| **d < 0.0).count();
        Some(Self { difference, p_t: p_t(&difference), wins, p_sign: p_sign(wins, losses) })
    }
}

fn p_t(difference: &Spread) -> Option<f64> {
    let count = difference.count as f64;
    let t = difference.mean / (difference.deviation / count.sqrt());
    let distribution = StudentsT::new(0.0, 1.0, count - 1.0).ok().filter(|_| t.is_finite())?;
    Some((2.0 * distribution.cdf(-t.abs())).min(1.0))
}

fn p_sign(wins: usize, losses: usize) -> Option<f64> {
    let trials = (wins + losses) as u64;
    let fair = Binomial::new(0.5, trials).ok().filter(|_| trials > 0)?;
    Some((2.0 * fair.cdf(wins.min(losses) as u64)).min(1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quartiles_lie_between_the_values() {
        let quartiles = |values: &[f64]| Quartiles::of(values.iter().copied()).map(|s| [s.q1, s.median, s.q3]);
        assert_eq!(quartiles(&[3.0, 1.0, 2.0, 5.0, 4.0]), Some([2.0, 3.0, 4.0]));
        assert_eq!(quartiles(&[4.0, 1.0]), Some([1.75, 2.5, 3.25]));
        assert_eq!(quartiles(&[7.0]), Some([7.0; 3]));
        assert_eq!(quartiles(&[]), None);
    }

    #[test]
    fn a_mean_of_nothing_is_none() {
        assert_eq!((mean([1.0, 2.0]), mean([])), (Some(1.5), None));
    }

    /// Student's sleep data: t = -4.0621 with 9 degrees of freedom, p = 0.002833 (R's `t.test(extra ~ group, sleep, paired)`).
    #[test]
    fn the_sleep_data() {
        let differences = [1.2, 2.4, 1.3, 1.3, 0.0, 1.0, 1.8, 0.8, 4.6, 1.4];
        let paired = Paired::of(&differences).unwrap();
        assert!(
            (paired.difference.mean - 1.58).abs() < 1e-12 && (paired.difference.deviation - 1.229_995).abs() < 1e-6
        );
        assert!((paired.p_t.unwrap() - 0.002_833).abs() < 1e-6, "{paired:?}");
        // Nine wins, no loss, one tie: 2 / 2^9.
        assert_eq!((paired.wins, paired.p_sign.map(|p| (p * 512.0).round())), (9, Some(2.0)));
    }

    #[test]
    fn too_little_to_say_is_no_p() {
        assert_eq!(Paired::of(&[]), None);
        let one = Paired::of(&[0.3]).unwrap();
        assert!(one.p_t.is_none() && one.p_sign.is_some_and(|p| (p - 1.0).abs() < 1e-9), "{one:?}");
        let same = Paired::of(&[0.0, 0.0]).unwrap();
        assert_eq!((same.p_t, same.p_sign, same.wins), (None, None, 0));
        assert_eq!(Spread::of(&[2.0]).unwrap().deviation, 0.0);
    }
}
