//! The part of a scene that a step needs: what its views show, and what lies so near that the network's features reach across.

use lgs_engine::{
    gaussians::{GaussianSet, MEAN, NUM_ATTRIBUTES},
    views::{PinholeView, View},
};
use rayon::prelude::*;

use crate::velocity::TrueVelocities;

/// Distance from what a view shows within which primitives stay, metres.
const REACH: f32 = 6.0;

/// Drops the primitives that lie far from everything that the views show.
pub(crate) fn keep_nearby(set: &mut GaussianSet, velocities: &mut Option<TrueVelocities>, views: &[&View]) {
    let near = |row: &[f32; NUM_ATTRIBUTES]| {
        let point = [row[MEAN.start], row[MEAN.start + 1], row[MEAN.start + 2]];
        views.iter().any(|view| outside(&view.pinhole, point) <= REACH)
    };
    let keep: Vec<bool> = set.attributes.par_iter().with_min_len(4096).map(near).collect();
    let kept: Vec<usize> = (0..set.len()).filter(|&i| keep[i]).collect();
    let num_lidar = kept.partition_point(|&i| i < set.num_lidar);
    if let Some(truth) = velocities {
        *truth = truth.of_sources(&kept[..num_lidar]);
    }
    *set = set.select(&kept, num_lidar);
}

/// How far a point is from what a view shows, metres: beyond an edge of the image, at the point's depth, or behind the camera.
fn outside(view: &PinholeView, point: [f32; 3]) -> f32 {
    let [x, y, depth] = view.to_camera(point);
    let front = depth.max(0.0);
    let beyond = |value: f32, centre: f32, focal: f32, size: usize| {
        let first = -centre / focal * front;
        let last = (size as f32 - centre) / focal * front;
        (first - value).max(value - last)
    };
    beyond(x, view.cx, view.fx, view.width).max(beyond(y, view.cy, view.fy, view.height)).max(-depth)
}

#[cfg(test)]
mod tests {
    use super::{PinholeView, outside};

    #[test]
    fn distances_are_from_the_pyramid_of_the_image() {
        let view = PinholeView {
            width: 40,
            height: 20,
            fx: 20.0,
            fy: 20.0,
            cx: 20.0,
            cy: 10.0,
            camera_from_clip: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
            time: 0.0,
            shutter: None,
            pixel_side: 1.0,
        };
        assert!(outside(&view, [0.0, 0.0, 9.0]) < 0.0);
        assert_eq!(outside(&view, [13.0, 0.0, 10.0]), 3.0);
        assert_eq!(outside(&view, [-13.0, 0.0, 10.0]), 3.0);
        assert_eq!(outside(&view, [0.0, 7.0, 10.0]), 2.0);
        assert_eq!(outside(&view, [1.0, 0.0, -4.0]), 4.0);
    }
}
