//! A scene and a view for unit tests.

use lgs_formats::image::PixelLabel;

use crate::gaussians::{GaussianSet, NUM_ATTRIBUTES};
use crate::views::samples::{ahead, seen};
use crate::views::{DepthSample, View};

const SIZE: [usize; 2] = [75, 41];

fn at(i: usize, salt: f32) -> f32 {
    ((i as f32 * 12.9898 + salt).sin() * 43_758.547).rem_euclid(1.0)
}

/// 80 Gaussians, 60 of them of the `LiDAR` branch, opacities by their logit.
pub(crate) fn scene(opacity: f32) -> GaussianSet {
    let row = |i: usize| -> [f32; NUM_ATTRIBUTES] {
        let place = [4.0 * at(i, 0.1) - 2.0, 2.0 * at(i, 0.7) - 1.0, 3.0 + 3.0 * at(i, 1.3)];
        let quat = [1.0, at(i, 2.0) - 0.5, at(i, 3.0) - 0.5, 0.2];
        let scale = [0.3, 0.12, 0.06].map(|s: f32| (s * (0.6 + at(i, 4.0))).ln());
        let colour = [5.0, 6.0, 7.0].map(|salt| 4.0 * at(i, salt) - 2.0);
        let mut row = [0.0; NUM_ATTRIBUTES];
        let values = place.into_iter().chain(quat).chain(scale).chain([opacity + at(i, 8.0)]).chain(colour);
        row.iter_mut().zip(values).for_each(|(to, from)| *to = from);
        row
    };
    GaussianSet {
        attributes: (0..80).map(row).collect(),
        times: vec![0.0; 80],
        frames: vec![0; 80],
        velocities: vec![[0.0; 3]; 80],
        num_lidar: 60,
    }
}

/// A view of other colours, some of its pixels ignored, some with a depth.
pub(crate) fn view() -> View {
    let [width, height] = SIZE;
    let label = |i: usize| if i % 11 == 3 { PixelLabel::Ignored } else { PixelLabel::Static };
    View {
        labels: Some((0..width * height).map(label).collect()),
        depth_samples: (0..150).map(|k| DepthSample { pixel: 20 * k, depth: 4.0 + at(k as usize, 0.9) }).collect(),
        ..seen(ahead(width, height, 60.0), (0..3 * width * height).map(|i| at(i, 0.3)).collect())
    }
}
