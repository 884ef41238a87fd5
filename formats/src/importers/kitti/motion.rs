//! Where the vehicle was: GPS and inertial measurements (`oxts/`), or poses of camera 0 (`poses.txt`).

use std::{f64::consts::PI, path::Path};

use glam::{DMat3, DVec3};

use super::{
    Times,
    calibration::{Calibration, rotation},
};
use crate::{
    error::{FormatError, Result},
    importers::{
        trajectory::{Moment, Trajectory},
        values::{numbered, read_text},
    },
    pose::Pose,
};

/// Radius of the earth in the development kit's map projection, metres.
const EARTH_RADIUS: f64 = 6_378_137.0;
/// Values of an `oxts` file.
const NUM_OXTS: usize = 30;

/// Poses by number or by moment.
#[derive(Debug)]
enum Poses {
    /// Of camera 0, one for each number.
    ///
    /// With the moments of the sweeps, fetched or not, between which it moves evenly.
    Numbered { poses: Vec<Pose>, sweeps: Option<Trajectory> },
    /// Of the inertial sensor: between its moments it is the vehicle that moves evenly.
    Timed { trajectory: Trajectory, imu_from_lidar: Pose },
}

/// Poses of a drive.
#[derive(Debug)]
pub(super) struct Motion {
    file: std::path::PathBuf,
    poses: Poses,
    camera_0_from_lidar: Pose,
}

impl Motion {
    /// The motion of a drive: `poses.txt` where there is one, else `oxts/`. `times` are those of the sweeps by their numbers.
    pub(super) fn read(drive: &Path, date: &Path, calibration: &Calibration, times: &Times) -> Result<Self> {
        let camera_0_from_lidar = calibration.camera_0_from_lidar;
        let file = drive.join("poses.txt");
        if file.is_file() {
            let poses = odometry(&file)?;
            let moments = poses.iter().zip(times.all());
            let moment =
                |(pose, time): (&Pose, Option<f64>)| Some(Moment { time: time?, pose: *pose * camera_0_from_lidar });
            let moments: Vec<Moment> = moments.filter_map(moment).collect();
            let sweeps = if moments.is_empty() { None } else { Some(Trajectory::new(&file, moments)?) };
            return Ok(Self { file, poses: Poses::Numbered { poses, sweeps }, camera_0_from_lidar });
        }
        let file = drive.join("oxts");
        if !file.is_dir() {
            return Err(FormatError::invalid(drive, "poses", "`oxts/` or `poses.txt`", "neither"));
        }
        let imu_from_lidar = Calibration::lidar_from_imu(date)?.inverse();
        let poses = Poses::Timed { trajectory: inertial(&file)?, imu_from_lidar };
        Ok(Self { file, poses, camera_0_from_lidar })
    }

    pub(super) fn world_from_lidar(&self, number: u64, time: f64) -> Result<Pose> {
        match &self.poses {
            Poses::Numbered { poses, .. } => Ok(self.of_number(poses, number)? * self.camera_0_from_lidar),
            Poses::Timed { trajectory, imu_from_lidar } => Ok(trajectory.at(time)? * *imu_from_lidar),
        }
    }

    pub(super) fn world_from_camera_0(&self, number: u64, time: f64) -> Result<Pose> {
        match &self.poses {
            Poses::Numbered { poses, .. } => self.of_number(poses, number),
            Poses::Timed { .. } => Ok(self.world_from_lidar(number, time)? * self.camera_0_from_lidar.inverse()),
        }
    }

    /// Where the scanner was at any moment around the sweeps.
    pub(super) fn world_from_lidar_at(&self, time: f64) -> Result<Pose> {
        match &self.poses {
            Poses::Timed { trajectory, imu_from_lidar } => Ok(trajectory.at(time)? * *imu_from_lidar),
            Poses::Numbered { sweeps: Some(sweeps), .. } => sweeps.at(time),
            Poses::Numbered { sweeps: None, .. } => {
                Err(FormatError::invalid(&self.file, "poses", "a line for each sweep", "none for any"))
            }
        }
    }

    fn of_number(&self, poses: &[Pose], number: u64) -> Result<Pose> {
        let pose = usize::try_from(number).ok().and_then(|number| poses.get(number));
        pose.copied().ok_or_else(|| {
            let found = format!("{} lines", poses.len());
            FormatError::invalid(&self.file, "poses", format!("a line for frame {number}"), found)
        })
    }
}

/// The numbers of a text line.
fn numbers<const K: usize>(file: &Path, field: &str, line: &str) -> Result<[f64; K]> {
    let values: Option<Vec<f64>> = line.split_whitespace().map(|word| word.parse().ok()).collect();
    let values = values.filter(|values| values.iter().all(|v| v.is_finite()));
    values.and_then(|values| values.try_into().ok()).ok_or_else(|| {
        let start: String = line.chars().take(60).collect();
        FormatError::invalid(file, field, format!("{K} numbers"), format!("`{start}`"))
    })
}

/// 3x4 poses of camera 0, a line each.
fn odometry(file: &Path) -> Result<Vec<Pose>> {
    let of_line = |(index, line): (usize, &str)| {
        let field = format!("line {}", index + 1);
        let m: [f64; 12] = numbers(file, &field, line)?;
        let rows =
            [[m[0], m[1], m[2], m[3]], [m[4], m[5], m[6], m[7]], [m[8], m[9], m[10], m[11]], [0.0, 0.0, 0.0, 1.0]];
        let rotation = rotation(&rows).map_err(|found| FormatError::invalid(file, &field, "a 3x4 pose", found))?;
        Ok(Pose::new(rotation, DVec3::new(m[3], m[7], m[11])))
    };
    read_text(file)?.lines().enumerate().map(of_line).collect()
}

/// Poses of the inertial sensor from measurements of position and attitude.
///
/// # Formula
/// With `s = cos(latitude of the first)`: `x = s r lon`, `y = s r log(tan(pi/4 + lat/2))`, `z = alt`;
/// `R = Rz(yaw) Ry(pitch) Rx(roll)`.
///
/// # Source
/// `convertOxtsToPose.m` of KITTI's raw development kit.
fn inertial(folder: &Path) -> Result<Trajectory> {
    let times = Times::read(&folder.join("timestamps.txt"))?;
    let mut scale = None;
    let mut moments = Vec::new();
    for found in numbered(&folder.join("data"), &[".txt"])? {
        let file = folder.join("data").join(&found.name);
        let values: [f64; NUM_OXTS] = numbers(&file, "values", read_text(&file)?.trim())?;
        let [latitude, longitude, altitude, roll, pitch, yaw] = [0, 1, 2, 3, 4, 5].map(|k| values[k]);
        if latitude.abs() >= 90.0 {
            let found = latitude.to_string();
            return Err(FormatError::invalid(&file, "latitude", "degrees between -90 and 90", found));
        }
        let scale = *scale.get_or_insert_with(|| latitude.to_radians().cos());
        let place = DVec3::new(
            scale * EARTH_RADIUS * longitude.to_radians(),
            scale * EARTH_RADIUS * (PI / 4.0 + latitude.to_radians() / 2.0).tan().ln(),
            altitude,
        );
        let turn = DMat3::from_rotation_z(yaw) * DMat3::from_rotation_y(pitch) * DMat3::from_rotation_x(roll);
        moments.push(Moment { time: times.of(found.number)?, pose: Pose::new(turn, place) });
    }
    Trajectory::new(folder, moments)
}
