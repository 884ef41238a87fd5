//! The sensors on the vehicle: cameras and a spinning LiDAR, checked.
//!
//! The vehicle's frame has its origin on the ground under the middle of the vehicle, x forward, y left, z up.

use glam::{DMat3, DVec3};
use lgs_formats::{
    camera::{Intrinsics, Readout},
    pose::Pose,
};

use super::{
    check::{Range, check},
    maths::{rotation_x, rotation_y, rotation_z},
};
use crate::error::{Result, TrainError};

/// Names of cameras in the order in which a rig takes them, with their yaw in degrees to the left.
pub const CAMERA_PLACES: [(&str, f64); 6] = [
    ("front", 0.0),
    ("front_left", 45.0),
    ("front_right", -45.0),
    ("side_left", 90.0),
    ("side_right", -90.0),
    ("rear", 180.0),
];

/// Largest field of view of a pinhole and of a fisheye, degrees.
const MAX_FOV: [f64; 2] = [140.0, 220.0];

/// A camera on the vehicle: a pinhole without distortion, or a fisheye.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraSpec {
    /// Name, unique in the rig; letters, digits, `_` and `-`.
    pub name: String,
    /// Image width, pixels, 8..=4096.
    pub width: usize,
    /// Image height, pixels, 8..=4096.
    pub height: usize,
    /// Horizontal field of view, degrees, 10..=140; of a fisheye up to 220.
    pub fov_deg: f64,
    /// Position in the vehicle's frame, metres.
    pub position: [f64; 3],
    /// Direction of view to the left of straight ahead, degrees.
    pub yaw_deg: f64,
    /// Direction of view below the horizon, degrees, -45..=45.
    pub pitch_deg: f64,
    /// Rotation about the axis of view, degrees, -45..=45.
    pub roll_deg: f64,
    /// Moment of exposure after the frame's LiDAR timestamp, of the middle of a rolling shutter's readout, seconds, -0.5..=0.5.
    pub delay_s: f64,
    /// The shutter, where it rolls: 0..=0.2 seconds.
    pub readout: Option<Readout>,
    /// The coefficients of a fisheye lens, each within +-1; `None`: a pinhole.
    pub fisheye: Option<[f64; 4]>,
}

impl CameraSpec {
    /// A camera of [`CAMERA_PLACES`] on a roof 1.6 m above the ground.
    pub fn at_place(place: (&str, f64), height: usize, width: usize, fov_deg: f64) -> Self {
        let forward = rotation_z(place.1.to_radians()).x_axis;
        Self {
            name: place.0.to_owned(),
            width,
            height,
            fov_deg,
            position: [0.6 + 0.9 * forward.x, 0.7 * forward.y, 1.6],
            yaw_deg: place.1,
            pitch_deg: 0.0,
            roll_deg: 0.0,
            delay_s: 0.0,
            readout: None,
            fisheye: None,
        }
    }

    /// Intrinsics: square pixels, the principal point in the middle.
    pub fn intrinsics(&self) -> Intrinsics {
        let (cx, cy) = (0.5 * self.width as f64, 0.5 * self.height as f64);
        let angle = 0.5 * self.fov_deg.to_radians();
        let focal = cx / self.fisheye.map_or_else(|| libm::tan(angle), |lens| fisheye_radius(&lens, angle));
        Intrinsics { fx: focal, fy: focal, cx, cy }
    }

    /// `vehicle_from_camera`: camera axes x right, y down, z forward.
    pub fn mount(&self) -> Pose {
        let looking = DMat3::from_cols(-DVec3::Y, -DVec3::Z, DVec3::X);
        let turned = rotation_z(self.yaw_deg.to_radians())
            * rotation_y(self.pitch_deg.to_radians())
            * rotation_x(self.roll_deg.to_radians());
        Pose::new(turned * looking, DVec3::from_array(self.position))
    }
}

/// Distance from the middle of the image of a fisheye at focal length 1, of a ray at an angle (radians) from its axis.
fn fisheye_radius([k1, k2, k3, k4]: &[f64; 4], angle: f64) -> f64 {
    let s = angle * angle;
    angle * (1.0 + s * (k1 + s * (k2 + s * (k3 + s * k4))))
}

