//! Least squares without negative coefficients.

/// A pivot below this is rounding: columns that grow alike.
const LEAST_PIVOT: f64 = 1e-9;

/// The `x` of the least squares of `row · x - 1` over all rows, none of it negative; zeros where no column says anything.
///
/// # Formula
/// The normal equations of every choice of columns; of the solutions without a negative coefficient the one with the least squares.
pub fn non_negative<const N: usize>(rows: &[[f64; N]]) -> [f64; N] {
    let dot = |row: &[f64; N], x: &[f64; N]| row.iter().zip(x).map(|(a, b)| a * b).sum::<f64>();
    let squares = |x: &[f64; N]| rows.iter().map(|row| (dot(row, x) - 1.0).powi(2)).sum::<f64>();
    let feasible = |used: u32| solve(rows, used).filter(|x| x.iter().all(|a| *a >= 0.0));
    (1..1 << N).filter_map(feasible).min_by(|a, b| squares(a).total_cmp(&squares(b))).unwrap_or([0.0; N])
}

/// The solution with the columns of the set bits of `used`, of any sign; `None` where they are not told apart.
fn solve<const N: usize>(rows: &[[f64; N]], used: u32) -> Option<[f64; N]> {
    let columns: Vec<usize> = (0..N).filter(|k| used >> k & 1 == 1).collect();
    let n = columns.len();
    // Columns may differ by ten decades: they are brought to one size first.
    let size: Vec<f64> = columns.iter().map(|&k| rows.iter().map(|row| row[k] * row[k]).sum::<f64>().sqrt()).collect();
    if size.iter().any(|size| !(*size > 0.0 && size.is_finite())) {
        return None;
    }
    let value = |row: &[f64; N], k: usize| row[columns[k]] / size[k];
    let (mut system, mut right) = ([[0.0; N]; N], [0.0; N]);
    for row in rows {
        for i in 0..n {
            (0..n).for_each(|j| system[i][j] += value(row, i) * value(row, j));
            right[i] += value(row, i);
        }
    }
    for pivot in 0..n {
        if system[pivot][pivot] < LEAST_PIVOT {
            return None;
        }
        for other in (0..n).filter(|&other| other != pivot) {
            let factor = system[other][pivot] / system[pivot][pivot];
            let row = system[pivot];
            system[other].iter_mut().zip(row).for_each(|(cell, from)| *cell -= factor * from);
            right[other] -= factor * right[pivot];
        }
    }
    let mut x = [0.0; N];
    (0..n).for_each(|k| x[columns[k]] = right[k] / system[k][k] / size[k]);
    Some(x)
}

#[cfg(test)]
mod tests {
    use super::non_negative;

    #[test]
    fn coefficients_are_found_again_and_none_is_negative() {
        let works = [[1e3, 5e2, 7.0], [2e3, 9e3, 1.0], [5e4, 1e4, 90.0], [8e4, 3e5, 2.0], [1e5, 1e3, 900.0]];
        for want in [[2e-6, 5e-7, 1e-4], [0.0, 3e-6, 0.0], [4e-6, 0.0, 2e-5]] {
            let cost = |work: &[f64; 3]| -> f64 { work.iter().zip(want).map(|(w, x)| w * x).sum() };
            let found = non_negative(&works.map(|work| work.map(|w| w / cost(&work))));
            for (got, want) in found.iter().zip(want) {
                assert!((got - want).abs() <= 1e-9 * want.max(1e-6), "{found:?}");
            }
        }
        // A cost that falls with the second column.
        let falls = [[1e3, 5e2], [2e3, 9e3], [5e4, 1e4], [8e4, 3e5]];
        let found = non_negative(&falls.map(|[x, y]| [x, y].map(|w| w * (1.0 + y) / x)));
        assert!(found[0] > 0.0 && found[1] == 0.0, "{found:?}");
    }

    #[test]
    fn what_grows_alike_counts_once_and_nothing_is_nothing() {
        let found = non_negative(&[1.0, 4.0, 9.0].map(|x| [x, 2.0 * x].map(|w| w / (6.0 * x))));
        assert!((found[0] + 2.0 * found[1] - 6.0).abs() < 1e-9, "{found:?}");
        assert_eq!(non_negative::<3>(&[]), [0.0; 3]);
        assert_eq!(non_negative(&[[0.0, f64::INFINITY]]), [0.0; 2]);
    }
}
