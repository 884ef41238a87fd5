//! Calibration files of a date: lines of `key: numbers`.

use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec3};

use crate::{
    camera::Intrinsics,
    error::{FormatError, Result},
    importers::values::read_text,
    pose::Pose,
};

/// A text file of lines `key: values`.
#[derive(Debug)]
struct KeyFile {
    file: PathBuf,
    text: String,
}

impl KeyFile {
    fn read(file: &Path) -> Result<Self> {
        Ok(Self { file: file.to_owned(), text: read_text(file)? })
    }

    /// The `K` finite numbers of a key.
    fn numbers<const K: usize>(&self, key: &str) -> Result<[f64; K]> {
        let line = self.text.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(':')).unwrap_or_default();
        let values: Option<Vec<f64>> = line.split_whitespace().map(|word| word.parse().ok()).collect();
        let values = values.filter(|values| values.iter().all(|v| v.is_finite()));
        values.and_then(|values| values.try_into().ok()).ok_or_else(|| {
            let found = if line.is_empty() { "no such line".to_owned() } else { format!("`{}`", line.trim()) };
            FormatError::invalid(&self.file, key, format!("{K} numbers"), found)
        })
    }

    fn rotation(&self, key: &str) -> Result<DMat3> {
        let m: [f64; 9] = self.numbers(key)?;
        let rows = [[m[0], m[1], m[2], 0.0], [m[3], m[4], m[5], 0.0], [m[6], m[7], m[8], 0.0], [0.0, 0.0, 0.0, 1.0]];
        rotation(&rows).map_err(|found| FormatError::invalid(&self.file, key, "a rotation", found))
    }

    /// The transform of the keys `R` and `T`.
    fn transform(&self) -> Result<Pose> {
        Ok(Pose::new(self.rotation("R")?, DVec3::from(self.numbers::<3>("T")?)))
    }
}

/// The rotation nearest to that of the rows: a text has 7 digits.
///
/// # Errors
/// A sentence that says what was found instead of a rotation.
pub(super) fn rotation(rows: &[[f64; 4]; 4]) -> std::result::Result<DMat3, String> {
    Pose::from_rows(rows).map(|pose| DMat3::from_quat(DQuat::from_mat3(&pose.rotation()).normalize()))
}

/// What a date's calibration says.
#[derive(Debug)]
pub(super) struct Calibration {
    cameras: KeyFile,
    /// The rectified camera 0 from the LiDAR.
    pub(super) camera_0_from_lidar: Pose,
}

/// A rectified camera.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rectified {
    /// Pixels counted from the first one's centre.
    pub(super) intrinsics: Intrinsics,
    /// All rectified cameras look the same way.
    pub(super) camera_0_from_this: Pose,
}

impl Calibration {
    pub(super) fn read(date: &Path) -> Result<Self> {
        let cameras = KeyFile::read(&date.join(super::CALIBRATION))?;
        let camera_from_lidar = KeyFile::read(&date.join("calib_velo_to_cam.txt"))?.transform()?;
        let rectification = Pose::new(cameras.rotation("R_rect_00")?, DVec3::ZERO);
        Ok(Self { cameras, camera_0_from_lidar: rectification * camera_from_lidar })
    }

    /// The LiDAR from the inertial sensor.
    pub(super) fn lidar_from_imu(date: &Path) -> Result<Pose> {
        KeyFile::read(&date.join("calib_imu_to_velo.txt"))?.transform()
    }

    /// The camera with number `number`, two digits.
    ///
    /// # Formula
    /// `P = K [I | t]`, so that a point of camera 0 is at `x + t` in this camera.
    pub(super) fn rectified(&self, number: &str) -> Result<Rectified> {
        let key = format!("P_rect_{number}");
        let [fx, skew, cx, x, zero, fy, cy, y, a, b, one, z] = self.cameras.numbers(&key)?;
        if [skew, zero, a, b, one] != [0.0, 0.0, 0.0, 0.0, 1.0] || fx <= 0.0 || fy <= 0.0 {
            let found = format!("{:?}", [[fx, skew, cx], [zero, fy, cy], [a, b, one]]);
            return Err(FormatError::invalid(&self.cameras.file, key, "a pinhole without skew", found));
        }
        let offset = DVec3::new((x - cx * z) / fx, (y - cy * z) / fy, z);
        let camera_0_from_this = Pose::new(DMat3::IDENTITY, -offset);
        Ok(Rectified { intrinsics: Intrinsics { fx, fy, cx, cy }, camera_0_from_this })
    }
}
