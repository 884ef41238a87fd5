//! Every check of what a `clip.json` says, before anything else looks at it.

use std::{
    collections::BTreeSet,
    path::{Component, Path, PathBuf},
};

use super::{BoxJson, ClipJson, CompensationJson, FrameJson, LidarJson, Rows, SensorsJson, ToJson, format_error};
use crate::{
    camera::Intrinsics,
    clip::{CLIP_FORMAT, Clip, Compensation, Frame, LidarRecord, ReturnsRecord, SensorsRecord, TrackedBox},
    error::{FormatError, Result},
    image::MAX_IMAGE_SIDE,
    pose::Pose,
    returns::{MAX_RETURN_TIME, MAX_SENSORS},
};

/// Largest absolute timestamp, seconds: an epoch in milliseconds or finer is in the wrong unit.
const MAX_TIMESTAMP: f64 = 1e11;
/// Largest translation along one axis, metres: beyond every map projection.
const MAX_TRANSLATION: f64 = 1e9;
/// Focal lengths that survive f32 arithmetic, pixels.
const FOCAL_RANGE: std::ops::RangeInclusive<f64> = 1e-3..=1e7;
/// Largest absolute principal point, pixels.
const MAX_PRINCIPAL_POINT: f64 = 1e7;
/// Farthest that a sensor may be from the LiDAR that it is a part of, metres: the length of a road train.
const MAX_MOUNT: f64 = 100.0;
/// Largest edge of a box, metres.
const MAX_BOX_EDGE: f64 = 1e4;
/// Longest camera name, bytes: it becomes part of a file's name.
const MAX_CAMERA_NAME: usize = 100;

/// Values of a `clip.json` on their way to validated types.
pub(crate) struct Checker<'a> {
    file: &'a Path,
}

impl<'a> Checker<'a> {
    /// A checker whose errors name `file`.
    pub(crate) fn new(file: &'a Path) -> Self {
        Self { file }
    }

    /// The clip that the mirror describes.
    ///
    /// # Errors
    /// The first value that is out of range, by its field.
    pub(super) fn clip(&self, json: ClipJson) -> Result<Clip> {
        if json.format != CLIP_FORMAT {
            return Err(format_error(self.file, &json.format));
        }
        if json.frames.is_empty() {
            return self.error("frames", "at least one frame", "an empty list");
        }
        let frames = json.frames.into_iter().enumerate().map(|(i, f)| self.frame(&format!("frames[{i}]"), f));
        let frames = frames.collect::<Result<_>>()?;
        Ok(Clip { name: json.name, source: json.source, licence: json.licence, frames })
    }

