//! What looks wrong about a clip.

use glam::{DQuat, DVec3};
use lgs_formats::{clip::Clip, pose::Pose};

use super::Report;

/// Time between an image and its sweep that is worth a look, milliseconds: more than a revolution of usual sensors.
const MAX_OFFSET_MS: f64 = 150.0;
/// Spread of the time between the images of a camera and their sweeps, milliseconds.
const MAX_OFFSET_SPREAD_MS: f64 = 20.0;
/// Speed that no car has, metres a second.
const MAX_SPEED: f64 = 80.0;
/// Turn that no car takes, degrees a second.
const MAX_TURN_DEG: f64 = 120.0;
/// Acceleration that only a pose that jumps has, metres a second squared.
const MAX_ACCELERATION: f64 = 40.0;
/// Times the usual gap between sweeps that is a hole.
const HOLE: f64 = 1.8;
/// Share of the returns below which a camera most likely looks elsewhere than its pose says.
const MIN_VISIBLE: f64 = 0.005;
/// Share of the returns that no camera sees that is worth saying.
const MAX_UNSEEN: f64 = 0.9;

/// One sentence for each thing that looks wrong.
pub(super) fn warnings(clip: &Clip, report: &Report) -> Vec<String> {
    [clock_warnings(clip), return_warnings(report), pose_warnings(clip), camera_warnings(clip, report)].concat()
}

fn times(clip: &Clip) -> Vec<f64> {
    clip.frames.iter().map(|frame| frame.lidar.timestamp).collect()
}

fn clock_warnings(clip: &Clip) -> Vec<String> {
    let gaps: Vec<f64> = times(clip).windows(2).map(|pair| pair[1] - pair[0]).collect();
    let mut found = Vec::new();
    if let Some(frame) = gaps.iter().position(|&gap| gap <= 0.0) {
        found.push(format!("frames {frame} and {}: the sweeps' times do not ascend", frame + 1));
    }
    let mut sorted = gaps.clone();
    sorted.sort_by(f64::total_cmp);
    let usual = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
    for (frame, gap) in gaps.iter().enumerate().filter(|(_, gap)| **gap > HOLE * usual && usual > 0.0) {
        found.push(format!("frames {frame} and {}: {gap:.3} s apart, usually {usual:.3} s", frame + 1));
    }
    found
}

/// Returns of a sweep are measured between it and the next one, in the main.
fn return_warnings(report: &Report) -> Vec<String> {
    let (Some(returns), Some(rate)) = (report.lidar.returns, report.lidar.rate_hz) else { return Vec::new() };
    let (span, gap) = ((returns.last_ms.mean - returns.first_ms.mean) / 1e3, 1.0 / rate);
    if returns.num_timed == 0 || span <= HOLE * gap {
        return Vec::new();
    }
    vec![format!("the returns of a sweep were measured over {span:.3} s, sweeps are {gap:.3} s apart: another unit?")]
}

/// Metres a second and degrees a second from one pose to the next.
fn motion(a: &Pose, b: &Pose, seconds: f64) -> (DVec3, f64) {
    let turn = DQuat::from_mat3(&(a.rotation().transpose() * b.rotation())).normalize();
    let angle = 2.0 * turn.w.abs().min(1.0).acos();
    ((b.translation() - a.translation()) / seconds, angle.to_degrees() / seconds)
}

fn pose_warnings(clip: &Clip) -> Vec<String> {
    let mut found = Vec::new();
    let mut before: Option<DVec3> = None;
    for (frame, pair) in clip.frames.windows(2).enumerate() {
        let (a, b) = (&pair[0].lidar, &pair[1].lidar);
        let seconds = b.timestamp - a.timestamp;
        if seconds <= 0.0 {
            before = None;
            continue;
        }
        let (velocity, turn) = motion(&a.world_from_lidar, &b.world_from_lidar, seconds);
        let acceleration = before.map_or(0.0, |before| (velocity - before).length() / seconds);
        let at = format!("frames {frame} and {}: the pose jumps", frame + 1);
        if velocity.length() > MAX_SPEED {
            found.push(format!("{at}, {:.1} m/s", velocity.length()));
        } else if acceleration > MAX_ACCELERATION {
            found.push(format!("{at}, acceleration {acceleration:.0} m/s2"));
        }
        if turn > MAX_TURN_DEG {
            found.push(format!("{at}, {turn:.0} degrees a second"));
        }
        before = Some(velocity);
    }
    found
}

