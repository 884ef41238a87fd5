//! Sweeps of several frames as one cloud in the clip frame.

use lgs_formats::{clip::LidarRecord, clip_dir::ClipDir, sweep::Sweep};

use super::PointCloud;
use crate::{
    error::{EngineError, Result},
    parallel,
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
    // As many sweeps at a time as there are threads: those of a long drive are not held beside their cloud.
    for some in input_frames.chunks(rayon::current_num_threads()) {
        let load =
            |index: usize| Some((dir.clip().frames.get(index)?, u32::try_from(index).ok()?, dir.load_sweep(index)));
        let loaded = parallel::map(some.len(), 1, &|k| load(some[k]));
        for (index, loaded) in some.iter().zip(loaded) {
            let Some((record, label, sweep)) = loaded else {
                let expected = format!("frame indices below {}", dir.clip().frames.len());
                return Err(EngineError::Setting { setting: "frames", expected, found: index.to_string() });
            };
            append(&mut cloud, &record.lidar, label, &sweep?, frame)?;
        }
    }
    Ok(cloud)
}

/// Appends the returns of a sweep of the frame of an index.
fn append(cloud: &mut PointCloud, lidar: &LidarRecord, index: u32, sweep: &Sweep, frame: &ClipFrame) -> Result<()> {
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
    cloud.frames.resize(found, index);
    cloud.num_missing += sweep.num_missing;
    cloud.positions.extend(frame.points(&lidar.world_from_lidar, &sweep.points));
    Ok(())
}
