//! The figures of an inspection.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::Result;
use glam::DVec3;
use lgs_formats::{
    camera::Distortion,
    clip::{CameraRecord, Clip, Compensation, ReturnsRecord},
    clip_dir::ClipDir,
};

use super::{
    Boxes, CameraReport, INSPECT_FORMAT, Lidar, Report, Returns, Spread, calibration, columns, masks,
    project::{camera_from_lidar, project},
    units,
    warn::warnings,
};

/// What a frame's sweep tells.
struct Swept {
    num_points: usize,
    num_unseen: usize,
    /// In the first sweep's frame.
    extent_min: DVec3,
    extent_max: DVec3,
    /// `[cameras of the frame]` returns that each sees.
    num_seen: Vec<usize>,
    /// First and last time of its returns, milliseconds after its timestamp.
    times_ms: Option<[f64; 2]>,
    /// Values in each row of the file, where it is plain that these are not four.
    row_width: Option<usize>,
}

/// What is in a clip: every sweep is read, of the images only their records.
pub(crate) fn measure(dir: &ClipDir) -> Result<Report> {
    let clip = dir.clip();
    let swept = (0..clip.frames.len()).map(|frame| sweep(dir, frame)).collect::<Result<Vec<_>>>()?;
    let times: Vec<f64> = clip.frames.iter().map(|frame| frame.lidar.timestamp).collect();
    let places: Vec<DVec3> = clip.frames.iter().map(|frame| frame.lidar.world_from_lidar.translation()).collect();
    let counts: Vec<f64> = swept.iter().map(|frame| number(frame.num_points)).collect();
    let num_points: usize = swept.iter().map(|frame| frame.num_points).sum();
    let num_unseen: usize = swept.iter().map(|frame| frame.num_unseen).sum();
    let lidar = Lidar {
        rate_hz: rate(&times),
        num_points: Spread::of(&counts),
        extent_min: swept.iter().fold(DVec3::INFINITY, |m, frame| m.min(frame.extent_min)).to_array(),
        extent_max: swept.iter().fold(DVec3::NEG_INFINITY, |m, frame| m.max(frame.extent_max)).to_array(),
        path_m: places.windows(2).map(|pair| pair[0].distance(pair[1])).fold(0.0, |sum, step| sum + step),
        returns: returns(clip, &swept),
    };
    let mut report = Report {
        format: INSPECT_FORMAT,
        clip: clip.name.clone(),
        source: clip.source.clone(),
        licence: clip.licence.clone(),
        num_frames: clip.frames.len(),
        duration_s: times.last().unwrap_or(&0.0) - times.first().unwrap_or(&0.0),
        lidar,
        cameras: cameras(clip, &swept),
        unseen_share: number(num_unseen) / number(num_points.max(1)),
        boxes: boxes(clip),
        warnings: Vec::new(),
    };
    report.warnings = [warnings(clip, &report), units::warnings(clip)].concat();
    let widths: Vec<Option<usize>> = swept.iter().map(|frame| frame.row_width).collect();
    report.warnings.extend(columns::warning(&widths));
    report.warnings.extend(masks::warnings(dir)?);
    report.warnings.extend(calibration::warnings(dir)?);
    Ok(report)
}

#[expect(clippy::cast_precision_loss, reason = "counts of returns are below 2^53")]
fn number(count: usize) -> f64 {
    count as f64
}

/// Events a second; `None` for a single one.
fn rate(times: &[f64]) -> Option<f64> {
    let span = times.last()? - times.first()?;
    (times.len() > 1 && span > 0.0).then(|| number(times.len() - 1) / span)
}

fn sweep(dir: &ClipDir, frame: usize) -> Result<Swept> {
    let frames = &dir.clip().frames;
    let world_from_lidar = frames[frame].lidar.world_from_lidar;
    let first_from_lidar = frames[0].lidar.world_from_lidar.inverse() * world_from_lidar;
    let cameras: Vec<_> = frames[frame]
        .cameras
        .iter()
        .map(|record| (&record.camera, camera_from_lidar(&record.camera, &world_from_lidar)))
        .collect();
    let loaded = dir.load_sweep(frame)?;
    let row_width = columns::row_width(&loaded.points, &loaded.intensities);
    let points = loaded.points;
    let mut swept = Swept {
        row_width,
        num_points: points.len(),
        num_unseen: 0,
        extent_min: DVec3::INFINITY,
        extent_max: DVec3::NEG_INFINITY,
        num_seen: vec![0; cameras.len()],
        times_ms: loaded.times.map(|times| {
            let times = times.iter().map(|&time| f64::from(time) * 1e3);
            times.fold([f64::INFINITY, f64::NEG_INFINITY], |[first, last], t| [first.min(t), last.max(t)])
        }),
    };
    for &point in &points {
        let place = first_from_lidar.transform_point(DVec3::from(point.map(f64::from)));
        swept.extent_min = swept.extent_min.min(place);
        swept.extent_max = swept.extent_max.max(place);
        let mut is_seen = false;
        for ((camera, pose), num_seen) in cameras.iter().zip(&mut swept.num_seen) {
            if project(camera, pose, point).is_some() {
                *num_seen += 1;
                is_seen = true;
            }
        }
        swept.num_unseen += usize::from(!is_seen);
    }
    Ok(swept)
}

