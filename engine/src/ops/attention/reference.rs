//! The slow twin, in f64: padded patches, every row looked up.

/// Attention within patches along `order`, as [`super::attention`], for one cloud.
///
/// # Shapes
/// `qkv` `[N, 3 C]`; result `[N, C]`.
pub fn attention(qkv: &[f64], num_heads: usize, order: &[u32], size: usize) -> Vec<f64> {
    let rows = order.len();
    let channels = qkv.len() / rows / 3;
    let width = channels / num_heads;
    let size = size.min(rows);
    let mut out = vec![0.0; rows * channels];
    for position in 0..rows {
        let first = position / size * size;
        // The last patch is filled up with the positions before it.
        let end = (first + size).min(rows);
        let keys = &order[end - size..end];
        let query = order[position] as usize;
        for head in 0..num_heads {
            let value = |row: usize, part: usize, d: usize| qkv[(row * 3 + part) * channels + head * width + d];
            let score = |key: u32| -> f64 {
                (0..width).map(|d| value(query, 0, d) * value(key as usize, 1, d)).sum::<f64>() / (width as f64).sqrt()
            };
            let scores: Vec<f64> = keys.iter().map(|&key| score(key)).collect();
            let largest = scores.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let weights: Vec<f64> = scores.iter().map(|s| (s - largest).exp()).collect();
            let total: f64 = weights.iter().sum();
            for d in 0..width {
                let sum: f64 = keys.iter().zip(&weights).map(|(&key, w)| w * value(key as usize, 2, d)).sum();
                out[query * channels + head * width + d] = sum / total;
            }
        }
    }
    out
}
