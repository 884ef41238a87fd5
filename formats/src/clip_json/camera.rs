//! The checks of what a `clip.json` says of cameras.

use glam::{DMat3, DVec3};

use super::{CameraJson, DepthJson, PinholeJson, check::Checker};
use crate::{
    camera::{Camera, Distortion, Fisheye, Readout},
    clip::{CameraRecord, DepthKind, DepthRecord},
    error::Result,
    pose::Pose,
};

/// Largest time between a camera and the sweep of its frame, seconds: more means two clocks.
const MAX_CLOCK_DIFFERENCE: f64 = 3600.0;
/// Longest readout of a rolling shutter, seconds: a longer one is in another unit.
const MAX_READOUT: f64 = 1.0;

impl Checker<'_> {
    /// The camera that a mirror describes.
    ///
    /// # Errors
    /// The first value that is out of range, by its field.
    pub(super) fn camera(&self, at: &str, json: CameraJson, lidar_timestamp: f64) -> Result<CameraRecord> {
        self.camera_name(&format!("{at}.name"), &json.name)?;
        self.pinhole(at, [json.width, json.height], json.intrinsics)?;
        let timestamp = self.timestamp(&format!("{at}.timestamp"), json.timestamp)?;
        if (timestamp - lidar_timestamp).abs() > MAX_CLOCK_DIFFERENCE {
            let expected = format!("at most {MAX_CLOCK_DIFFERENCE} s from its frame's LiDAR ({lidar_timestamp})");
            return self.error(format!("{at}.timestamp"), expected, timestamp.to_string());
        }
        let readout = json.readout.map(|readout| self.readout(at, readout)).transpose()?;
        let file = self.path(&format!("{at}.file"), json.file)?;
        let mask = json.mask.map(|mask| self.path(&format!("{at}.mask"), mask)).transpose()?;
        let plain = Camera {
            name: json.name,
            timestamp,
            width: json.width,
            height: json.height,
            intrinsics: json.intrinsics,
            distortion: json.distortion.map(Distortion::BrownConrady),
            readout,
            world_from_camera: self.pose(&format!("{at}.world_from_camera"), &json.world_from_camera)?,
        };
        for (i, &coefficient) in json.distortion.iter().flatten().enumerate() {
            self.within(&format!("{at}.distortion[{i}]"), "a finite coefficient", coefficient, f64::MAX)?;
        }
        let camera = match (json.fisheye, json.pinhole) {
            (None, None) => plain,
            (None, Some(_)) => return self.error(format!("{at}.pinhole"), "`fisheye` beside it", "none"),
            (Some(_), _) if json.distortion.is_some() => {
                return self.error(format!("{at}.fisheye"), "no `distortion` beside it", "both");
            }
            (Some(coefficients), pinhole) => self.fisheye(at, plain, coefficients, pinhole)?,
        };
        let depth = json.depth.map(|depth| self.depth(at, depth, &camera)).transpose()?;
        Ok(CameraRecord { file, mask, depth, camera })
    }

    fn readout(&self, at: &str, readout: Readout) -> Result<Readout> {
        let expected = format!("seconds within {MAX_READOUT} of the timestamp");
        self.within(&format!("{at}.readout.middle"), &expected, readout.middle, MAX_READOUT)?;
        if (0.0..=MAX_READOUT).contains(&readout.seconds) {
            return Ok(readout);
        }
        let expected = format!("0 to {MAX_READOUT} seconds from the first line to the last");
        self.error(format!("{at}.readout.seconds"), expected, readout.seconds.to_string())
    }

    /// The pinhole that is cut out of the image of a fisheye, which `plain` is but for its lens.
    fn fisheye(&self, at: &str, plain: Camera, coefficients: [f64; 4], pinhole: Option<PinholeJson>) -> Result<Camera> {
        for (i, coefficient) in coefficients.into_iter().enumerate() {
            self.within(&format!("{at}.fisheye[{i}]"), "a finite coefficient", coefficient, f64::MAX)?;
        }
        let Camera { width, height, intrinsics, world_from_camera: world_from_fisheye, .. } = plain;
        let lens = Fisheye {
            coefficients,
            width,
            height,
            intrinsics,
            world_from_fisheye,
            fisheye_from_pinhole: DMat3::IDENTITY,
        };
        let Some(pinhole) = pinhole else {
            return Ok(Camera { distortion: Some(Distortion::Fisheye(lens)), ..plain });
        };
        let at = format!("{at}.pinhole");
        self.pinhole(&at, [pinhole.width, pinhole.height], pinhole.intrinsics)?;
        let turned = pinhole.fisheye_from_pinhole.map_or(Ok(DMat3::IDENTITY), |[a, b, c]| {
            let row = |[x, y, z]: [f64; 3]| [x, y, z, 0.0];
            let rows = [row(a), row(b), row(c), [0.0, 0.0, 0.0, 1.0]];
            Pose::from_rows(&rows)
                .map(|pose| pose.rotation())
                .or_else(|found| self.error(format!("{at}.fisheye_from_pinhole"), "the rows of a rotation", found))
        })?;
        let lens = Fisheye { fisheye_from_pinhole: turned, ..lens };
        Ok(Camera {
            width: pinhole.width,
            height: pinhole.height,
            intrinsics: pinhole.intrinsics,
            distortion: Some(Distortion::Fisheye(lens)),
            world_from_camera: world_from_fisheye * Pose::new(turned, DVec3::ZERO),
            ..plain
        })
    }

    fn depth(&self, at: &str, json: DepthJson, camera: &Camera) -> Result<DepthRecord> {
        if let (DepthKind::Relative, Some(Distortion::Fisheye(lens))) = (json.kind, camera.distortion)
            && lens.fisheye_from_pinhole != DMat3::IDENTITY
        {
            return self.error(format!("{at}.depth.kind"), "`metric` beside a turned pinhole", "`relative`");
        }
        Ok(DepthRecord { file: self.path(&format!("{at}.depth.file"), json.file)?, kind: json.kind })
    }
}
