//! Comparisons that say index, got, want and tolerance when they fail.

use crate::Outcome;

/// Fails with the worst value whose distance to `want` is over `absolute + relative |want|`; values at which `weight` is
/// false take no part.
pub fn close_where(
    what: &str,
    got: &[f64],
    want: &[f64],
    tolerance: Tolerance,
    weight: impl Fn(usize) -> bool,
) -> Outcome {
    if got.len() != want.len() {
        return Err(format!("{what}: {} values, want {}", got.len(), want.len()).into());
    }
    let excess = |i: usize| (got[i] - want[i]).abs() / (tolerance.absolute + tolerance.relative * want[i].abs());
    let mut worst: Option<usize> = None;
    let mut num_wrong = 0_usize;
    for i in (0..got.len()).filter(|&i| weight(i)) {
        let wrong = !(excess(i) <= 1.0 || got[i] == want[i]);
        num_wrong += usize::from(wrong);
        if wrong && worst.is_none_or(|w| excess(i) > excess(w) || excess(i).is_nan()) {
            worst = Some(i);
        }
    }
    let Some(i) = worst else { return Ok(()) };
    let text = format!(
        "{what}[{i}]: got {:e}, want {:e}, tolerance {:e} + {:e} |want|; {num_wrong} of {} values are off",
        got[i],
        want[i],
        tolerance.absolute,
        tolerance.relative,
        got.len()
    );
    Err(text.into())
}

/// [`close_where`] over every value.
pub fn close(what: &str, got: &[f64], want: &[f64], tolerance: Tolerance) -> Outcome {
    close_where(what, got, want, tolerance, |_| true)
}

/// How far a value may be off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// In the unit of the value.
    pub absolute: f64,
    /// As a part of the wanted value.
    pub relative: f64,
}

/// An absolute tolerance.
pub const fn absolute(absolute: f64) -> Tolerance {
    Tolerance { absolute, relative: 0.0 }
}

/// A relative tolerance above an absolute floor.
pub const fn relative(relative: f64, floor: f64) -> Tolerance {
    Tolerance { absolute: floor, relative }
}

/// Fails when `|got - want|_2 > tolerance max(|want|_2, floor)`; names the entry that is furthest off.
///
/// `floor` is the size below which the whole tensor is rounding noise of larger numbers.
pub fn close_l2(what: &str, got: &[f64], want: &[f64], tolerance: f64, floor: f64) -> Outcome {
    if got.len() != want.len() {
        return Err(format!("{what}: {} values, want {}", got.len(), want.len()).into());
    }
    let size = l2(want).max(floor);
    let error = l2(&got.iter().zip(want).map(|(g, w)| g - w).collect::<Vec<_>>());
    if error <= tolerance * size || got == want {
        return Ok(());
    }
    let distance = |i: usize| (got[i] - want[i]).abs();
    let worst = (0..got.len()).max_by(|&a, &b| distance(a).total_cmp(&distance(b))).unwrap_or(0);
    let text = format!(
        "{what}: relative L2 error {:e}, tolerance {tolerance:e} (|want| {size:e}); worst at [{worst}]: got {:e}, want {:e}",
        error / size,
        got[worst],
        want[worst]
    );
    Err(text.into())
}

/// The Euclidean norm.
pub fn l2(values: &[f64]) -> f64 {
    values.iter().map(|v| v * v).sum::<f64>().sqrt()
}

/// Fails unless `got` and `want` are the same bits.
pub fn same_bits(what: &str, got: &[f32], want: &[f32]) -> Outcome {
    if got.len() != want.len() {
        return Err(format!("{what}: {} values, want {}", got.len(), want.len()).into());
    }
    match (0..got.len()).find(|&i| got[i].to_bits() != want[i].to_bits()) {
        None => Ok(()),
        Some(i) => Err(format!("{what}[{i}]: got {:e}, want the same bits as {:e}", got[i], want[i]).into()),
    }
}

/// The values in f64.
pub fn widened(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&v| f64::from(v)).collect()
}
