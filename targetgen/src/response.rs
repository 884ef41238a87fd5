//! The gradient response of primitives.

use lgs_engine::gaussians::NUM_ATTRIBUTES;
use rayon::prelude::*;

/// Keeps the quotient defined where no primitive has a gradient; below every gradient that there is, so that the response does not
/// change when the loss is multiplied by a constant.
const EPSILON: f64 = f64::MIN_POSITIVE;
/// Rows that a thread takes at a time.
const ROWS: usize = 1 << 14;

/// Gradients of one primitive by its raw attributes.
pub type GradientRow = [f32; NUM_ATTRIBUTES];

/// Largest absolute gradient of each attribute over all primitives of a branch.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Maxima(pub [f64; NUM_ATTRIBUTES]);

impl Maxima {
    /// Those of rows of gradients.
    pub fn of(gradients: &[GradientRow]) -> Self {
        let of_chunk =
            |rows: &[GradientRow]| rows.iter().fold(Self::default(), |maxima, row| maxima.with(&row.map(f64::from)));
        let chunks: Vec<Self> = gradients.par_chunks(ROWS).map(of_chunk).collect();
        chunks.iter().fold(Self::default(), |maxima, chunk| maxima.with(&chunk.0))
    }

    /// Those of this branch and of further rows.
    pub fn max(self, other: Self) -> Self {
        self.with(&other.0)
    }

    fn with(mut self, row: &[f64; NUM_ATTRIBUTES]) -> Self {
        self.0.iter_mut().zip(row).for_each(|(max, value)| *max = max.max(value.abs()));
        self
    }
}

/// `[N]` responses.
///
/// # Formula
/// `r_j = 1/D sum_c |grad_jc| / (max_c + eps)`.
///
/// # Source
/// The paper, section 3.2, local gradient response.
pub fn responses(gradients: &[GradientRow], maxima: &Maxima) -> Vec<f64> {
    let scale = maxima.0.map(|max| 1.0 / (NUM_ATTRIBUTES as f64 * (max + EPSILON)));
    // The inverse of a maximum of zero is finite, and so is its product with zeros.
    let response = |row: &GradientRow| row.iter().zip(&scale).map(|(g, s)| f64::from(g.abs()) * s).sum();
    gradients.par_iter().with_min_len(ROWS).map(response).collect()
}

/// Sets rows with a gradient that is not finite to zero; returns how many there were.
pub fn zero_non_finite(gradients: &mut [GradientRow]) -> usize {
    let spoiled = gradients.iter_mut().filter(|row| !row.iter().all(|g| g.is_finite()));
    spoiled.map(|row| row.fill(0.0)).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_response_is_the_mean_share_of_the_maxima_at_any_scale() {
        let row = |first: f32, last: f32| {
            let mut row = [0.0; NUM_ATTRIBUTES];
            (row[0], row[13]) = (first, last);
            row
        };
        for scale in [1e-12, 1.0, 1e6] {
            let rows = [row(2.0 * scale, 0.0), row(-4.0 * scale, 1.0 * scale), row(0.0, -0.5 * scale)];
            let got = responses(&rows, &Maxima::of(&rows));
            for (got, want) in got.iter().zip([0.5 / 14.0, 2.0 / 14.0, 0.5 / 14.0]) {
                assert!((got - want).abs() < 1e-7, "{got} {want}");
            }
        }
        assert_eq!(responses(&[row(0.0, 0.0)], &Maxima::default()), [0.0]);
    }

    #[test]
    fn rows_that_are_not_finite_become_zero() {
        let mut rows = [[1.0; NUM_ATTRIBUTES], [f32::NAN; NUM_ATTRIBUTES]];
        assert_eq!(zero_non_finite(&mut rows), 1);
        assert_eq!(rows, [[1.0; NUM_ATTRIBUTES], [0.0; NUM_ATTRIBUTES]]);
    }
}
