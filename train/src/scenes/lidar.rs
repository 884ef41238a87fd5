//! Sweeps of the spinning LiDAR at a moment.

use glam::Vec3;
use lgs_formats::casts::to_f32;
use lgs_formats::{pose::Pose, sweep::Sweep};
use rayon::prelude::*;

use super::{
    maths::{narrow_mat, narrow3, rotation_y, rotation_z, smoothstep},
    rig::LidarSpec,
    rng::Rng,
    shapes::Ray,
    streams,
    world::Moment,
};

/// Part of the rays that window glass lets pass without a return.
const GLASS_LOSS: f32 = 0.75;

/// A sweep and what is exactly known of its points.
#[derive(Clone, Debug, PartialEq)]
pub struct Scan {
    /// Points in the LiDAR's frame and intensities in 0..=1; beam by beam from the lowest. Where a sweep takes time, also the time of each
    /// point; the frame is that of the LiDAR at the frame's timestamp, or at the time of the point where sweeps are not compensated.
    pub sweep: Sweep,
    /// `[N, 3]` velocity of the surface in the clip's world, m/s.
    pub velocities: Vec<[f32; 3]>,
    /// `[N]` the tracked object that was hit, as an index into the scene's tracks.
    pub objects: Vec<Option<u32>>,
}

/// One ray that came back.
#[derive(Clone, Copy, Debug)]
struct Return {
    point: Vec3,
    intensity: f32,
    velocity: Vec3,
    time: f32,
    object: Option<u32>,
}

/// The world and the LiDAR while some rays of a sweep leave.
#[derive(Debug)]
pub(crate) struct Instant<'a> {
    /// Seconds after the frame's timestamp.
    pub(crate) time: f64,
    pub(crate) moment: Moment<'a>,
    pub(crate) world_from_lidar: Pose,
    /// To the LiDAR's frame at the frame's timestamp; `None` where points stay in its frame at this moment.
    pub(crate) lidar_from_then: Option<Pose>,
}

/// What a sweep is taken with and from where.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scanner<'a> {
    pub(crate) spec: &'a LidarSpec,
    /// In the order of the sweep, each for as many rays of a beam as the others; at least one.
    pub(crate) instants: &'a [Instant<'a>],
    /// Turns velocities.
    pub(crate) clip_from_world: Pose,
    pub(crate) seed: u64,
    pub(crate) frame: usize,
}

impl Instant<'_> {
    /// A point of the LiDAR's frame in its frame at the frame's timestamp.
    fn at_timestamp(&self, point: Vec3) -> Vec3 {
        self.lidar_from_then.as_ref().map_or(point, |pose| narrow3(pose.transform_point(point.as_dvec3())))
    }
}

impl Scanner<'_> {
    /// The sweep. Every beam has draws of its own, so that threads do not matter.
    pub(crate) fn scan(&self) -> Scan {
        let beams: Vec<Vec<Return>> = (0..self.spec.num_beams).into_par_iter().map(|beam| self.beam(beam)).collect();
        let mut scan = Scan {
            sweep: Sweep { times: (self.spec.sweep_s > 0.0).then(Vec::new), ..Sweep::default() },
            velocities: Vec::new(),
            objects: Vec::new(),
        };
        for hit in beams.into_iter().flatten() {
            scan.sweep.points.push(hit.point.to_array());
            scan.sweep.intensities.push(hit.intensity);
            scan.velocities.push(hit.velocity.to_array());
            scan.sweep.times.iter_mut().for_each(|times| times.push(hit.time));
            scan.objects.push(hit.object);
        }
        scan
    }

    fn beam(&self, beam: usize) -> Vec<Return> {
        let spec = self.spec;
        let [low, high] = spec.elevation_deg;
        let share = if spec.num_beams > 1 { beam as f64 / (spec.num_beams - 1) as f64 } else { 0.5 };
        let elevation = (low + (high - low) * share).to_radians();
        let [first, end] = spec.azimuth_deg;
        let mut rng = Rng::new(self.seed, streams::LIDAR + ((self.frame as u64) << 16) + beam as u64);
        let turn = narrow_mat(self.clip_from_world.rotation());
        (0..spec.num_azimuths)
            .filter_map(|k| {
                let azimuth = (first + (end - first) * k as f64 / spec.num_azimuths as f64).to_radians();
                let local = narrow3((rotation_z(azimuth) * rotation_y(-elevation)).x_axis);
                let noise = to_f32(rng.normal() * spec.range_noise_m);
                let luck = rng.uniform32(0.0, 1.0);
                let instant = &self.instants[k * self.instants.len() / spec.num_azimuths];
                let origin = narrow3(instant.world_from_lidar.translation());
                let ray = Ray { origin, direction: narrow_mat(instant.world_from_lidar.rotation()) * local };
                self.returned(&instant.moment, &ray, local, noise, luck).map(|hit| Return {
                    point: instant.at_timestamp(hit.point),
                    velocity: turn * hit.velocity,
                    time: to_f32(instant.time),
                    ..hit
                })
            })
            .collect()
    }

    /// What comes back from a ray. `luck` in 0..1 decides about losses, `noise` is added to the range.
    fn returned(&self, moment: &Moment, ray: &Ray, local: Vec3, noise: f32, luck: f32) -> Option<Return> {
        let [near, far] = self.spec.range_m.map(to_f32);
        let hit = moment.cast(ray, far)?;
        if hit.t < near {
            return None;
        }
        let point = ray.at(hit.t);
        let texel = moment.texel(&hit, point, 0.01);
        let cosine = hit.normal.dot(ray.direction).abs();
        let brightness = texel.albedo.dot(Vec3::new(0.25, 0.55, 0.2)).clamp(0.0, 1.0);
        let returned = brightness.sqrt() * (0.25 + 0.75 * cosine);
        let keep = (1.0 - to_f32(self.spec.dropout))
            * (1.0 - GLASS_LOSS * texel.glass)
            * (1.0 - 0.6 * (hit.t / far) * (hit.t / far))
            * smoothstep(0.0, 0.03, cosine * (0.3 + returned));
        (luck < keep).then(|| Return {
            point: local * (hit.t + noise),
            intensity: returned,
            velocity: narrow3(moment.velocity(hit.target, point)),
            time: 0.0,
            object: moment.object(hit.target),
        })
    }
}
