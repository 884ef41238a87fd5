//! How far apart the points of a cloud are.

use lgs_formats::casts::to_f32;

use crate::{error::Result, ops::knn::nearest_in_space, parallel};

/// How many neighbours the spacing is the mean over.
const NUM_NEIGHBOURS: usize = 3;

/// Spacings relative to the range may be so many times the usual one.
const MOST_TIMES_USUAL: f32 = 2.0;

/// The mean distance (metres) of the points `queries` to their three nearest neighbours among all; to as many as there are
/// when fewer exist, 0 for a lone point. Coincident points are neighbours at distance 0.
///
/// # Shapes
/// `positions` `[N, 3]`, `queries` `[M]` indices below N; result `[M]`.
///
/// # Errors
/// When a coordinate is not finite, or a query lies beyond the points.
pub fn spacing(positions: &[[f32; 3]], queries: &[u32]) -> Result<Vec<f32>> {
    let neighbours = nearest_in_space(positions, queries, NUM_NEIGHBOURS)?;
    let mean = |m: usize| {
        let found = &neighbours[m];
        found.iter().map(|near| to_f32(near.squared.sqrt())).sum::<f32>() / found.len().max(1) as f32
    };
    Ok(parallel::map(queries.len(), 1024, &mean))
}

/// The spacings, none wider than range times the usual angle between neighbours explains: a lone return in the air, or one at an edge of what the
/// sweep sees, is no wider than the others that far away.
///
/// # Shapes
/// `spacing` (metres) and `ranges` (metres from the sensor) `[M]`; result `[M]`.
///
/// # Formula
/// `min(s, 2 r median(s / r))`, the median over all of them.
pub fn bounded(spacing: &[f32], ranges: &[f32]) -> Vec<f32> {
    let mut angles: Vec<f32> = spacing.iter().zip(ranges).map(|(s, r)| s / r).filter(|a| a.is_finite()).collect();
    angles.sort_by(f32::total_cmp);
    let Some(&usual) = angles.get(angles.len() / 2) else { return spacing.to_vec() };
    spacing.iter().zip(ranges).map(|(s, r)| s.min(MOST_TIMES_USUAL * usual * r)).collect()
}

#[cfg(test)]
mod tests {
    use super::{bounded, spacing};

    #[test]
    fn the_mean_over_three_or_fewer() {
        let points = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0], [9.0, 9.0, 9.0]];
        assert_eq!(spacing(&points, &[0]).unwrap(), [2.0]);
        assert_eq!(spacing(&points[..2], &[1, 0]).unwrap(), [1.0, 1.0]);
        assert_eq!(spacing(&points[..1], &[0]).unwrap(), [0.0]);
        assert_eq!(spacing(&[[4.0; 3]; 9], &[8]).unwrap(), [0.0]);
        assert!(spacing(&[], &[]).unwrap().is_empty());
        assert!(spacing(&[[f32::NAN; 3]], &[0]).is_err() && spacing(&[], &[0]).is_err());
    }

    #[test]
    fn lone_returns_are_no_wider_than_others_at_their_range() {
        let (spacing, ranges) = ([0.1, 0.2, 0.1, 5.0, 0.0], [10.0, 20.0, 10.0, 30.0, 0.0]);
        assert_eq!(bounded(&spacing, &ranges)[..3], spacing[..3]);
        assert!((bounded(&spacing, &ranges)[3] - 0.6).abs() < 1e-6);
        assert_eq!(bounded(&[4.0], &[0.0]), [4.0], "a return at the sensor tells no angle");
        assert!(bounded(&[], &[]).is_empty());
    }

    #[test]
    fn equals_a_plain_search() {
        let points: Vec<[f32; 3]> = (0..2000_u32)
            .map(|i| [0.754_877_7_f32, 0.569_840_3, 0.219_51].map(|a| (i as f32 * a).fract() * 30.0))
            .collect();
        let queries: Vec<u32> = (0..2000).step_by(7).collect();
        let got = spacing(&points, &queries).unwrap();
        for (&i, got) in queries.iter().zip(got) {
            let square = |a: f32, b: f32| (f64::from(a) - f64::from(b)).powi(2);
            let distance = |q: &[f32; 3]| (0..3).map(|c| square(points[i as usize][c], q[c])).sum::<f64>().sqrt();
            let mut all: Vec<f64> = points.iter().map(distance).collect();
            all.sort_by(f64::total_cmp);
            let want = all[1..4].iter().sum::<f64>() / 3.0;
            assert!((f64::from(got) - want).abs() < 1e-6 * want, "point {i}: {got}, want {want}");
        }
    }
}
