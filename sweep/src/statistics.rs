//! Order statistics of repeated measurements.

use serde::Serialize;

/// The middle of some values and how far they are spread.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Spread {
    /// A quarter of the values is below.
    pub q1: f64,
    /// Half of the values is below.
    pub median: f64,
    /// Three quarters of the values are below.
    pub q3: f64,
}

impl Spread {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quartiles_lie_between_the_values() {
        let of = |values: &[f64]| Spread::of(values.iter().copied()).map(|s| [s.q1, s.median, s.q3]);
        assert_eq!(of(&[3.0, 1.0, 2.0, 5.0, 4.0]), Some([2.0, 3.0, 4.0]));
        assert_eq!(of(&[4.0, 1.0]), Some([1.75, 2.5, 3.25]));
        assert_eq!(of(&[7.0]), Some([7.0; 3]));
        assert_eq!(of(&[]), None);
    }

    #[test]
    fn a_mean_of_nothing_is_none() {
        assert_eq!((mean([1.0, 2.0]), mean([])), (Some(1.5), None));
    }
}