    pub(super) fn error<T>(
        &self,
        field: impl Into<String>,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> Result<T> {
        Err(FormatError::invalid(self.file, field, expected, found))
    }

    fn frame(&self, at: &str, json: FrameJson) -> Result<Frame> {
        let lidar = self.lidar(&format!("{at}.lidar"), json.lidar)?;
        let mut names = BTreeSet::new();
        let mut cameras = Vec::with_capacity(json.cameras.len());
        for (i, camera) in json.cameras.into_iter().enumerate() {
            let at = format!("{at}.cameras[{i}]");
            if !names.insert(camera.name.clone()) {
                let found = format!("`{}` twice", camera.name);
                return self.error(format!("{at}.name"), "a name that occurs once in a frame", found);
            }
            cameras.push(self.camera(&at, camera, lidar.timestamp)?);
        }
        let boxes = json.boxes.map(|boxes| self.boxes(at, boxes)).transpose()?;
        Ok(Frame { lidar, cameras, boxes })
    }

    fn lidar(&self, at: &str, json: LidarJson) -> Result<LidarRecord> {
        let compensation = self.compensation(at, &json)?;
        Ok(LidarRecord {
            file: self.path(&format!("{at}.file"), json.file)?,
            timestamp: self.timestamp(&format!("{at}.timestamp"), json.timestamp)?,
            world_from_lidar: self.pose(&format!("{at}.world_from_lidar"), &json.world_from_lidar)?,
            returns: ReturnsRecord {
                compensation,
                times: json.times.map(|times| self.path(&format!("{at}.times"), times)).transpose()?,
                sensors: json.sensors.map(|sensors| self.sensors(&format!("{at}.sensors"), sensors)).transpose()?,
            },
        })
    }

    fn compensation(&self, at: &str, json: &LidarJson) -> Result<Compensation> {
        let field = format!("{at}.motion_compensated");
        match json.motion_compensated {
            None => Ok(Compensation::default()),
            Some(CompensationJson::To(ToJson { to })) => {
                let limit = f64::from(MAX_RETURN_TIME);
                self.within(&format!("{field}.to"), &format!("seconds within {limit}"), to, limit).map(Compensation::To)
            }
            Some(CompensationJson::Is(false)) if json.times.is_some() => Ok(Compensation::None),
            Some(CompensationJson::Is(false)) => self.error(field, "`times` beside false", "none"),
            Some(CompensationJson::Is(true)) => {
                self.error(field, "false or {\"to\": seconds since the sweep's timestamp}", "true")
            }
        }
    }

    fn sensors(&self, at: &str, json: SensorsJson) -> Result<SensorsRecord> {
        let count = json.lidar_from_sensor.len();
        if !(1..=MAX_SENSORS).contains(&count) {
            return self.error(
                format!("{at}.lidar_from_sensor"),
                format!("1 to {MAX_SENSORS} poses"),
                count.to_string(),
            );
        }
        let pose = |(i, rows): (usize, &Rows)| {
            let field = format!("{at}.lidar_from_sensor[{i}]");
            let pose = self.pose(&field, rows)?;
            let farthest = pose.translation().abs().max_element();
            self.within(&field, &format!("a sensor within {MAX_MOUNT} m of the LiDAR"), farthest, MAX_MOUNT)?;
            Ok(pose)
        };
        let lidar_from_sensor = json.lidar_from_sensor.iter().enumerate().map(pose).collect::<Result<_>>()?;
        Ok(SensorsRecord { file: self.path(&format!("{at}.file"), json.file)?, lidar_from_sensor })
    }

    /// Fails unless a width and a height and intrinsics are those of a camera that can be drawn.
    ///
    /// # Errors
    /// The value that is not, by its key below `at`.
    pub(crate) fn pinhole(&self, at: &str, [width, height]: [u32; 2], intrinsics: Intrinsics) -> Result<()> {
        let at = if at.is_empty() { String::new() } else { format!("{at}.") };
        for (key, side) in [("width", width), ("height", height)] {
            if side == 0 || side > MAX_IMAGE_SIDE {
                return self.error(format!("{at}{key}"), format!("1 to {MAX_IMAGE_SIDE} pixels"), side.to_string());
            }
        }
        let Intrinsics { fx, fy, cx, cy } = intrinsics;
        for (key, focal) in [("fx", fx), ("fy", fy)] {
            if !FOCAL_RANGE.contains(&focal) {
                let expected = format!("a focal length of {} to {} pixels", FOCAL_RANGE.start(), FOCAL_RANGE.end());
                return self.error(format!("{at}intrinsics.{key}"), expected, focal.to_string());
            }
        }
        for (key, point) in [("cx", cx), ("cy", cy)] {
            let expected = format!("a principal point within {MAX_PRINCIPAL_POINT} pixels");
            self.within(&format!("{at}intrinsics.{key}"), &expected, point, MAX_PRINCIPAL_POINT)?;
        }
        Ok(())
    }

    fn boxes(&self, at: &str, boxes: Vec<BoxJson>) -> Result<Vec<TrackedBox>> {
        let mut tracks = BTreeSet::new();
        let mut checked = Vec::with_capacity(boxes.len());
        for (i, json) in boxes.into_iter().enumerate() {
            let at = format!("{at}.boxes[{i}]");
            if !tracks.insert(json.track.clone()) {
                let found = format!("`{}` twice", json.track);
                return self.error(format!("{at}.track"), "a track that occurs once in a frame", found);
            }
            for (axis, &edge) in json.size.iter().enumerate() {
                if !(edge > 0.0 && edge <= MAX_BOX_EDGE) {
                    let expected = format!("a positive length of at most {MAX_BOX_EDGE} m");
                    return self.error(format!("{at}.size[{axis}]"), expected, edge.to_string());
                }
            }
            let world_from_box = self.pose(&format!("{at}.world_from_box"), &json.world_from_box)?;
            checked.push(TrackedBox { track: json.track, category: json.category, size: json.size, world_from_box });
        }
        Ok(checked)
    }

    pub(super) fn within(&self, field: &str, expected: &str, value: f64, limit: f64) -> Result<f64> {
        if value.abs() <= limit { Ok(value) } else { self.error(field, expected, value.to_string()) }
    }

    /// The timestamp, when it is one.
    ///
    /// # Errors
    /// It is not finite, or in another unit than seconds.
    pub(crate) fn timestamp(&self, field: &str, seconds: f64) -> Result<f64> {
        self.within(field, &format!("finite seconds within {MAX_TIMESTAMP}"), seconds, MAX_TIMESTAMP)
    }

    /// The pose of the rows of a matrix.
    ///
    /// # Errors
    /// It is not rigid, or beyond every map.
    pub(crate) fn pose(&self, field: &str, rows: &Rows) -> Result<Pose> {
        let pose = Pose::from_rows(rows).or_else(|found| self.error(field, "a rigid 4x4 pose", found))?;
        for (row, value) in pose.translation().to_array().into_iter().enumerate() {
            let expected = format!("a translation within {MAX_TRANSLATION} m");
            self.within(&format!("{field}[{row}][3]"), &expected, value, MAX_TRANSLATION)?;
        }
        Ok(pose)
    }

    pub(super) fn path(&self, field: &str, path: PathBuf) -> Result<PathBuf> {
        let inside = |c: Component<'_>| matches!(c, Component::Normal(_) | Component::CurDir);
        let printable = path.to_str().is_some_and(|text| !text.chars().any(char::is_control));
        if printable && path.components().all(inside) && path.file_name().is_some() {
            return Ok(path);
        }
        self.error(field, "a relative path within the clip directory, without `..`", format!("`{}`", path.display()))
    }

    pub(super) fn camera_name(&self, field: &str, name: &str) -> Result<()> {
        let length = 1..=MAX_CAMERA_NAME;
        let harmless = |c: char| !c.is_control() && !"/\\,".contains(c);
        if length.contains(&name.len()) && !name.starts_with('.') && name.chars().all(harmless) {
            return Ok(());
        }
        let expected = format!("1 to {MAX_CAMERA_NAME} bytes that can be part of a file's name, without `,`");
        self.error(field, expected, format!("{name:?}"))
    }
}
