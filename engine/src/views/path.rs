//! Cameras along a path: through given places, smoothly.

use glam::{DMat3, DQuat, DVec3};
use lgs_formats::{camera::Camera, camera_path::PathKey, clip::Clip, pose::Pose};

use super::{ClipFrame, PinholeView};

/// The places of a camera in some frames of a clip, in the order of time.
pub fn keys_of_camera(clip: &Clip, frames: &[usize], camera: &str) -> Vec<PathKey> {
    let records = frames.iter().filter_map(|&frame| clip.frames.get(frame)).flat_map(|frame| &frame.cameras);
    let of_camera = records.map(|record| &record.camera).filter(|found| found.name == camera);
    let mut keys: Vec<PathKey> = of_camera
        .map(|found: &Camera| PathKey { timestamp: found.timestamp, world_from_camera: found.world_from_camera })
        .collect();
    keys.sort_by(|a, b| a.timestamp.total_cmp(&b.timestamp));
    keys
}

/// `count` places, evenly from the first to the last of `keys` when the way from one to the next is of length one: positions on a
/// Catmull-Rom spline, rotations by the shortest turn, moments on a spline, too, but never outside of the two around them.
///
/// # Source
/// Catmull and Rom, A class of local interpolating splines, 1974 (beyond the ends the path goes on straight); Shoemake, Animating
/// rotation with quaternion curves, 1985.
pub fn between(keys: &[PathKey], count: usize) -> Vec<PathKey> {
    let (Some(&first), Some(last)) = (keys.first(), keys.len().checked_sub(1)) else { return Vec::new() };
    let at = |index: usize| {
        if last == 0 || count < 2 {
            return first;
        }
        // The place as a whole number of parts, so that it meets the keys exactly.
        let (parts, unit) = (index * last, count - 1);
        let key = (parts / unit).min(last - 1);
        place(keys, key, (parts - key * unit) as f64 / unit as f64)
    };
    (0..count).map(at).collect()
}

/// The place at a share (0..=1) of the way from a key to the next.
fn place(keys: &[PathKey], key: usize, share: f64) -> PathKey {
    let (a, b) = (keys[key], keys[key + 1]);
    let before = key.checked_sub(1).map(|k| keys[k]);
    let behind = keys.get(key + 2).copied();
    let translation = |key: PathKey| key.world_from_camera.translation();
    let (pa, pb) = (translation(a), translation(b));
    let position =
        spline([before.map_or(2.0 * pa - pb, translation), pa, pb, behind.map_or(2.0 * pb - pa, translation)], share);
    // Around the first of the two, so that epoch seconds cost no digits.
    let moment = |key: PathKey| DVec3::X * (key.timestamp - a.timestamp);
    let end = moment(b);
    let moments = [before.map_or(-end, moment), DVec3::ZERO, end, behind.map_or(2.0 * end, moment)];
    let passed = spline(moments, share).x.clamp(end.x.min(0.0), end.x.max(0.0));
    let [qa, qb] = [a, b].map(|key| DQuat::from_mat3(&key.world_from_camera.rotation()).normalize());
    let rotation = DMat3::from_quat(qa.slerp(qb, share).normalize());
    PathKey { timestamp: a.timestamp + passed, world_from_camera: Pose::new(rotation, position) }
}

/// The Catmull-Rom spline through the second and the third of four points.
fn spline([a, b, c, d]: [DVec3; 4], t: f64) -> DVec3 {
    let (linear, square, cube) = (c - a, 2.0 * a - 5.0 * b + 4.0 * c - d, 3.0 * (b - c) + d - a);
    b + 0.5 * t * (linear + t * (square + t * cube))
}

/// The views from places on a path; `lens` has the size and the intrinsics, `frozen` a moment (seconds since time zero) to show from
/// all of them.
pub fn path_views(keys: &[PathKey], lens: &PinholeView, frame: &ClipFrame, frozen: Option<f32>) -> Vec<PinholeView> {
    let view = |key: &PathKey| {
        let rows = (frame.clip_from_world * key.world_from_camera).inverse().rows();
        PinholeView {
            camera_from_clip: std::array::from_fn(|r| rows[r].map(lgs_formats::casts::to_f32)),
            time: frozen.unwrap_or_else(|| frame.time(key.timestamp)),
            shutter: None,
            pixel_side: 1.0,
            ..*lens
        }
    };
    keys.iter().map(view).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(timestamp: f64, angle: f64, position: [f64; 3]) -> PathKey {
        PathKey { timestamp, world_from_camera: Pose::new(DMat3::from_rotation_z(angle), position.into()) }
    }

    #[test]
    fn a_straight_and_even_path_stays_straight_and_even() {
        let keys: Vec<PathKey> =
            (0..4_u8).map(f64::from).map(|k| key(1.6e9 + 0.1 * k, 0.3 * k, [5e5 + k, 2.0 * k, 0.0])).collect();
        let places = between(&keys, 13);
        assert_eq!(places.len(), 13);
        for (i, got) in (0_u8..).zip(&places) {
            let k = f64::from(i) / 4.0;
            assert!((got.timestamp - 1.6e9 - 0.1 * k).abs() < 1e-6, "{got:?}");
            let pose = got.world_from_camera;
            assert!(pose.translation().distance(DVec3::new(5e5 + k, 2.0 * k, 0.0)) < 1e-9, "{got:?}");
            let turned = pose.rotation().x_axis.angle_between(DVec3::X);
            assert!((turned - 0.3 * k).abs() < 1e-9, "{turned} at {k}");
        }
    }

    #[test]
    fn every_key_is_met_and_time_does_not_run_back() {
        let times = [0.0, 0.1, 0.11, 5.0, 5.0, 5.01];
        let keys: Vec<PathKey> = (0_u8..)
            .zip(times)
            .map(|(k, t)| key(t, f64::from(k % 3), [f64::from(k * k), f64::from(k % 2), 1.0]))
            .collect();
        let places = between(&keys, 5 * 8 + 1);
        for (k, want) in keys.iter().enumerate() {
            let got = places[8 * k];
            assert!((got.timestamp - want.timestamp).abs() < 1e-12);
            assert!(got.world_from_camera.translation().distance(want.world_from_camera.translation()) < 1e-12);
        }
        assert!(places.windows(2).all(|pair| pair[0].timestamp <= pair[1].timestamp));
        // Smooth: the way that is made changes from step to step, but nowhere doubles.
        let steps: Vec<f64> = places
            .windows(2)
            .map(|w| w[1].world_from_camera.translation().distance(w[0].world_from_camera.translation()))
            .collect();
        assert!(steps.windows(2).all(|pair| pair[1] < 2.0 * pair[0] + 0.1), "{steps:?}");
    }

    #[test]
    fn one_place_and_none_are_paths_too() {
        assert!(between(&[], 4).is_empty());
        let only = key(1.0, 0.5, [1.0, 2.0, 3.0]);
        assert_eq!(between(&[only], 3), [only; 3]);
        assert_eq!(between(&[only, key(2.0, 0.0, [0.0; 3])], 1), [only]);
        assert!(between(&[only], 0).is_empty());
    }

    #[test]
    fn the_turn_is_the_short_one() {
        let keys = [key(0.0, -3.0, [0.0; 3]), key(1.0, 3.0, [0.0; 3])];
        let middle = between(&keys, 3)[1].world_from_camera.rotation().x_axis;
        assert!(middle.distance(-DVec3::X) < 1e-9, "{middle}");
    }
}
