//! Depth maps of images as files: exact, or as a monocular network would see them.

use std::path::{Path, PathBuf};

use lgs_formats::casts::to_f32;
use lgs_formats::{
    clip::{DepthKind, DepthRecord},
    image::{write_depth_metres, write_depth_png},
};

use super::{
    camera::Capture,
    maths::{count, mix},
    rng::Rng,
};
use crate::error::Result;

/// Rows and columns of the grid on which a network's error is drawn.
const GRID: [usize; 2] = [5, 8];
/// Largest share by which inverse depths are off on that grid.
const BIAS: f64 = 0.1;
/// Standard deviation of a pixel's own error, as a share.
const NOISE: f64 = 0.01;
/// Stream of draws that is this file's.
const STREAM: u64 = 0x6d61_7000;

/// Which depth maps are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DepthMaps {
    /// Exact depths in metres, infinite in the sky: arrays of numpy.
    Metric,
    /// What a monocular network might say: inverse depths that are smeared over edges, off by up to a tenth in patches, noisy, and
    /// stretched to the range of a 16-bit PNG, image by image.
    Relative,
}

/// The record of a depth map that was written below `root` as `stem` and an extension; `seed` and `image` decide its noise.
///
/// # Errors
/// A path that cannot be written to.
pub(super) fn write(
    maps: DepthMaps,
    capture: &Capture,
    root: &Path,
    stem: &str,
    [seed, image]: [u64; 2],
) -> Result<DepthRecord> {
    let [width, height] = [capture.rgb.width, capture.rgb.height];
    let (extension, kind) = match maps {
        DepthMaps::Metric => ("npy", DepthKind::Metric),
        DepthMaps::Relative => ("png", DepthKind::Relative),
    };
    let file = PathBuf::from(format!("depth/{stem}.{extension}"));
    match maps {
        DepthMaps::Metric => write_depth_metres(&root.join(&file), width, height, &capture.depth)?,
        DepthMaps::Relative => {
            let known = |&depth: &f32| if depth.is_nan() { f32::INFINITY } else { depth };
            let depths: Vec<f32> = capture.depth.iter().map(known).collect();
            let values = as_a_network_sees(&depths, width, &mut Rng::new(seed, STREAM + image));
            write_depth_png(&root.join(&file), width, height, &stretched(&values))?;
        }
    }
    Ok(DepthRecord { file, kind })
}

/// Inverse depths (1 / metres) with the errors of [`DepthMaps::Relative`]. `[H, W]`
fn as_a_network_sees(depth: &[f32], width: usize, rng: &mut Rng) -> Vec<f32> {
    let height = depth.len() / width.max(1);
    let grid: Vec<f32> = (0..GRID[0] * GRID[1]).map(|_| to_f32(rng.uniform(-BIAS, BIAS))).collect();
    let place = |at: usize, size: usize, cells: usize| {
        let position = (at as f64 + 0.5) / size as f64 * (cells - 1) as f64;
        let low = count(position).min(cells - 2);
        (low, to_f32(position) - low as f32)
    };
    let of_pixel = |pixel: usize| {
        let (row, column) = (pixel / width, pixel % width);
        let around = |at: usize, size: usize| at.saturating_sub(1)..(at + 2).min(size);
        let (mut sum, mut number) = (0.0, 0.0);
        for y in around(row, height) {
            for x in around(column, width) {
                sum += 1.0 / depth[y * width + x];
                number += 1.0;
            }
        }
        let ((top, down), (left, right)) = (place(row, height, GRID[0]), place(column, width, GRID[1]));
        let line = |y: usize| mix(grid[y * GRID[1] + left], grid[y * GRID[1] + left + 1], right);
        let bias = mix(line(top), line(top + 1), down);
        sum / number * (1.0 + bias + to_f32(NOISE * rng.normal()))
    };
    (0..depth.len()).map(of_pixel).collect()
}

/// The values on the whole range of 16 bits.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of 65535, rounded")]
fn stretched(values: &[f32]) -> Vec<u16> {
    let low = values.iter().copied().fold(f32::INFINITY, f32::min);
    let high = values.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let range = (high - low).max(f32::MIN_POSITIVE);
    values.iter().map(|value| ((value - low) / range * f32::from(u16::MAX)).round() as u16).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_network_is_off_by_patches_and_noise_only() {
        let depth = vec![10.0; 64 * 32];
        let seen = as_a_network_sees(&depth, 64, &mut Rng::new(3, 1));
        let shares: Vec<f32> = seen.iter().map(|w| w / 0.1 - 1.0).collect();
        let largest = shares.iter().fold(0.0_f32, |m, s| m.max(s.abs()));
        assert!((0.03..0.16).contains(&largest), "{largest}");
        let step = |k: usize| (shares[k + 1] - shares[k]).abs();
        let steps: f32 = (0..63).map(step).sum::<f32>() / 63.0;
        assert!(steps < 0.03, "neighbours are off alike: {steps}");
        assert_eq!(seen, as_a_network_sees(&depth, 64, &mut Rng::new(3, 1)));
        assert_ne!(seen, as_a_network_sees(&depth, 64, &mut Rng::new(3, 2)));
    }

    #[test]
    fn the_range_is_used_and_near_is_large() {
        let values = stretched(&[0.0, 0.5, 0.25]);
        assert_eq!(values, [0, 65535, 32768]);
        assert_eq!(stretched(&[0.1, 0.1]), [0, 0]);
    }
}
