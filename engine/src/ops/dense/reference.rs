//! The slow twin, in f64.

/// `x W^T + b` for `x` `[N, inputs]`, `weight` `[outputs, inputs]`, `bias` `[outputs]`.
pub fn linear(x: &[f64], weight: &[f64], bias: &[f64]) -> Vec<f64> {
    let inputs = weight.len() / bias.len();
    let rows = x.chunks_exact(inputs);
    rows.flat_map(|row| {
        weight.chunks_exact(inputs).zip(bias).map(move |(w, b)| b + w.iter().zip(row).map(|(w, x)| w * x).sum::<f64>())
    })
    .collect()
}
