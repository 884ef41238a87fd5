//! Sweeps of a turning `LiDAR` whose clip does not say when each return was measured: the sweeps themselves tell.
//!
//! If the returns were left where they were measured while the vehicle drove, surfaces of two sweeps meet better once each return is brought
//! to one moment by the vehicle's motion, with the right sense of rotation; and worse if that was done before.

use glam::{DMat3, DVec3};
use lgs_formats::casts::to_f32;
use lgs_formats::{clip::Clip, lidar_motion::LidarMotion, pose::Pose};
use serde::Serialize;

use super::{PointCloud, stamp::sweep_seconds};
use crate::{error::Result, ops::knn::Space, parallel, views::ClipFrame};

/// Least motion during a turn that shows, metres and radians.
const MOVES: (f64, f64) = (0.25, 0.01);
/// Sectors around the sensor, and in how many of them a turning one has returns.
const SECTORS: (usize, usize) = (12, 11);
/// Distances from the sensor at which surfaces are compared, metres.
const RANGE: [f32; 2] = [4.0, 40.0];
/// Returns of a sweep that are compared with another one.
const MOST: usize = 4000;
/// Largest distance of two returns of one surface, metres.
const APART: f64 = 0.5;
/// Difference between the two senses that shows, a share of the mean distance as it is.
const SHOWS: f64 = 0.025;
/// Where between no motion (0) and a sense (1) the least mean distance must be.
const LEAST: f64 = 0.6;
/// Returns that a thread takes at once.
const GRAIN: usize = 512;

/// How a `LiDAR` turns as seen from above.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Turn {
    /// From ahead to the right.
    Clockwise,
    /// From ahead to the left.
    CounterClockwise,
}

impl Turn {
    /// What was found, for people.
    pub const fn in_words(self) -> &'static str {
        match self {
            Self::Clockwise => {
                "measured during a clockwise turn of the LiDAR, as surfaces or outlines tell; returns brought to one moment"
            }
            Self::CounterClockwise => {
                "measured during a counter-clockwise turn of the LiDAR, as surfaces or outlines tell; returns brought to one moment"
            }
        }
    }

    /// Seconds after its sweep's timestamp at which a return at an azimuth (radians from ahead to the left) was measured, in a turn of so
    /// many seconds.
    fn seconds(self, azimuth: f64, turn_s: f64) -> f64 {
        let share = azimuth / std::f64::consts::TAU;
        turn_s * if self == Self::Clockwise { -share } else { share }
    }
}

/// A sweep, and how the sensor moved around it.
struct Sweep {
    motion: LidarMotion,
    clip_from_lidar: Pose,
    /// Turn from the sensor's axes to those in which z is up.
    mount: DMat3,
    returns: std::ops::Range<usize>,
}

/// How the `LiDAR` turned while it measured, where the clip says nothing of the times of returns and the sweeps tell; positions, times and
/// origins of the cloud are then those of a clip that says so. `None` where all stays as it is.
///
/// # Formula
/// A return at azimuth `a` (radians from ahead to the left) was measured `+-a T / (2 pi)` seconds after its sweep's timestamp, `T` the time of
/// a turn: the least time between two sweeps of the clip. The mean distance between sweeps is taken for either sense and for none; a sense is
/// believed if the parabola through the three has its minimum beyond 0.6 of the way to it, and the two senses differ by 2.5 %.
///
/// # Errors
/// When a coordinate is not finite.
pub(crate) fn tell_apart(cloud: &mut PointCloud, clip: &Clip, frame: &ClipFrame) -> Result<Option<Turn>> {
    let Some(Turning { turn_s, sweeps, moves: true }) = turning(cloud, clip, frame) else { return Ok(None) };
    let still = disagreement(cloud, &sweeps)?;
    // One after the other: each is a cloud of its own.
    let change = |turn: Turn| disagreement(&told(cloud, &sweeps, turn_s, turn), &sweeps).map(|found| found - still);
    let (with, against) = (change(Turn::Clockwise)?, change(Turn::CounterClockwise)?);
    let least = (with - against) / (2.0 * (with + against));
    let tells = (with - against).abs() >= SHOWS * still
        && with + against > 0.0
        && least.abs() >= LEAST
        && with.min(against) < 0.0;
    if !tells {
        return Ok(None);
    }
    let turn = if with < against { Turn::Clockwise } else { Turn::CounterClockwise };
    *cloud = told(cloud, &sweeps, turn_s, turn);
    Ok(Some(turn))
}

