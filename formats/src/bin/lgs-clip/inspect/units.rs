//! Numbers in other units or of other frames than the format's.

use glam::DVec3;
use lgs_formats::clip::Clip;

/// Usual times between sweeps, seconds: scanners turn 5 to 20 times a second, data sets keep one sweep a second at least.
const USUAL_GAPS: std::ops::RangeInclusive<f64> = 0.005..=8.0;
/// Widest view of a pinhole that is one, degrees.
const MAX_VIEW_DEG: f64 = 150.0;
/// Way of one sensor while the other stands that no clock explains, metres.
const MIN_WAY: f64 = 0.5;
/// Share of the longer way below which a sensor stands.
const STANDS: f64 = 0.02;

/// One sentence for each thing that looks like another unit or frame.
pub(super) fn warnings(clip: &Clip) -> Vec<String> {
    [gap_warning(clip).into_iter().collect(), view_warnings(clip), way_warnings(clip)].concat()
}

fn gap_warning(clip: &Clip) -> Option<String> {
    let times: Vec<f64> = clip.frames.iter().map(|frame| frame.lidar.timestamp).collect();
    let mut gaps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).filter(|&gap| gap > 0.0).collect();
    gaps.sort_by(f64::total_cmp);
    let usual = *gaps.get(gaps.len() / 2)?;
    if USUAL_GAPS.contains(&usual) {
        return None;
    }
    let unit = if usual > 1e4 { "microseconds" } else { "milliseconds" };
    let cause = if usual > *USUAL_GAPS.end() { format!("times in {unit}") } else { "times divided twice".to_owned() };
    Some(format!("sweeps are {usual} s apart: {cause}?"))
}

/// The first image of each camera whose intrinsics are not of an image of its size.
fn view_warnings(clip: &Clip) -> Vec<String> {
    let mut found = Vec::new();
    let mut named: Vec<&str> = Vec::new();
    for camera in clip.frames.iter().flat_map(|frame| &frame.cameras).map(|record| &record.camera) {
        if named.contains(&camera.name.as_str()) {
            continue;
        }
        let (k, width, height) = (camera.intrinsics, f64::from(camera.width), f64::from(camera.height));
        let angle = |size: f64, focal: f64| 2.0 * (size / 2.0 / focal).atan().to_degrees();
        let view = angle(width, k.fx).max(angle(height, k.fy));
        let name = &camera.name;
        if view > MAX_VIEW_DEG {
            found.push(format!(
                "{name}: a view of {view:.0} degrees: intrinsics divided by the image's size, or in millimetres?"
            ));
        } else if !(0.0..=width).contains(&k.cx) || !(0.0..=height).contains(&k.cy) {
            let (cx, cy) = (k.cx, k.cy);
            found.push(format!(
                "{name}: principal point {cx:.1}, {cy:.1} outside of the image: intrinsics of another size?"
            ));
        } else {
            continue;
        }
        named.push(name);
    }
    found
}

fn way(places: &[DVec3]) -> f64 {
    places.windows(2).map(|pair| pair[0].distance(pair[1])).fold(0.0, |sum, step| sum + step)
}

/// Poses of the LiDAR that stand while those of a camera move, or the other way round.
fn way_warnings(clip: &Clip) -> Vec<String> {
    let mut names: Vec<&str> = Vec::new();
    for record in clip.frames.iter().flat_map(|frame| &frame.cameras) {
        if !names.contains(&record.camera.name.as_str()) {
            names.push(&record.camera.name);
        }
    }
    let of_name = |name: &str| {
        let frame_places = |frame: &lgs_formats::clip::Frame| {
            let record = frame.cameras.iter().find(|record| record.camera.name == name)?;
            let places = [frame.lidar.world_from_lidar, record.camera.world_from_camera];
            Some(places.map(|pose| pose.translation()))
        };
        let pairs: Vec<[DVec3; 2]> = clip.frames.iter().filter_map(frame_places).collect();
        let [lidar, camera] = [0, 1].map(|k| way(&pairs.iter().map(|pair| pair[k]).collect::<Vec<_>>()));
        let (still, moves, way) = if lidar < camera { ("the LiDAR", name, camera) } else { (name, "the LiDAR", lidar) };
        let stands = way > MIN_WAY && lidar.min(camera) < STANDS * way;
        stands.then(|| {
            format!("{name}: by the poses {still} stands while {moves} moves {way:.1} m: poses of two frames?")
        })
    };
    names.into_iter().filter_map(of_name).collect()
}
