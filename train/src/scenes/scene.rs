//! A scene: a street with sensors that drive through it.

use glam::DMat3;
use lgs_formats::{
    camera::{Camera, Distortion, Fisheye, Readout, ReadoutDirection},
    clip::TrackedBox,
    pose::Pose,
};

use super::{
    camera::{Capture, Exposure, Exposures, ImagePlane, Lines, capture},
    config::SceneConfig,
    lidar::{Instant, Scan, Scanner},
    maths::rotation_z,
    world::World,
};
use crate::error::Result;

/// Instants of which a sweep is made that takes time.
const SWEEP_INSTANTS: usize = 100;

/// A procedural street: the same configuration gives the same bytes on every machine and for any number of threads.
#[derive(Debug)]
pub struct Scene {
    config: SceneConfig,
    pub(super) world: World,
    clip_from_world: Pose,
}

impl Scene {
    /// The scene of a configuration.
    ///
    /// # Errors
    /// A value of the configuration is out of its range.
    pub fn new(config: SceneConfig) -> Result<Self> {
        config.validate()?;
        let origin = &config.origin;
        let clip_from_world = Pose::new(rotation_z(origin.heading_deg.to_radians()), origin.position.into());
        Ok(Self { world: World::new(&config), config, clip_from_world })
    }

    /// What the scene was made from.
    pub const fn config(&self) -> &SceneConfig {
        &self.config
    }

    /// Names of the tracked things; [`Scan::objects`] counts them.
    pub fn tracks(&self) -> Vec<&str> {
        self.world.objects.iter().map(|object| object.track.as_str()).collect()
    }

    /// Timestamp of a frame's sweep in the clip's clock, seconds.
    pub fn lidar_timestamp(&self, frame: usize) -> f64 {
        self.config.origin.time_s + self.config.frame_time(frame)
    }

    /// Pose of the LiDAR in the clip's world.
    pub fn world_from_lidar(&self, frame: usize) -> Pose {
        self.world_from_lidar_at(frame, 0.0)
    }

    /// Pose of the LiDAR in the clip's world, `seconds` after a frame's timestamp.
    pub fn world_from_lidar_at(&self, frame: usize, seconds: f64) -> Pose {
        self.clip_from_world * self.lidar_pose(self.config.frame_time(frame) + seconds)
    }

    /// A camera of the rig as it stands when it takes the image of a frame.
    ///
    /// # Panics
    /// The rig has no such camera.
    pub fn camera(&self, frame: usize, camera: usize) -> Camera {
        let spec = &self.config.rig.cameras[camera];
        let size = |pixels: usize| u32::try_from(pixels).unwrap_or(u32::MAX);
        let world_from_camera = self.clip_from_world * self.camera_pose(frame, camera, 0.0);
        Camera {
            name: spec.name.clone(),
            timestamp: self.lidar_timestamp(frame) + spec.delay_s,
            width: size(spec.width),
            height: size(spec.height),
            intrinsics: spec.intrinsics(),
            distortion: spec.fisheye.map(|coefficients| {
                Distortion::Fisheye(Fisheye {
                    coefficients,
                    width: size(spec.width),
                    height: size(spec.height),
                    intrinsics: spec.intrinsics(),
                    world_from_fisheye: world_from_camera,
                    fisheye_from_pinhole: DMat3::IDENTITY,
                })
            }),
            readout: spec.readout,
            world_from_camera,
        }
    }

    /// The image of a camera, taken at its own timestamp or, where its shutter rolls, around it.
    ///
    /// # Panics
    /// The rig has no such camera.
    pub fn capture(&self, frame: usize, camera: usize) -> Capture {
        let spec = &self.config.rig.cameras[camera];
        let exposure = |seconds: f64| Exposure {
            moment: self.world.at(self.config.frame_time(frame) + spec.delay_s + seconds),
            plane: ImagePlane::new(spec, &self.camera_pose(frame, camera, seconds)),
        };
        let (lines, all) = match spec.readout.filter(Readout::is_rolling) {
            None => (Lines::One, vec![exposure(0.0)]),
            Some(readout) => {
                let (lines, count) = match readout.direction {
                    ReadoutDirection::TopToBottom | ReadoutDirection::BottomToTop => (Lines::Rows, spec.height),
                    ReadoutDirection::LeftToRight | ReadoutDirection::RightToLeft => (Lines::Columns, spec.width),
                };
                let line = |k: usize| exposure(readout.moment([(k as f64 + 0.5) / count as f64; 2]));
                (lines, (0..count).map(line).collect())
            }
        };
        capture(&Exposures { lines, all }, &self.clip_from_world)
    }

    /// The sweep of a frame.
    pub fn scan(&self, frame: usize) -> Scan {
        let instants = self.instants(frame);
        let scanner = Scanner {
            spec: &self.config.rig.lidar,
            instants: &instants,
            clip_from_world: self.clip_from_world,
            seed: self.config.seed,
            frame,
        };
        scanner.scan()
    }

    /// The moments at which the rays of a frame's sweep leave.
    fn instants(&self, frame: usize) -> Vec<Instant<'_>> {
        let spec = &self.config.rig.lidar;
        let (timestamp, sweep_s) = (self.config.frame_time(frame), spec.sweep_s);
        let number = if sweep_s > 0.0 { SWEEP_INSTANTS } else { 1 };
        let lidar_from_world = self.lidar_pose(timestamp).inverse();
        let instant = |k: usize| {
            let time = sweep_s * ((k as f64 + 0.5) / number as f64 - 0.5);
            let world_from_lidar = self.lidar_pose(timestamp + time);
            let lidar_from_then = (number > 1 && spec.compensated).then(|| lidar_from_world * world_from_lidar);
            Instant { time, moment: self.world.at(timestamp + time), world_from_lidar, lidar_from_then }
        };
        (0..number).map(instant).collect()
    }

    /// Boxes around the tracked things near the vehicle at the time of a frame's sweep, in the clip's world.
    pub fn boxes(&self, frame: usize) -> Vec<TrackedBox> {
        self.boxes_at(self.config.frame_time(frame))
    }

    /// Boxes around the tracked things near the vehicle `time` seconds after the first sweep, in the clip's world.
    pub(super) fn boxes_at(&self, time: f64) -> Vec<TrackedBox> {
        let road = &self.world.ground.road;
        let here = self.lidar_pose(time).translation();
        let all = self.world.objects.iter().map(|object| object.tracked_box(road, time));
        all.filter(|b| b.world_from_box.translation().distance(here) < self.config.box_reach_m)
            .map(|b| TrackedBox { world_from_box: self.clip_from_world * b.world_from_box, ..b })
            .collect()
    }

    fn lidar_pose(&self, time: f64) -> Pose {
        self.world.ego.pose(&self.world.ground.road, time) * self.config.rig.lidar.mount()
    }

    fn camera_pose(&self, frame: usize, camera: usize, seconds: f64) -> Pose {
        let spec = &self.config.rig.cameras[camera];
        let time = self.config.frame_time(frame) + spec.delay_s + seconds;
        self.world.ego.pose(&self.world.ground.road, time) * spec.mount()
    }
}