/// The times of the returns of a cloud, seconds since the clip's time zero, if its `LiDAR` turned this way and that way while the vehicle
/// stands; `None` where it drives, the clip says more, or no turning sensor measured them.
///
/// # Shapes
/// `[N]` each.
pub(crate) fn standing(cloud: &PointCloud, clip: &Clip, frame: &ClipFrame) -> Option<[(Turn, Vec<f32>); 2]> {
    let Turning { turn_s, sweeps, moves: false } = turning(cloud, clip, frame)? else { return None };
    let times = |turn: Turn| (turn, told(cloud, &sweeps, turn_s, turn).times);
    Some([Turn::Clockwise, Turn::CounterClockwise].map(times))
}

/// Sweeps of a sensor that turns.
struct Turning {
    /// Seconds of a turn.
    turn_s: f64,
    sweeps: Vec<Sweep>,
    /// Whether the vehicle moves during any of them.
    moves: bool,
}

/// The sweeps of a cloud; `None` where the clip says more, or no turning sensor measured them.
fn turning(cloud: &PointCloud, clip: &Clip, frame: &ClipFrame) -> Option<Turning> {
    let turn = sweep_seconds(cloud, clip)?;
    let mut sweeps = Vec::new();
    let first = cloud.frames.first().map_or(0, |&frame| frame as usize);
    let mount = frame.lidar_from_clip(clip, first).map_or(DMat3::IDENTITY, |turn| turn.transpose());
    let mut start = 0;
    for run in cloud.frames.chunk_by(|a, b| a == b) {
        let record = &clip.frames.get(run[0] as usize)?.lidar;
        let returns = start..start + run.len();
        let same = |places: &[[f32; 3]]| places.windows(2).all(|pair| pair[0] == pair[1]);
        if !same(&cloud.origins[returns.clone()]) {
            return None;
        }
        sweeps.push(Sweep {
            motion: LidarMotion::of(clip, run[0] as usize),
            clip_from_lidar: frame.clip_from_world * record.world_from_lidar,
            mount,
            returns,
        });
        start += run.len();
    }
    let moves = |sweep: &Sweep| {
        let pose = sweep.motion.lidar_from_lidar_at(turn);
        let angle = (0.5
            * (pose.rotation().to_cols_array_2d().iter().enumerate().map(|(k, c)| c[k]).sum::<f64>() - 1.0))
            .clamp(-1.0, 1.0)
            .acos();
        pose.translation().length() >= MOVES.0 || angle >= MOVES.1
    };
    let around = |sweep: &Sweep| {
        let mut seen = [false; SECTORS.0];
        for azimuth in sweep.returns.clone().filter_map(|i| sweep.azimuth(cloud.positions[i])) {
            let sector = (azimuth / std::f64::consts::TAU + 0.5) * SECTORS.0 as f64;
            (0..SECTORS.0).filter(|&k| (k as f64..k as f64 + 1.0).contains(&sector)).for_each(|k| seen[k] = true);
        }
        seen.iter().filter(|&&seen| seen).count() >= SECTORS.1
    };
    (sweeps.len() >= 2 && sweeps.iter().all(around)).then(|| {
        let moves = sweeps.iter().any(moves);
        Turning { turn_s: turn, sweeps, moves }
    })
}

impl Sweep {
    /// Radians from ahead, to the left, however the sensor is mounted.
    fn azimuth(&self, place: [f32; 3]) -> Option<f64> {
        let at = self.mount * self.clip_from_lidar.inverse().transform_point(DVec3::from(place.map(f64::from)));
        (at.x != 0.0 || at.y != 0.0).then(|| at.y.atan2(at.x))
    }
}

