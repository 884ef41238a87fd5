//! Which pixels of a view belong to moving objects.

use glam::{DMat3, DVec3};
use lgs_formats::{
    clip::{Clip, TrackedBox},
    image::PixelLabel,
    pose::Pose,
};

use super::polygon::{convex_hull, mark_convex};
use crate::views::{self, ClipFrame, PinholeView, View};

/// A track moves when it is faster than this, metres a second.
const MOVING_SPEED: f64 = 1.0;
/// A box that holds the camera, or would if it were this much larger on every side, is the own vehicle, metres.
const OWN_MARGIN: f64 = 0.5;
/// Parts of a box nearer to the camera's plane than this are cut off, metres.
const NEAR: f64 = views::NEAR as f64;

/// `[H, W]` whether a pixel belongs to a moving object; `None` when the clip says nothing about that: this frame has
/// neither tracked boxes nor a mask for this camera.
///
/// A pixel is dynamic when its centre lies in the projection (the convex hull of the corners) of a box whose track is faster
/// than 1 m/s, or when the mask says so. Nothing is subtracted for what stands in front of a box. A box around the camera itself is that
/// of the own vehicle and says nothing of what the camera sees.
///
/// Boxes are given at the moment of the LiDAR; each is carried to the view's own moment with its track's velocity: the
/// difference of its positions in the neighbouring frames of the track, by their timestamps. Where the shutter rolls, a box is carried to the moment at which its middle is exposed. A track of a single frame has
/// no known velocity and counts as static.
pub fn dynamic_pixels(clip: &Clip, view: &View, frame: &ClipFrame) -> Option<Vec<bool>> {
    let record = clip.frames.get(view.frame)?;
    let camera = record.cameras.iter().find(|c| c.camera.name == view.camera);
    let labels = view.labels.as_deref().filter(|_| camera.is_some_and(|c| c.mask.is_some()));
    if record.boxes.is_none() && labels.is_none() {
        return None;
    }
    let pinhole = &view.pinhole;
    let mut mask = vec![false; pinhole.width * pinhole.height];
    for tracked in record.boxes.iter().flatten() {
        let Some(velocity) = track_velocity(clip, view.frame, tracked).filter(|v| v.length() > MOVING_SPEED) else {
            continue;
        };
        let (camera, seconds) = exposing(pinhole, frame, tracked, velocity, record.lidar.timestamp);
        let camera_from_world = camera_from_clip(&camera) * frame.clip_from_world;
        if is_around(tracked, camera_from_world.inverse().translation() - velocity * seconds) {
            continue;
        }
        let corners = box_corners(tracked).map(|c| camera_from_world.transform_point(c + velocity * seconds));
        mark_convex(&convex_hull(&project(&corners, pinhole)), pinhole.width, &mut mask);
    }
    for (pixel, label) in mask.iter_mut().zip(labels.unwrap_or_default()) {
        *pixel |= *label == PixelLabel::Dynamic;
    }
    Some(mask)
}

/// The camera at the moment at which the middle of a box is exposed, and the seconds from a moment, at which it is given, until then.
fn exposing(
    pinhole: &PinholeView,
    frame: &ClipFrame,
    tracked: &TrackedBox,
    velocity: DVec3,
    given: f64,
) -> (PinholeView, f64) {
    let until = |view: &PinholeView| frame.time_zero + f64::from(view.time) - given;
    let Some(shutter) = &pinhole.shutter else { return (*pinhole, until(pinhole)) };
    let middle = tracked.world_from_box.translation() + velocity * until(pinhole);
    let single = |v: DVec3| v.to_array().map(lgs_formats::casts::to_f32);
    let place = single(frame.clip_from_world.transform_point(middle));
    let taking = pinhole.taking(shutter, place, single(frame.clip_from_world.rotation() * velocity));
    (taking, until(&taking))
}

/// Velocity of a box's track at a frame, metres a second in the world; `None` when no other frame has the track or the
/// timestamps do not ascend.
fn track_velocity(clip: &Clip, frame: usize, tracked: &TrackedBox) -> Option<DVec3> {
    let at = |index: usize| {
        let record = &clip.frames[index];
        let same = record.boxes.iter().flatten().find(|b| b.track == tracked.track)?;
        Some((record.lidar.timestamp, same.world_from_box.translation()))
    };
    let here = (clip.frames[frame].lidar.timestamp, tracked.world_from_box.translation());
    let before = (0..frame).rev().find_map(at).unwrap_or(here);
    let after = (frame + 1..clip.frames.len()).find_map(at).unwrap_or(here);
    let seconds = after.0 - before.0;
    (seconds > 0.0).then(|| (after.1 - before.1) / seconds)
}

/// Whether a place in the world lies in a box or within [`OWN_MARGIN`] of it.
fn is_around(tracked: &TrackedBox, place: DVec3) -> bool {
    let inside = tracked.world_from_box.inverse().transform_point(place).abs();
    inside.cmple(DVec3::from(tracked.size) / 2.0 + OWN_MARGIN).all()
}

/// The eight corners of a box in the world, metres; bit 0, 1, 2 of the index: front, left, top.
fn box_corners(tracked: &TrackedBox) -> [DVec3; 8] {
    let half = DVec3::from(tracked.size) / 2.0;
    std::array::from_fn(|i| {
        let sign = |bit: usize| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
        tracked.world_from_box.transform_point(half * DVec3::new(sign(0), sign(1), sign(2)))
    })
}

fn camera_from_clip(pinhole: &PinholeView) -> Pose {
    let rows = pinhole.camera_from_clip.map(|row| row.map(f64::from));
    let columns: [[f64; 3]; 4] = std::array::from_fn(|c| std::array::from_fn(|r| rows[r][c]));
    let rotation = DMat3::from_cols_array_2d(&[columns[0], columns[1], columns[2]]);
    Pose::new(rotation, DVec3::from(columns[3]))
}

/// Image points (pixels) whose hull is the image of a box, cut at the near plane; none when it is wholly behind.
///
/// # Shapes
/// `corners` in the camera frame, metres, numbered as [`box_corners`] does.
fn project(corners: &[DVec3; 8], pinhole: &PinholeView) -> Vec<[f64; 2]> {
    let mut visible: Vec<DVec3> = corners.iter().copied().filter(|c| c.z >= NEAR).collect();
    let edges = (0..8).flat_map(|i| [1, 2, 4].map(|bit| (i, i | bit))).filter(|(i, j)| i != j);
    for (a, b) in edges.map(|(i, j)| (corners[i], corners[j])).filter(|(a, b)| (a.z < NEAR) != (b.z < NEAR)) {
        visible.push(a + (b - a) * ((NEAR - a.z) / (b.z - a.z)));
    }
    let [fx, fy, cx, cy] = [pinhole.fx, pinhole.fy, pinhole.cx, pinhole.cy].map(f64::from);
    visible.iter().map(|p| [fx * p.x / p.z + cx, fy * p.y / p.z + cy]).collect()
}

#[cfg(test)]
mod tests;