fn camera_warnings(clip: &Clip, report: &Report) -> Vec<String> {
    let mut found = Vec::new();
    for camera in &report.cameras {
        let (offset, visible) = (camera.offset_ms, camera.visible_share);
        if offset.max.abs().max(offset.min.abs()) > MAX_OFFSET_MS {
            let (name, min, max) = (&camera.name, offset.min, offset.max);
            found.push(format!("{name}: images {min:.0} to {max:.0} ms from their sweeps: two clocks?"));
        } else if offset.max - offset.min > MAX_OFFSET_SPREAD_MS {
            let (name, min, max) = (&camera.name, offset.min, offset.max);
            found.push(format!("{name}: images {min:.0} to {max:.0} ms from their sweeps, not always the same"));
        }
        if visible.mean < MIN_VISIBLE {
            let share = visible.mean * 100.0;
            found.push(format!("{}: sees {share:.2} % of the points: wrong pose or intrinsics?", camera.name));
        }
        if camera.num_images < clip.frames.len() {
            found.push(format!("{}: {} images for {} frames", camera.name, camera.num_images, clip.frames.len()));
        }
    }
    if report.cameras.is_empty() {
        found.push("no images: nothing can be coloured".to_owned());
    } else if report.unseen_share > MAX_UNSEEN {
        let share = report.unseen_share * 100.0;
        found.push(format!("{share:.0} % of the points are seen by no camera and will be left out"));
    }
    found
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use glam::DMat3;
    use lgs_formats::clip::{Frame, LidarRecord};

    use super::*;

    /// A drive along x at 10 m/s and 10 Hz.
    fn drive(change: impl Fn(usize, &mut f64, &mut DVec3, &mut f64)) -> Clip {
        let frame = |index: usize| {
            let (mut timestamp, mut angle) = (index as f64 * 0.1, 0.0);
            let mut place = DVec3::new(index as f64, 0.0, 0.0);
            change(index, &mut timestamp, &mut place, &mut angle);
            let world_from_lidar = Pose::new(DMat3::from_rotation_z(angle), place);
            let lidar = LidarRecord::new(PathBuf::from("a"), timestamp, world_from_lidar);
            Frame { lidar, cameras: Vec::new(), boxes: None }
        };
        let text = String::new;
        Clip { name: text(), source: text(), licence: text(), frames: (0..6).map(frame).collect() }
    }

    fn found(clip: &Clip) -> String {
        [clock_warnings(clip), pose_warnings(clip)].concat().join("; ")
    }

    #[test]
    fn a_steady_drive_is_no_cause_for_words() {
        assert_eq!(found(&drive(|_, _, _, _| {})), "");
    }

    #[test]
    fn holes_jumps_and_clocks_are_named_by_their_frames() {
        let hole = drive(|index, time, place, _| {
            if index > 2 {
                *time += 0.2;
                place.x += 2.0;
            }
        });
        assert_eq!(found(&hole), "frames 2 and 3: 0.300 s apart, usually 0.100 s");
        let back = drive(|index, time, _, _| *time -= if index == 3 { 0.15 } else { 0.0 });
        assert!(found(&back).starts_with("frames 2 and 3: the sweeps' times do not ascend"), "{}", found(&back));
        let jump = drive(|index, _, place, _| place.y += if index == 4 { 1.0 } else { 0.0 });
        assert!(found(&jump).starts_with("frames 3 and 4: the pose jumps, acceleration 100 m/s2"), "{}", found(&jump));
        let far = drive(|index, _, place, _| place.y += if index == 5 { 30.0 } else { 0.0 });
        assert!(found(&far).contains("frames 4 and 5: the pose jumps, 300.2 m/s"), "{}", found(&far));
        let turn = drive(|index, _, _, angle| *angle = if index == 5 { 0.5 } else { 0.0 });
        assert!(found(&turn).contains("frames 4 and 5: the pose jumps, 286 degrees a second"), "{}", found(&turn));
    }
}
