//! Procedural clips of a size that is asked for: one street, one vehicle, sensors that are finer or coarser.

use std::path::Path;

use lgs_formats::casts::rounded;
use lgs_train::scenes::{
    Scene, SceneConfig,
    config::Split,
    export::{Export, ImageFormat, Written, write},
    presets::street_clip,
    rig::LidarSpec,
};

use super::plan::Size;
use crate::error::Result;

/// Moments of a clip.
const NUM_FRAMES: usize = 3;
/// Most beams of a sensor.
const MOST_BEAMS: usize = 256;
/// Rays of a beam for every beam, as in the clip that ships: about as dense upwards as sideways.
const RAYS_PER_BEAM: f64 = 4.4;
/// Beams of the sweep that tells which share of rays comes back.
const PROBE_BEAMS: usize = 32;
/// Quality of the images, as cameras store them.
const QUALITY: u8 = 95;
/// Number of the street among those that are only measured on.
const STREET: u64 = 7;

/// What was written: a clip of about a size as the new directory `dir`, two cameras and three moments.
///
/// # Errors
/// A size that no sensor has; the directory cannot be written to.
pub fn make(size: &Size, dir: &Path) -> Result<Written> {
    let scene = Scene::new(config(size)?)?;
    let name = format!("street of {size}");
    let export = Export { name, images: ImageFormat::Jpeg(QUALITY), masks: false, depth: None };
    Ok(write(&scene, dir, &export, &|| ())?)
}

fn config(size: &Size) -> Result<SceneConfig> {
    let mut config = SceneConfig { num_frames: NUM_FRAMES, ..street_clip(Split::Test.seed(STREET)) };
    for camera in &mut config.rig.cameras {
        (camera.height, camera.width) = (size.height, size.width);
    }
    set_rays(&mut config.rig.lidar, PROBE_BEAMS * PROBE_BEAMS * 4);
    let rays = config.rig.lidar.num_beams * config.rig.lidar.num_azimuths;
    let returns = Scene::new(config.clone())?.scan(NUM_FRAMES / 2).sweep.points.len();
    let wanted = size.points as f64 / NUM_FRAMES as f64 * rays as f64 / returns.max(1) as f64;
    set_rays(&mut config.rig.lidar, rounded(wanted));
    Ok(config)
}

/// Gives a sensor about so many rays.
fn set_rays(lidar: &mut LidarSpec, rays: usize) {
    let beams = rounded((rays as f64 / RAYS_PER_BEAM).sqrt());
    lidar.num_beams = beams.clamp(1, MOST_BEAMS);
    lidar.num_azimuths = (rays / lidar.num_beams).max(1);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clips_have_about_as_many_points_as_asked_for() {
        for points in [1500, 30_000] {
            let config = config(&Size { points, height: 16, width: 32 }).unwrap();
            let scene = Scene::new(config).unwrap();
            let found: usize = (0..NUM_FRAMES).map(|frame| scene.scan(frame).sweep.points.len()).sum();
            let share = found as f64 / points as f64;
            assert!((0.9..1.1).contains(&share), "{found} for {points}");
        }
    }

    #[test]
    fn sizes_beyond_every_sensor_are_refused() {
        let message =
            config(&Size { points: 100_000_000, height: 16, width: 32 }).and_then(|config| Ok(Scene::new(config)?));
        assert!(message.unwrap_err().to_string().contains("rig.lidar.num_azimuths"));
    }
}