fn returns(clip: &Clip, swept: &[Swept]) -> Option<Returns> {
    let records = || clip.frames.iter().map(|frame| &frame.lidar.returns);
    let times: Vec<[f64; 2]> = swept.iter().filter_map(|frame| frame.times_ms).collect();
    if times.is_empty() && records().all(|record| *record == ReturnsRecord::default()) {
        return None;
    }
    let side = |k: usize| Spread::of(&times.iter().map(|pair| pair[k]).collect::<Vec<_>>());
    let sensors = |record: &ReturnsRecord| record.sensors.as_ref().map_or(1, |sensors| sensors.lidar_from_sensor.len());
    Some(Returns {
        num_timed: times.len(),
        first_ms: side(0),
        last_ms: side(1),
        motion_compensated: records().all(|record| record.compensation != Compensation::None),
        num_sensors: records().map(sensors).max().unwrap_or(1),
    })
}

/// The cameras in the order of their first images.
fn cameras(clip: &Clip, swept: &[Swept]) -> Vec<CameraReport> {
    let mut names: Vec<&str> = Vec::new();
    for record in clip.frames.iter().flat_map(|frame| &frame.cameras) {
        if !names.contains(&record.camera.name.as_str()) {
            names.push(&record.camera.name);
        }
    }
    names.into_iter().filter_map(|name| camera(clip, swept, name)).collect()
}

fn camera(clip: &Clip, swept: &[Swept], name: &str) -> Option<CameraReport> {
    let mut records: Vec<&CameraRecord> = Vec::new();
    let (mut offsets, mut shares) = (Vec::new(), Vec::new());
    for (frame, swept) in clip.frames.iter().zip(swept) {
        if let Some(index) = frame.cameras.iter().position(|record| record.camera.name == name) {
            let record = &frame.cameras[index];
            offsets.push((record.camera.timestamp - frame.lidar.timestamp) * 1e3);
            shares.push(number(swept.num_seen[index]) / number(swept.num_points.max(1)));
            records.push(record);
        }
    }
    let times: Vec<f64> = records.iter().map(|record| record.camera.timestamp).collect();
    let first = &records.first()?.camera;
    let sizes: BTreeSet<[u32; 2]> = records.iter().map(|r| [r.camera.height, r.camera.width]).collect();
    let lens =
        |is: fn(&Distortion) -> bool| records.iter().any(|record| record.camera.distortion.as_ref().is_some_and(is));
    Some(CameraReport {
        name: name.to_owned(),
        sizes: (sizes.len() > 1).then(|| sizes.into_iter().collect()),
        num_images: records.len(),
        width: first.width,
        height: first.height,
        rate_hz: rate(&times),
        offset_ms: Spread::of(&offsets),
        visible_share: Spread::of(&shares),
        distorted: lens(|lens| matches!(lens, Distortion::BrownConrady(_))),
        fisheye: lens(|lens| matches!(lens, Distortion::Fisheye(_))),
        readout: records.iter().find_map(|record| record.camera.readout),
        masked: records.iter().any(|record| record.mask.is_some()),
        depth_maps: records.iter().find_map(|record| record.depth.as_ref()).map(|depth| depth.kind.word()),
    })
}

fn boxes(clip: &Clip) -> Option<Boxes> {
    if clip.frames.iter().all(|frame| frame.boxes.is_none()) {
        return None;
    }
    let boxes = clip.frames.iter().filter_map(|frame| frame.boxes.as_ref()).flatten();
    let tracks: BTreeMap<&str, &str> = boxes.map(|b| (b.track.as_str(), b.category.as_str())).collect();
    let mut categories = BTreeMap::new();
    for category in tracks.values() {
        *categories.entry((*category).to_owned()).or_default() += 1;
    }
    Some(Boxes { num_tracks: tracks.len(), categories })
}