/// The cloud if its sweeps were measured during such a turn of so many seconds.
fn told(cloud: &PointCloud, sweeps: &[Sweep], turn_s: f64, turn: Turn) -> PointCloud {
    let mut made = cloud.clone();
    for sweep in sweeps {
        let (lidar_from_clip, returns) = (sweep.clip_from_lidar.inverse(), sweep.returns.clone());
        let later = |i: usize| turn.seconds(sweep.azimuth(cloud.positions[i]).unwrap_or(0.0), turn_s);
        let seconds: Vec<f64> = parallel::map(returns.len(), GRAIN, &|k| later(returns.start + k));
        let (positions, origins) = (&mut made.positions[returns.clone()], &mut made.origins[returns.clone()]);
        parallel::for_each_pair(positions, origins, GRAIN, &|k, position, origin| {
            let clip_from_then = sweep.clip_from_lidar * sweep.motion.lidar_from_lidar_at(seconds[k]) * lidar_from_clip;
            let moved = |place: [f32; 3]| {
                clip_from_then.transform_point(DVec3::from(place.map(f64::from))).to_array().map(to_f32)
            };
            (*position, *origin) = (moved(*position), moved(*origin));
        });
        for (time, seconds) in made.times[returns].iter_mut().zip(seconds) {
            *time = to_f32(f64::from(*time) + seconds);
        }
    }
    made
}

