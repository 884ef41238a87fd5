//! How much an image shows around a place.

use lgs_engine::{gaussians::GaussianSet, views::View};
use lgs_formats::casts::rounded;

/// Half the side of the window that is looked at, pixels.
const REACH: usize = 4;
/// Shades of grey that are told apart.
const SHADES: usize = 32;
/// Entropy that a window of one shade counts as, bits, and a Gaussian that no input view shows: each keeps a chance.
const LEAST: f64 = 0.1;

/// `[N]` the greatest entropy of the input images where each Gaussian stands, bits, not below 0.1.
pub(super) fn entropy_of(scene: &GaussianSet, views: &[&View]) -> Vec<f64> {
    let mut found = vec![LEAST; scene.len()];
    for view in views {
        let [width, height] = [view.pinhole.width, view.pinhole.height];
        let shades = shades(&view.image.data);
        for (i, value) in found.iter_mut().enumerate() {
            let seconds = view.pinhole.time - scene.times[i];
            let (mean, velocity) = (scene.mean(i), scene.velocities[i]);
            let place = [0, 1, 2].map(|k| mean[k] + velocity[k] * seconds);
            let Some(at) = view.pinhole.project_moving(place, velocity) else { continue };
            let pixel = at.pixel(width);
            *value = value.max(entropy(&shades, [width, height], [pixel % width, pixel / width]));
        }
    }
    found
}

/// `[P]` shades of grey of pixels.
fn shades(pixels: &[f32]) -> Vec<usize> {
    let grey = |rgb: &[f32]| f64::from(rgb[0] + rgb[1] + rgb[2]) / 3.0;
    let last = (SHADES - 1) as f64;
    pixels.chunks_exact(3).map(|rgb| rounded((grey(rgb) * last).clamp(0.0, last))).collect()
}

/// Shannon's entropy of the shades in the window around a pixel, bits.
fn entropy(shades: &[usize], [width, height]: [usize; 2], [x, y]: [usize; 2]) -> f64 {
    let mut counts = [0_u32; SHADES];
    let columns = x.saturating_sub(REACH)..(x + REACH + 1).min(width);
    for row in y.saturating_sub(REACH)..(y + REACH + 1).min(height) {
        columns.clone().for_each(|column| counts[shades[row * width + column]] += 1);
    }
    let all = f64::from(counts.iter().sum::<u32>());
    let share = |count: u32| f64::from(count) / all;
    counts.into_iter().filter(|&count| count > 0).map(|count| -share(count) * share(count).log2()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_shade_says_nothing_and_two_halves_say_a_bit() {
        let flat = vec![3; 100];
        assert_eq!(entropy(&flat, [10, 10], [5, 5]), 0.0);
        let halves: Vec<usize> = (0..100).map(|i| if i % 10 < 5 { 0 } else { 9 }).collect();
        let found = entropy(&halves, [10, 10], [4, 5]);
        assert!(found > 0.98 && found < 1.0, "{found}");
        assert_eq!(entropy(&halves, [10, 10], [0, 0]), 0.0);
    }
}
