//! The slow twins, in f64.

/// The values of column `c` over the rows of a segment.
fn column<'a>(
    x: &'a [f64],
    segment_of: &'a [u32],
    segment: usize,
    [c, width]: [usize; 2],
) -> impl Iterator<Item = f64> + 'a {
    let rows = segment_of.iter().enumerate().filter(move |(_, s)| **s as usize == segment);
    rows.map(move |(row, _)| x[row * width + c])
}

/// Largest values `[M, width]`; 0 without rows.
pub fn max_pool(x: &[f64], segment_of: &[u32], num_segments: usize, width: usize) -> Vec<f64> {
    let largest = |i: usize| column(x, segment_of, i / width, [i % width, width]).reduce(f64::max).unwrap_or(0.0);
    (0..num_segments * width).map(largest).collect()
}

/// Means `[M, width]`; 0 without rows.
pub fn mean_pool(x: &[f64], segment_of: &[u32], num_segments: usize, width: usize) -> Vec<f64> {
    let mean = |i: usize| {
        let values: Vec<f64> = column(x, segment_of, i / width, [i % width, width]).collect();
        values.iter().sum::<f64>() / values.len().max(1) as f64
    };
    (0..num_segments * width).map(mean).collect()
}

/// The rows of the segments, `[N, width]`.
pub fn gather(x: &[f64], segment_of: &[u32], _num_segments: usize, width: usize) -> Vec<f64> {
    segment_of.iter().flat_map(|&s| x[s as usize * width..][..width].to_vec()).collect()
}