/// The mean distance of some returns from the nearest of the next sweep, metres, of the first and the last two sweeps.
fn disagreement(cloud: &PointCloud, sweeps: &[Sweep]) -> Result<f64> {
    let last = sweeps.len() - 2;
    let pairs: Vec<usize> = if last == 0 { vec![0] } else { vec![0, last] };
    let mean_distance = |pair: usize| -> Result<f64> {
        let [returns, next] = [pair, pair + 1].map(|sweep| sweeps[sweep].returns.clone());
        let own: Vec<u32> = returns.map(|i| u32::try_from(i).unwrap_or(u32::MAX)).collect();
        let ranges = cloud.ranges(&own);
        let near = own.iter().zip(ranges).filter(|(_, range)| (RANGE[0]..RANGE[1]).contains(range));
        let near: Vec<[f32; 3]> = near.map(|(&i, _)| cloud.positions[i as usize]).collect();
        // The ground looks the same wherever along it one is.
        let mut heights: Vec<f32> = near.iter().map(|place| place[2]).collect();
        heights.sort_by(f32::total_cmp);
        let middle = heights.get(heights.len() / 2).copied().unwrap_or_default();
        let near: Vec<[f32; 3]> = near.into_iter().filter(|place| place[2] > middle).collect();
        let compared: Vec<&[f32; 3]> = near.iter().step_by(near.len().div_ceil(MOST).max(1)).collect();
        let space = Space::new(&cloud.positions[next])?;
        let distance =
            |i: usize| space.nearest(compared[i], 1).first().map_or(APART, |near| near.squared.sqrt().min(APART));
        let distances: Vec<f64> = parallel::map(compared.len(), 64, &distance);
        Ok(distances.iter().sum::<f64>() / compared.len().max(1) as f64)
    };
    let found = parallel::map(pairs.len(), 1, &|k| mean_distance(pairs[k]));
    let found: Vec<f64> = found.into_iter().collect::<Result<_>>()?;
    Ok(found.iter().sum::<f64>() / found.len().max(1) as f64)
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use glam::{DMat3, DVec3};
    use lgs_formats::{
        casts::to_f32,
        clip::{Clip, Frame, LidarRecord},
        pose::Pose,
    };

    use super::{Turn, tell_apart};
    use crate::{points::PointCloud, views::ClipFrame};

    const SPEED: f64 = 12.0;
    const TURN: f64 = 0.1;

    /// Distance at which a ray from a place meets the facades and pillars on either side of a street, and where.
    fn hit(from: DVec3, direction: DVec3) -> Option<DVec3> {
        let pillars = (-12..24).flat_map(|k| {
            let x = 3.0 * f64::from(k) + f64::from(k * k % 5) * 0.3;
            [([x, 5.0], [x + 0.6, 7.0]), ([x + 1.1, -9.0], [x + 1.9, -6.0])]
        });
        let boxes = pillars.chain([([-60.0, 9.0], [90.0, 10.0]), ([-60.0, -12.0], [90.0, -11.0])]);
        let entry = |(low, high): ([f64; 2], [f64; 2])| {
            let (mut near, mut far) = (0.0_f64, f64::INFINITY);
            for k in 0..2 {
                let ends = [low[k], high[k]].map(|end| (end - from[k]) / direction[k]);
                near = near.max(ends[0].min(ends[1]));
                far = far.min(ends[0].max(ends[1]));
            }
            (near > 0.0 && near <= far).then_some(near)
        };
        boxes.filter_map(entry).reduce(f64::min).filter(|&range| range < 60.0).map(|range| from + direction * range)
    }

    /// Two sweeps of a drive along the street, whose returns were measured during a turn of a sense, or all at once (0).
    fn street(sense: i32) -> (Clip, PointCloud) {
        let mut cloud = PointCloud::default();
        let mut frames = Vec::new();
        for frame in 0..3_u32 {
            let timestamp = TURN * f64::from(frame);
            let pose = Pose::new(DMat3::IDENTITY, DVec3::new(SPEED * timestamp, 0.0, 0.0));
            let lidar = LidarRecord::new(PathBuf::from("sweep.bin"), timestamp, pose);
            frames.push(Frame { lidar, cameras: Vec::new(), boxes: None });
            if frame == 1 {
                continue;
            }
            for step in 0..1800 {
                // Sweeps do not meet the same places twice.
                let azimuth = (f64::from(step) + 0.37 * f64::from(frame)) * 0.2_f64.to_radians() - std::f64::consts::PI;
                let later = f64::from(sense) * azimuth / std::f64::consts::TAU * TURN;
                let shift = DVec3::new(SPEED * later, 0.0, 0.0);
                for beam in 0..12 {
                    let direction = DVec3::new(azimuth.cos(), azimuth.sin(), 0.03 * f64::from(beam));
                    let Some(place) = hit(pose.translation() + shift, direction) else { continue };
                    cloud.positions.push((place - shift).to_array().map(to_f32));
                    cloud.origins.push(pose.translation().to_array().map(to_f32));
                    cloud.times.push(to_f32(timestamp));
                    cloud.frames.push(frame);
                }
            }
        }
        let clip = Clip { name: String::new(), source: String::new(), licence: String::new(), frames };
        (clip, cloud)
    }

    #[test]
    fn sweeps_tell_in_which_sense_they_were_measured_and_when_at_once() {
        for (sense, turn) in [(-1, Some(Turn::Clockwise)), (0, None), (1, Some(Turn::CounterClockwise))] {
            let (clip, mut cloud) = street(sense);
            let before = cloud.clone();
            let found = tell_apart(&mut cloud, &clip, &ClipFrame::of(&clip, 0)).unwrap();
            assert_eq!(found, turn);
            if sense == 0 {
                assert_eq!(cloud, before);
                continue;
            }
            // A return to the left of the first sweep was measured a quarter of a turn from ahead.
            let left = |p: &[f32; 3]| p[0].abs() < 0.2 && p[1] > 4.0;
            let at = before.positions.iter().position(left).unwrap();
            let seconds = 0.25 * TURN * f64::from(sense);
            assert!((f64::from(cloud.times[at]) - seconds).abs() < 2e-3, "{}", cloud.times[at]);
            let moved = f64::from(cloud.positions[at][0] - before.positions[at][0]);
            assert!((moved - SPEED * seconds).abs() < 0.03, "{moved}");
            assert!((f64::from(cloud.origins[at][0]) - SPEED * seconds).abs() < 0.03);
        }
    }

    #[test]
    fn what_stands_has_times_or_is_no_turning_sensor_stays_as_it_is() {
        let (clip, cloud) = street(1);
        let mut standing = clip.clone();
        let here = clip.frames[0].lidar.world_from_lidar;
        standing.frames.iter_mut().for_each(|frame| frame.lidar.world_from_lidar = here);
        let mut slow = clip.clone();
        slow.frames.iter_mut().for_each(|frame| frame.lidar.timestamp *= 5.0);
        let ahead: Vec<usize> =
            (0..cloud.len()).filter(|&i| cloud.positions[i][0] - cloud.origins[i][0] > 5.0).collect();
        let part = PointCloud {
            positions: ahead.iter().map(|&i| cloud.positions[i]).collect(),
            times: ahead.iter().map(|&i| cloud.times[i]).collect(),
            frames: ahead.iter().map(|&i| cloud.frames[i]).collect(),
            origins: ahead.iter().map(|&i| cloud.origins[i]).collect(),
            num_missing: 0,
        };
        let mut timed = cloud.clone();
        timed.times[0] += 0.01;
        for (clip, cloud) in [(&standing, &cloud), (&slow, &cloud), (&clip, &part), (&clip, &timed)] {
            let mut told = cloud.clone();
            assert_eq!(tell_apart(&mut told, clip, &ClipFrame::of(clip, 0)).unwrap(), None);
            assert_eq!(&told, cloud);
        }
    }
}