/// The angle (radians) from the axis of a fisheye at a distance from the middle of its image at focal length 1; at most a half turn.
pub(crate) fn fisheye_angle(lens: &[f64; 4], radius: f64) -> f64 {
    /// Halvings of the half turn.
    const STEPS: usize = 52;
    let (mut low, mut high) = (0.0, std::f64::consts::PI);
    for _ in 0..STEPS {
        let middle = 0.5 * (low + high);
        if fisheye_radius(lens, middle) < radius { low = middle } else { high = middle }
    }
    low
}

/// A spinning LiDAR.
#[derive(Clone, Debug, PartialEq)]
pub struct LidarSpec {
    /// Position in the vehicle's frame, metres.
    pub position: [f64; 3],
    /// Beams, 1..=256.
    pub num_beams: usize,
    /// Elevation of the lowest and the highest beam above the horizon, degrees, -60..=60.
    pub elevation_deg: [f64; 2],
    /// Rays of a beam, 1..=8192.
    pub num_azimuths: usize,
    /// Azimuth of the first ray to the left of straight ahead and of the end of the sweep, degrees, -360..=360.
    pub azimuth_deg: [f64; 2],
    /// Standard deviation of ranges, metres, 0..=0.5.
    pub range_noise_m: f64,
    /// Share of returns lost in the best conditions, 0..=0.95; grows with distance and at grazing angles.
    pub dropout: f64,
    /// Nearest and farthest range that gives a return, metres, 0.1..=500.
    pub range_m: [f64; 2],
    /// Time that a sweep takes, seconds, 0..=0.5: the first ray leaves half of it before the frame's timestamp, the last half of it after.
    /// At 0 all leave at once.
    pub sweep_s: f64,
    /// Whether points stand in the LiDAR's frame at the frame's timestamp whenever their rays leave, or in its frame when they leave.
    pub compensated: bool,
}

impl LidarSpec {
    /// A full turn of `num_beams` x `num_azimuths` rays from 1.9 m above the ground.
    pub fn spinning(num_beams: usize, num_azimuths: usize) -> Self {
        Self {
            position: [0.3, 0.0, 1.9],
            num_beams,
            elevation_deg: [-22.0, 8.0],
            num_azimuths,
            azimuth_deg: [180.0, -180.0],
            range_noise_m: 0.015,
            dropout: 0.02,
            range_m: [1.5, 90.0],
            sweep_s: 0.0,
            compensated: true,
        }
    }

    /// `vehicle_from_lidar`.
    pub fn mount(&self) -> Pose {
        Pose::new(DMat3::IDENTITY, DVec3::from_array(self.position))
    }
}

/// The sensors of a vehicle.
#[derive(Clone, Debug, PartialEq)]
pub struct Rig {
    /// Cameras; at least one.
    pub cameras: Vec<CameraSpec>,
    /// The LiDAR.
    pub lidar: LidarSpec,
}

impl Rig {
    /// Fails for the first value out of its range.
    ///
    /// # Errors
    /// The first value that is out of its range, by its path.
    pub fn validate(&self) -> Result<()> {
        if self.cameras.is_empty() {
            return Err(TrainError::config("rig.cameras", "at least one camera", 0));
        }
        for (k, camera) in self.cameras.iter().enumerate() {
            camera.validate(&format!("rig.cameras[{k}]"))?;
            if self.cameras[..k].iter().any(|other| other.name == camera.name) {
                return Err(TrainError::config(format!("rig.cameras[{k}].name"), "a name of its own", &camera.name));
            }
        }
        self.lidar.validate()
    }
}

