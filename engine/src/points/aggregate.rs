//! Sweeps of several frames as one cloud in the clip frame.

use lgs_formats::clip_dir::ClipDir;
use rayon::prelude::*;

use super::PointCloud;
use crate::{
    error::{EngineError, Result},
    views::ClipFrame,
};

/// Most returns of a cloud: with what a scene makes of them they are counted in 32 bits.
const MOST_RETURNS: usize = 1 << 30;

/// The returns of `input_frames`, frame by frame, in the clip frame.
///
/// # Errors
/// Those of [`ClipDir::load_sweep`]; [`EngineError::Setting`] for a frame that the clip does not have, and for too many returns.
pub fn aggregate(dir: &ClipDir, input_frames: &[usize], frame: &ClipFrame) -> Result<PointCloud> {
    let mut cloud = PointCloud::default();
    let frames = dir.clip().frames.len();
    let load = |&index: &usize| (index < frames).then(|| dir.load_sweep(index));
    let sweeps: Vec<_> = input_frames.par_iter().map(load).collect();
    for (&index, sweep) in input_frames.iter().zip(sweeps) {
        let Some(((record, label), sweep)) = dir.clip().frames.get(index).zip(u32::try_from(index).ok()).zip(sweep)
        else {
            let expected = format!("frame indices below {}", dir.clip().frames.len());
            return Err(EngineError::Setting { setting: "frames", expected, found: index.to_string() });
        };
        let (lidar, sweep) = (&record.lidar, sweep?);
        let found = cloud.len() + sweep.points.len();
        if found > MOST_RETURNS {
            let expected = format!("frames of at most {MOST_RETURNS} returns");
            return Err(EngineError::Setting { setting: "frames", expected, found: found.to_string() });
        }
        match &sweep.times {
            Some(times) => cloud.times.extend(times.iter().map(|&time| frame.later(lidar.timestamp, time))),
            None => cloud.times.resize(found, frame.time(lidar.timestamp)),
        }
        match &sweep.origins {
            Some(origins) => cloud.origins.extend(frame.points(&lidar.world_from_lidar, origins)),
            None => cloud.origins.resize(found, frame.points(&lidar.world_from_lidar, &[[0.0; 3]])[0]),
        }
        cloud.frames.resize(found, label);
        cloud.num_missing += sweep.num_missing;
        cloud.positions.extend(frame.points(&lidar.world_from_lidar, &sweep.points));
    }
    Ok(cloud)
}
