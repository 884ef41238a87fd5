//! Linear systems of many unknowns.

/// Solves a system of a positive definite matrix `[N, N]`; the solution takes the place of the right side.
pub(crate) fn cholesky(a: &mut [f64], b: &mut [f64]) {
    let n = b.len();
    for j in 0..n {
        let own = a[j * n + j] - (0..j).map(|k| a[j * n + k].powi(2)).sum::<f64>();
        let pivot = own.max(f64::MIN_POSITIVE).sqrt();
        a[j * n + j] = pivot;
        for i in j + 1..n {
            let rest = a[i * n + j] - (0..j).map(|k| a[i * n + k] * a[j * n + k]).sum::<f64>();
            a[i * n + j] = rest / pivot;
        }
    }
    for i in 0..n {
        b[i] = (b[i] - (0..i).map(|k| a[i * n + k] * b[k]).sum::<f64>()) / a[i * n + i];
    }
    for i in (0..n).rev() {
        b[i] = (b[i] - (i + 1..n).map(|k| a[k * n + i] * b[k]).sum::<f64>()) / a[i * n + i];
    }
}

#[cfg(test)]
mod tests {
    use super::cholesky;

    #[test]
    fn a_system_is_solved() {
        let mut matrix = vec![4.0, 2.0, 0.0, 2.0, 5.0, 1.0, 0.0, 1.0, 3.0];
        let solution = [1.0, -2.0, 3.0];
        let mut right: Vec<f64> =
            matrix.chunks_exact(3).map(|row| row.iter().zip(solution).map(|(a, x)| a * x).sum()).collect();
        cholesky(&mut matrix, &mut right);
        assert!(right.iter().zip(solution).all(|(found, x)| (found - x).abs() < 1e-12), "{right:?}");
    }
}
