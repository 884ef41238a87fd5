//! The slow twin: every pair, sorted.

/// As [`super::nearest_other_time`], from all pairs; `groups[i] = i` gives [`super::nearest_of`] of all points.
pub fn nearest_of_other_groups(points: &[[f32; 3]], groups: &[u32], k: usize) -> Vec<u32> {
    let square = |a: f32, b: f32| (f64::from(a) - f64::from(b)).powi(2);
    let mut result = Vec::new();
    for (p, group) in points.iter().zip(groups) {
        let mut others: Vec<(f64, usize)> = (0..points.len())
            .filter(|&j| groups[j] != *group)
            .map(|j| {
                let q = points[j];
                (square(p[0], q[0]) + square(p[1], q[1]) + square(p[2], q[2]), j)
            })
            .collect();
        others.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let found = others.iter().map(|&(_, j)| u32::try_from(j).unwrap_or(u32::MAX));
        result.extend(found.chain(std::iter::repeat(u32::MAX)).take(k));
    }
    result
}