impl CameraSpec {
    fn validate(&self, path: &str) -> Result<()> {
        let plain = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
        if self.name.is_empty() || !self.name.chars().all(plain) {
            let found = format!("{:?}", self.name);
            return Err(TrainError::config(format!("{path}.name"), "letters, digits, `_` and `-`", found));
        }
        let field = |name: &str| format!("{path}.{name}");
        check(field("width"), self.width as f64, Range(8.0, 4096.0))?;
        check(field("height"), self.height as f64, Range(8.0, 4096.0))?;
        check(field("fov_deg"), self.fov_deg, Range(10.0, MAX_FOV[usize::from(self.fisheye.is_some())]))?;
        for (i, coefficient) in self.fisheye.into_iter().flatten().enumerate() {
            check(field(&format!("fisheye[{i}]")), coefficient, Range(-1.0, 1.0))?;
        }
        if let Some(readout) = self.readout {
            check(field("readout.seconds"), readout.seconds, Range(0.0, 0.2))?;
            check(field("readout.middle"), readout.middle, Range(-0.5, 0.5))?;
        }
        check_position(&field("position"), self.position)?;
        check(field("yaw_deg"), self.yaw_deg, Range(-360.0, 360.0))?;
        check(field("pitch_deg"), self.pitch_deg, Range(-45.0, 45.0))?;
        check(field("roll_deg"), self.roll_deg, Range(-45.0, 45.0))?;
        check(field("delay_s"), self.delay_s, Range(-0.5, 0.5))
    }
}

impl LidarSpec {
    fn validate(&self) -> Result<()> {
        let field = |name: &str| format!("rig.lidar.{name}");
        check_position(&field("position"), self.position)?;
        check(field("num_beams"), self.num_beams as f64, Range(1.0, 256.0))?;
        check(field("num_azimuths"), self.num_azimuths as f64, Range(1.0, 8192.0))?;
        check(field("elevation_deg[0]"), self.elevation_deg[0], Range(-60.0, 60.0))?;
        check(field("elevation_deg[1]"), self.elevation_deg[1], Range(self.elevation_deg[0], 60.0))?;
        check(field("azimuth_deg[0]"), self.azimuth_deg[0], Range(-360.0, 360.0))?;
        check(field("azimuth_deg[1]"), self.azimuth_deg[1], Range(-360.0, 360.0))?;
        check(field("range_noise_m"), self.range_noise_m, Range(0.0, 0.5))?;
        check(field("dropout"), self.dropout, Range(0.0, 0.95))?;
        check(field("range_m[0]"), self.range_m[0], Range(0.1, 500.0))?;
        check(field("range_m[1]"), self.range_m[1], Range(self.range_m[0], 500.0))?;
        check(field("sweep_s"), self.sweep_s, Range(0.0, 0.5))
    }
}

/// Sensors stay over the carriageway, above the kerbs.
fn check_position(path: &str, position: [f64; 3]) -> Result<()> {
    check(format!("{path}[0]"), position[0], Range(-3.0, 3.0))?;
    check(format!("{path}[1]"), position[1], Range(-1.2, 1.2))?;
    check(format!("{path}[2]"), position[2], Range(0.5, 5.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rig() -> Rig {
        Rig {
            cameras: CAMERA_PLACES.map(|place| CameraSpec::at_place(place, 64, 128, 60.0)).to_vec(),
            lidar: LidarSpec::spinning(16, 100),
        }
    }

    #[test]
    fn cameras_look_where_their_yaw_says() {
        let camera = &rig().cameras[3];
        let forward = camera.mount().rotation().z_axis;
        assert!((forward - DVec3::Y).length() < 1e-12, "{forward}");
        let down = camera.mount().rotation().y_axis;
        assert!((down + DVec3::Z).length() < 1e-12);
        let pitched = CameraSpec { pitch_deg: 30.0, ..camera.clone() };
        assert!((pitched.mount().rotation().z_axis.z + 0.5).abs() < 1e-12);
        assert!((camera.intrinsics().fx - 64.0 / (30.0_f64).to_radians().tan()).abs() < 1e-9);
    }

    #[test]
    fn values_out_of_range_are_named() {
        assert!(rig().validate().is_ok());
        let message = |change: fn(&mut Rig)| {
            let mut rig = rig();
            change(&mut rig);
            rig.validate().unwrap_err().to_string()
        };
        assert!(message(|r| r.cameras[1].fov_deg = f64::NAN).starts_with("rig.cameras[1].fov_deg: expected 10..=140"));
        assert!(message(|r| r.cameras[2].name = "front".into()).contains("rig.cameras[2].name"));
        assert!(message(|r| r.cameras.clear()).contains("rig.cameras"));
        assert!(message(|r| r.lidar.num_beams = 0).contains("rig.lidar.num_beams"));
        assert!(message(|r| r.lidar.range_m = [5.0, 4.0]).contains("rig.lidar.range_m[1]"));
    }
}
