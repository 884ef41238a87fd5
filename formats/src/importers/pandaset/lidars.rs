//! The two `LiDARs` of `PandaSet` and where they are.
//!
//! # Source
//! scaleapi/pandaset-devkit, `docs/static_extrinsic_calibration.yaml`, for the names and for the place of the forward-looking one beside the
//! turning one. The poses of sweeps are not those of a `LiDAR` but of a place at the height of the road: what carries the turning one from there
//! follows from the poses of images and that file, whose cameras agree on it within 1 cm (sequence 002, 78 images each of two cameras). Where a beam of
//! the forward-looking one leaves a thing for what is behind it, its directions are most alike as seen from 1.6 m above that place; these
//! constants say 1.55 m.

use glam::{DMat3, DQuat, DVec3};

use crate::{importers::Selection, pose::Pose};

/// `d` of points of the turning LiDAR.
pub(super) const PANDAR64: i64 = 0;
/// `d` of points and `cuboids.sensor_id` of boxes of the forward-looking LiDAR.
pub(super) const PANDAR_GT: i64 = 1;
/// `d` of points of each LiDAR and its name.
const LIDARS: [(i64, &str); 2] = [(PANDAR64, "main_pandar64"), (PANDAR_GT, "front_gt")];

/// A quaternion (w, x, y, z) and a place, metres.
type Mount = ([f64; 4], [f64; 3]);
/// The turning LiDAR in the frame of the sweeps' poses, whose x points to the right and whose y points ahead.
const FRAME_FROM_PANDAR64: Mount = ([-0.015_90, -0.000_12, -0.007_85, 0.999_84], [0.0, 0.807, 1.844]);
/// The forward-looking LiDAR in the frame of the turning one.
const PANDAR64_FROM_GT: Mount = (
    [0.021_475_754_959_146_356, -0.002_060_907_279_494_794, 0.011_346_781_815_207_67, 0.999_702_853_428_236_5],
    [-0.000_451_117_754, -0.605_646_431_446, -0.301_525_235_176],
);

/// The names of both.
pub(super) fn names() -> Vec<String> {
    LIDARS.map(|(_, name)| name.to_owned()).to_vec()
}

/// `d` of the `LiDARs` that are wanted.
pub(super) fn wanted(selection: &Selection) -> Vec<i64> {
    LIDARS.iter().filter(|(_, name)| selection.lidar(name)).map(|(d, _)| *d).collect()
}

/// Where the `LiDARs` of these `d` are in the frame of the sweeps' poses.
pub(super) fn mounts(taken: &[i64]) -> Vec<Pose> {
    let pose = |([w, x, y, z], place): Mount| {
        Pose::new(DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize()), DVec3::from(place))
    };
    let pandar64 = pose(FRAME_FROM_PANDAR64);
    taken.iter().map(|&d| if d == PANDAR64 { pandar64 } else { pandar64 * pose(PANDAR64_FROM_GT) }).collect()
}
