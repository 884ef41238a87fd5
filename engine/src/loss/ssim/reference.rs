//! The slow twin: the textbook quotient in f64, window by window.

use super::ImagePair;

const WINDOW: usize = 11;
const SIGMA: f64 = 1.5;
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

fn window() -> Vec<f64> {
    let raw: Vec<f64> = (0..WINDOW).map(|k| (-((k as f64 - 5.0) / SIGMA).powi(2) / 2.0).exp()).collect();
    let sum: f64 = raw.iter().sum();
    raw.iter().map(|w| w / sum).collect()
}

/// Similarity of one channel around one window centre, and its gradient by the eleven by eleven rendered values.
fn at_centre(pair: &ImagePair, row: usize, column: usize, channel: usize) -> (f64, Vec<f64>) {
    let window = window();
    let index = |k: usize| ((row + k / WINDOW) * pair.width + column + k % WINDOW) * 3 + channel;
    let weight = |k: usize| window[k / WINDOW] * window[k % WINDOW];
    let a = |k: usize| f64::from(pair.truth[index(k)]);
    let b = |k: usize| f64::from(pair.rendered[index(k)]);
    let mean = |f: &dyn Fn(usize) -> f64| (0..WINDOW * WINDOW).map(|k| weight(k) * f(k)).sum::<f64>();
    let (mean_a, mean_b) = (mean(&a), mean(&b));
    let var_a = mean(&|k| (a(k) - mean_a).powi(2));
    let var_b = mean(&|k| (b(k) - mean_b).powi(2));
    let covariance = mean(&|k| (a(k) - mean_a) * (b(k) - mean_b));
    let (n1, d1) = (2.0 * mean_a * mean_b + C1, mean_a * mean_a + mean_b * mean_b + C1);
    let (n2, d2) = (2.0 * covariance + C2, var_a + var_b + C2);
    let value = n1 * n2 / (d1 * d2);
    let gradient = (0..WINDOW * WINDOW).map(|k| {
        let by_n1 = 2.0 * mean_a * n2 / (d1 * d2);
        let by_d1 = -2.0 * mean_b * value / d1;
        let by_n2 = 2.0 * (a(k) - mean_a) * n1 / (d1 * d2);
        let by_d2 = -2.0 * (b(k) - mean_b) * value / d2;
        weight(k) * (by_n1 + by_d1 + by_n2 + by_d2)
    });
    (value, gradient.collect())
}

/// Mean similarity over the window centres for which `keep(row, column)` holds, and its gradient `[H, W, 3]`.
pub(super) fn ssim(pair: &ImagePair, keep: impl Fn(usize, usize) -> bool) -> (f64, Vec<f64>) {
    let (mut sum, mut count) = (0.0, 0.0);
    let mut gradient = vec![0.0; pair.truth.len()];
    for row in 0..=pair.height - WINDOW {
        for column in (0..=pair.width - WINDOW).filter(|&c| keep(row + 5, c + 5)) {
            for channel in 0..3 {
                let (value, local) = at_centre(pair, row, column, channel);
                sum += value;
                count += 1.0;
                for (k, g) in local.iter().enumerate() {
                    gradient[((row + k / WINDOW) * pair.width + column + k % WINDOW) * 3 + channel] += g;
                }
            }
        }
    }
    gradient.iter_mut().for_each(|g| *g /= count);
    (sum / count, gradient)
}
