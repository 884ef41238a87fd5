use std::path::PathBuf;

use lgs_formats::{
    camera::{Camera, Intrinsics},
    clip::{CameraRecord, Frame, LidarRecord},
};

use super::*;
use crate::views::{
    Role,
    samples::{ahead, seen},
};

const WIDTH: usize = 40;
const HEIGHT: usize = 30;
const FOCAL: f64 = 20.0;

/// Epoch seconds, so that a time taken in f32 would show.
const EPOCH: f64 = 1.6e9;

fn camera() -> Camera {
    Camera {
        name: "front".into(),
        timestamp: EPOCH,
        width: 40,
        height: 30,
        intrinsics: Intrinsics { fx: FOCAL, fy: FOCAL, cx: 20.0, cy: 15.0 },
        distortion: None,
        readout: None,
        world_from_camera: Pose::IDENTITY,
    }
}

/// A frame whose world axes are those of the camera.
fn frame(timestamp: f64, boxes: Option<Vec<TrackedBox>>) -> Frame {
    let file = PathBuf::from("sweep.bin");
    let lidar = LidarRecord::new(file, EPOCH + timestamp, Pose::IDENTITY);
    let cameras = vec![CameraRecord { file: "image.png".into(), mask: None, depth: None, camera: camera() }];
    Frame { lidar, cameras, boxes }
}

fn clip(frames: Vec<Frame>) -> Clip {
    Clip { name: "c".into(), source: "s".into(), licence: "l".into(), frames }
}

fn tracked(track: &str, centre: [f64; 3], size: [f64; 3]) -> TrackedBox {
    let world_from_box = Pose::new(DMat3::IDENTITY, DVec3::from(centre));
    TrackedBox { track: track.into(), category: "car".into(), size, world_from_box }
}

fn view(frame: usize, time: f32) -> View {
    let pinhole = PinholeView { time, ..ahead(WIDTH, HEIGHT, 20.0) };
    View { frame, role: Role::HeldOut, ..seen(pinhole, vec![0.0; WIDTH * HEIGHT * 3]) }
}

const CLIP_FRAME: ClipFrame = ClipFrame { clip_from_world: Pose::IDENTITY, time_zero: EPOCH };

/// The half-open columns and rows that a mask covers; it must cover all of them.
fn rectangle(mask: &[bool]) -> Option<[usize; 4]> {
    let marked: Vec<(usize, usize)> = (0..mask.len()).filter(|&i| mask[i]).map(|i| (i % WIDTH, i / WIDTH)).collect();
    let left = marked.iter().map(|p| p.0).min()?;
    let right = marked.iter().map(|p| p.0).max()? + 1;
    let top = marked.iter().map(|p| p.1).min()?;
    let bottom = marked.iter().map(|p| p.1).max()? + 1;
    assert_eq!(marked.len(), (right - left) * (bottom - top), "not a rectangle");
    Some([left, right, top, bottom])
}

/// A clip of frames 0.1 s apart in which one flat box 10 m ahead stands at the given x.
fn moving_along_x(positions: &[f64]) -> Clip {
    let frames = positions.iter().enumerate();
    let boxes = |x: f64| Some(vec![tracked("a", [x, 0.0, 10.0], [4.0, 2.0, 0.0])]);
    clip(frames.map(|(i, &x)| frame(0.1 * i as f64, boxes(x))).collect())
}

#[test]
fn a_fast_box_is_marked_where_it_projects() {
    let clip = moving_along_x(&[0.0, 1.0, 2.0]);
    // 10 m ahead, a metre is two pixels: columns 20 + 2 * (1 - 2) .. 20 + 2 * (1 + 2), rows 15 -+ 2.
    assert_eq!(rectangle(&dynamic_pixels(&clip, &view(1, 0.1), &CLIP_FRAME).unwrap()), Some([18, 26, 13, 17]));
}

#[test]
fn boxes_are_carried_to_the_views_own_time() {
    let clip = moving_along_x(&[0.0, 1.0, 2.0]);
    // 10 m/s for 0.05 s: half a metre, one pixel.
    assert_eq!(rectangle(&dynamic_pixels(&clip, &view(1, 0.15), &CLIP_FRAME).unwrap()), Some([19, 27, 13, 17]));
    assert_eq!(rectangle(&dynamic_pixels(&clip, &view(0, -0.05), &CLIP_FRAME).unwrap()), Some([15, 23, 13, 17]));
    assert_eq!(rectangle(&dynamic_pixels(&clip, &view(2, 0.2), &CLIP_FRAME).unwrap()), Some([20, 28, 13, 17]));
}

#[test]
fn slow_and_unknown_tracks_are_static() {
    let slow = moving_along_x(&[0.0, 0.1, 0.2]);
    assert_eq!(rectangle(&dynamic_pixels(&slow, &view(1, 0.1), &CLIP_FRAME).unwrap()), None);
    let once = moving_along_x(&[0.0]);
    assert_eq!(rectangle(&dynamic_pixels(&once, &view(0, 0.0), &CLIP_FRAME).unwrap()), None);
}

#[test]
fn a_track_that_is_missing_in_between_keeps_its_velocity() {
    let mut clip = moving_along_x(&[0.0, 0.15, 0.3]);
    assert!(rectangle(&dynamic_pixels(&clip, &view(0, 0.0), &CLIP_FRAME).unwrap()).is_some());
    clip.frames[1].boxes = Some(vec![]);
    assert!(rectangle(&dynamic_pixels(&clip, &view(0, 0.0), &CLIP_FRAME).unwrap()).is_some());
    clip.frames[2].boxes = None;
    assert!(rectangle(&dynamic_pixels(&clip, &view(0, 0.0), &CLIP_FRAME).unwrap()).is_none());
}

