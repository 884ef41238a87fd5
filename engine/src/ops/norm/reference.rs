//! The slow twins, in f64.

/// Layer normalisation of rows `[N, C]`.
pub fn layer_norm(x: &[f64], weight: &[f64], bias: &[f64], eps: f64) -> Vec<f64> {
    let width = weight.len();
    x.chunks_exact(width).flat_map(|row| affine(&standardised(row, eps), weight, bias)).collect()
}

/// Batch normalisation of rows `[N, C]` by their own mean and variance.
pub fn batch_norm(x: &[f64], weight: &[f64], bias: &[f64], eps: f64) -> Vec<f64> {
    let width = weight.len();
    let columns: Vec<Vec<f64>> = (0..width)
        .map(|c| standardised(&x.iter().skip(c).step_by(width).copied().collect::<Vec<f64>>(), eps))
        .collect();
    (0..x.len() / width)
        .flat_map(|row| affine(&columns.iter().map(|column| column[row]).collect::<Vec<f64>>(), weight, bias))
        .collect()
}

fn standardised(values: &[f64], eps: f64) -> Vec<f64> {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / count;
    values.iter().map(|v| (v - mean) / (variance + eps).sqrt()).collect()
}

fn affine(values: &[f64], weight: &[f64], bias: &[f64]) -> Vec<f64> {
    values.iter().zip(weight).zip(bias).map(|((v, w), b)| v * w + b).collect()
}