#[test]
fn timestamps_that_do_not_ascend_give_no_velocity() {
    let mut clip = moving_along_x(&[0.0, 1.0]);
    clip.frames[1].lidar.timestamp = EPOCH;
    assert_eq!(rectangle(&dynamic_pixels(&clip, &view(0, 0.0), &CLIP_FRAME).unwrap()), None);
}

#[test]
fn a_box_partly_behind_the_camera_is_cut_at_the_near_plane() {
    // From 9 m behind to 11 m ahead, 2 m to the right and below: what is ahead fills the corner of the image.
    let at = |x: f64| Some(vec![tracked("a", [x, 4.0, 1.0], [4.0, 4.0, 20.0])]);
    let clip = clip(vec![frame(0.0, at(4.0)), frame(0.1, at(3.0))]);
    let mask = dynamic_pixels(&clip, &view(0, 0.0), &CLIP_FRAME).unwrap();
    let far = FOCAL * 2.0 / 11.0;
    for (i, marked) in mask.iter().enumerate() {
        let (x, y) = ((i % WIDTH) as f64 + 0.5 - 20.0, (i / WIDTH) as f64 + 0.5 - 15.0);
        // Seen along the ray (x, y, FOCAL) the box is met where 2..6 m right, 2..6 m below and 0.01..11 m ahead overlap.
        let (near, end) = (FOCAL * (2.0 / x).max(2.0 / y), FOCAL * (6.0 / x).min(6.0 / y));
        let met = x > far && y > far && near <= end.min(11.0);
        assert_eq!(*marked, met, "pixel {i}");
    }
    assert!(mask[WIDTH * HEIGHT - 1] && !mask[0]);
}

#[test]
fn a_box_behind_the_camera_is_not_seen() {
    let at = |x: f64| Some(vec![tracked("a", [x, 0.0, -5.0], [4.0, 2.0, 2.0])]);
    let clip = clip(vec![frame(0.0, at(0.0)), frame(0.1, at(1.0))]);
    assert_eq!(rectangle(&dynamic_pixels(&clip, &view(0, 0.0), &CLIP_FRAME).unwrap()), None);
}

#[test]
fn world_and_clip_frame_may_be_far_apart() {
    let mut clip = moving_along_x(&[0.0, 1.0, 2.0]);
    let offset = Pose::new(DMat3::IDENTITY, DVec3::new(4e5, 5e6, 100.0));
    for frame in &mut clip.frames {
        for tracked in frame.boxes.iter_mut().flatten() {
            tracked.world_from_box = offset * tracked.world_from_box;
        }
    }
    let clip_frame = ClipFrame { clip_from_world: offset.inverse(), time_zero: EPOCH };
    assert_eq!(rectangle(&dynamic_pixels(&clip, &view(1, 0.1), &clip_frame).unwrap()), Some([18, 26, 13, 17]));
}

#[test]
fn masks_are_joined_with_boxes_and_count_alone() {
    let mut clip = moving_along_x(&[0.0, 1.0, 2.0]);
    let mut view = view(1, 0.1);
    let mut labels = vec![PixelLabel::Static; WIDTH * HEIGHT];
    labels[0] = PixelLabel::Dynamic;
    labels[1] = PixelLabel::Ignored;
    view.labels = Some(labels);
    let count = |clip: &Clip| dynamic_pixels(clip, &view, &CLIP_FRAME).map(|m| m.iter().filter(|&&d| d).count());
    assert_eq!(count(&clip), Some(32), "labels without a mask file come from the lens");
    clip.frames[1].cameras[0].mask = Some("mask.png".into());
    assert_eq!(count(&clip), Some(33));
    clip.frames[1].boxes = None;
    assert_eq!(count(&clip), Some(1));
}

#[test]
fn a_clip_without_boxes_and_masks_says_nothing() {
    let silent = clip(vec![frame(0.0, None)]);
    assert_eq!(dynamic_pixels(&silent, &view(0, 0.0), &CLIP_FRAME), None);
    assert_eq!(dynamic_pixels(&silent, &view(7, 0.0), &CLIP_FRAME), None);
    let empty = clip(vec![frame(0.0, Some(vec![]))]);
    assert_eq!(dynamic_pixels(&empty, &view(0, 0.0), &CLIP_FRAME), Some(vec![false; WIDTH * HEIGHT]));
}

#[test]
fn the_own_vehicle_around_the_camera_is_not_seen_by_it() {
    // A box that moves with the camera, which looks out of its front, and one that follows it closely.
    let boxes = |x: f64| Some(vec![tracked("own", [x, 0.0, -1.0], [2.0, 2.0, 3.0])]);
    let mut own = clip((0..3).map(|i| frame(0.1 * f64::from(i), boxes(f64::from(i)))).collect());
    for (i, frame) in own.frames.iter_mut().enumerate() {
        frame.cameras[0].camera.world_from_camera = Pose::new(DMat3::IDENTITY, DVec3::new(i as f64, 0.0, 0.0));
    }
    let mut view = view(1, 0.1);
    view.pinhole.camera_from_clip[0][3] = -1.0;
    assert!(dynamic_pixels(&own, &view, &CLIP_FRAME).unwrap().iter().all(|&moves| !moves));
}
