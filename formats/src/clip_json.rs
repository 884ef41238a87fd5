//! The text of `clip.json`: the mirror that serde reads and writes, and its way to and from [`Clip`].

use std::{
    collections::BTreeSet,
    path::{Component, Path, PathBuf},
};

use serde::{Deserialize, Serialize};

use crate::{
    camera::{Camera, Distortion, Intrinsics},
    clip::{CLIP_FORMAT, CameraRecord, Clip, Frame, LidarRecord, TrackedBox},
    error::{FormatError, Result},
    image::MAX_IMAGE_SIDE,
    pose::Pose,
};

/// Largest absolute timestamp, seconds: an epoch in milliseconds or finer is in the wrong unit.
const MAX_TIMESTAMP: f64 = 1e11;
/// Largest time between a camera and the sweep of its frame, seconds: more means two clocks.
const MAX_CLOCK_DIFFERENCE: f64 = 3600.0;
/// Largest translation along one axis, metres: beyond every map projection.
const MAX_TRANSLATION: f64 = 1e9;
/// Focal lengths that survive f32 arithmetic, pixels.
const FOCAL_RANGE: std::ops::RangeInclusive<f64> = 1e-3..=1e7;
/// Largest absolute principal point, pixels.
const MAX_PRINCIPAL_POINT: f64 = 1e7;
/// Largest edge of a box, metres.
const MAX_BOX_EDGE: f64 = 1e4;
/// Longest camera name, bytes: it becomes part of a file's name.
const MAX_CAMERA_NAME: usize = 100;

type Rows = [[f64; 4]; 4];

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ClipJson {
    format: String,
    name: String,
    source: String,
    licence: String,
    frames: Vec<FrameJson>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct FrameJson {
    lidar: LidarJson,
    cameras: Vec<CameraJson>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    boxes: Option<Vec<BoxJson>>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct LidarJson {
    file: PathBuf,
    timestamp: f64,
    world_from_lidar: Rows,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraJson {
    name: String,
    file: PathBuf,
    timestamp: f64,
    width: u32,
    height: u32,
    intrinsics: Intrinsics,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    distortion: Option<[f64; 5]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    mask: Option<PathBuf>,
    world_from_camera: Rows,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct BoxJson {
    track: String,
    category: String,
    size: [f64; 3],
    world_from_box: Rows,
}

/// The clip that the text of a `clip.json` describes; `file` is what errors name.
///
/// # Errors
/// Text that is no JSON, keys or types that the format does not know, values out of range, each by its field.
pub(crate) fn parse(file: &Path, text: &[u8]) -> Result<Clip> {
    let mut deserializer = serde_json::Deserializer::from_slice(text);
    let json: ClipJson = serde_path_to_error::deserialize(&mut deserializer)
        .map_err(|e| wrong_format(file, text).unwrap_or_else(|| syntax_error(file, text, &e)))?;
    deserializer.end().map_err(|e| line_error(file, text, "end of file", &e))?;
    Checker { file }.clip(json)
}

/// The text of the `clip.json` of a clip, which [`parse`] reads back to the same bits.
///
/// # Errors
/// A clip that [`parse`] would refuse.
pub(crate) fn to_text(file: &Path, clip: &Clip) -> Result<Vec<u8>> {
    Checker { file }.clip(mirror(clip))?;
    let mut text = serde_json::to_vec_pretty(&mirror(clip)).map_err(|e| FormatError::Syntax {
        file: file.to_owned(),
        field: "clip".to_owned(),
        message: e.to_string(),
    })?;
    text.push(b'\n');
    Ok(text)
}

/// The error of another format's `clip.json`, whose keys need not be looked at.
fn wrong_format(file: &Path, text: &[u8]) -> Option<FormatError> {
    #[derive(Deserialize)]
    struct FormatOnly {
        format: String,
    }
    let FormatOnly { format } = serde_json::from_slice(text).ok()?;
    (format != CLIP_FORMAT).then(|| format_error(file, &format))
}

fn format_error(file: &Path, found: &str) -> FormatError {
    FormatError::invalid(file, "format", format!("`{CLIP_FORMAT}`"), format!("`{found}`"))
}

fn syntax_error(file: &Path, text: &[u8], error: &serde_path_to_error::Error<serde_json::Error>) -> FormatError {
    let path = error.path().to_string();
    line_error(file, text, if path == "." { "top level" } else { &path }, error.inner())
}

/// The error with the place in words, and with the text at that place where the parser only says that it is wrong.
fn line_error(file: &Path, text: &[u8], path: &str, error: &serde_json::Error) -> FormatError {
    let (line, column) = (error.line(), error.column());
    let sentence = error.to_string();
    let mut message = sentence.trim_end_matches(&format!(" at line {line} column {column}")).to_owned();
    if error.is_syntax() {
        let tail = text.split(|&b| b == b'\n').nth(line.saturating_sub(1)).unwrap_or_default();
        let tail = tail.get(column.saturating_sub(1)..).unwrap_or_default();
        let end = tail.iter().position(|b| b" ,]}\r".contains(b)).unwrap_or(tail.len()).min(20);
        message.push_str(&format!(", found `{}`", String::from_utf8_lossy(&tail[..end])));
    }
    FormatError::Syntax { file: file.to_owned(), field: format!("{path} (line {line})"), message }
}

/// Values of a `clip.json` on their way to validated types.
struct Checker<'a> {
    file: &'a Path,
}

impl Checker<'_> {
    fn error<T>(&self, field: impl Into<String>, expected: impl Into<String>, found: impl Into<String>) -> Result<T> {
        Err(FormatError::invalid(self.file, field, expected, found))
    }

    fn clip(&self, json: ClipJson) -> Result<Clip> {
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
        Ok(LidarRecord {
            file: self.path(&format!("{at}.file"), json.file)?,
            timestamp: self.timestamp(&format!("{at}.timestamp"), json.timestamp)?,
            world_from_lidar: self.pose(&format!("{at}.world_from_lidar"), &json.world_from_lidar)?,
        })
    }

    fn camera(&self, at: &str, json: CameraJson, lidar_timestamp: f64) -> Result<CameraRecord> {
        self.camera_name(&format!("{at}.name"), &json.name)?;
        let file = self.path(&format!("{at}.file"), json.file)?;
        let mask = json.mask.map(|mask| self.path(&format!("{at}.mask"), mask)).transpose()?;
        let timestamp = self.timestamp(&format!("{at}.timestamp"), json.timestamp)?;
        if (timestamp - lidar_timestamp).abs() > MAX_CLOCK_DIFFERENCE {
            let expected = format!("at most {MAX_CLOCK_DIFFERENCE} s from its frame's LiDAR ({lidar_timestamp})");
            return self.error(format!("{at}.timestamp"), expected, timestamp.to_string());
        }
        for (key, side) in [("width", json.width), ("height", json.height)] {
            if side == 0 || side > MAX_IMAGE_SIDE {
                return self.error(format!("{at}.{key}"), format!("1 to {MAX_IMAGE_SIDE} pixels"), side.to_string());
            }
        }
        let k = json.intrinsics;
        for (key, focal) in [("fx", k.fx), ("fy", k.fy)] {
            if !FOCAL_RANGE.contains(&focal) {
                let expected = format!("a focal length of {} to {} pixels", FOCAL_RANGE.start(), FOCAL_RANGE.end());
                return self.error(format!("{at}.intrinsics.{key}"), expected, focal.to_string());
            }
        }
        for (key, point) in [("cx", k.cx), ("cy", k.cy)] {
            let expected = format!("a principal point within {MAX_PRINCIPAL_POINT} pixels");
            self.within(&format!("{at}.intrinsics.{key}"), &expected, point, MAX_PRINCIPAL_POINT)?;
        }
        for (i, &coefficient) in json.distortion.iter().flatten().enumerate() {
            self.within(&format!("{at}.distortion[{i}]"), "a finite coefficient", coefficient, f64::MAX)?;
        }
        let world_from_camera = self.pose(&format!("{at}.world_from_camera"), &json.world_from_camera)?;
        let camera = Camera {
            name: json.name,
            timestamp,
            width: json.width,
            height: json.height,
            intrinsics: k,
            distortion: json.distortion.map(Distortion),
            world_from_camera,
        };
        Ok(CameraRecord { file, mask, camera })
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

    fn within(&self, field: &str, expected: &str, value: f64, limit: f64) -> Result<f64> {
        if value.abs() <= limit { Ok(value) } else { self.error(field, expected, value.to_string()) }
    }

    fn timestamp(&self, field: &str, seconds: f64) -> Result<f64> {
        self.within(field, &format!("finite seconds within {MAX_TIMESTAMP}"), seconds, MAX_TIMESTAMP)
    }

    fn pose(&self, field: &str, rows: &Rows) -> Result<Pose> {
        let pose = Pose::from_rows(rows).or_else(|found| self.error(field, "a rigid 4x4 pose", found))?;
        for (row, value) in pose.translation().to_array().into_iter().enumerate() {
            let expected = format!("a translation within {MAX_TRANSLATION} m");
            self.within(&format!("{field}[{row}][3]"), &expected, value, MAX_TRANSLATION)?;
        }
        Ok(pose)
    }

    fn path(&self, field: &str, path: PathBuf) -> Result<PathBuf> {
        let inside = |c: Component<'_>| matches!(c, Component::Normal(_) | Component::CurDir);
        if path.components().all(inside) && path.file_name().is_some() {
            return Ok(path);
        }
        self.error(field, "a relative path within the clip directory, without `..`", format!("`{}`", path.display()))
    }

    fn camera_name(&self, field: &str, name: &str) -> Result<()> {
        let length = 1..=MAX_CAMERA_NAME;
        let harmless = |c: char| !c.is_control() && !"/\\,".contains(c);
        if length.contains(&name.len()) && !name.starts_with('.') && name.chars().all(harmless) {
            return Ok(());
        }
        let expected = format!("1 to {MAX_CAMERA_NAME} bytes that can be part of a file's name, without `,`");
        self.error(field, expected, format!("{name:?}"))
    }
}

/// The mirror of a clip.
fn mirror(clip: &Clip) -> ClipJson {
    let camera = |record: &CameraRecord| CameraJson {
        name: record.camera.name.clone(),
        file: record.file.clone(),
        timestamp: record.camera.timestamp,
        width: record.camera.width,
        height: record.camera.height,
        intrinsics: record.camera.intrinsics,
        distortion: record.camera.distortion.map(|d| d.0),
        mask: record.mask.clone(),
        world_from_camera: record.camera.world_from_camera.rows(),
    };
    let tracked_box = |b: &TrackedBox| BoxJson {
        track: b.track.clone(),
        category: b.category.clone(),
        size: b.size,
        world_from_box: b.world_from_box.rows(),
    };
    let frame = |frame: &Frame| FrameJson {
        lidar: LidarJson {
            file: frame.lidar.file.clone(),
            timestamp: frame.lidar.timestamp,
            world_from_lidar: frame.lidar.world_from_lidar.rows(),
        },
        cameras: frame.cameras.iter().map(camera).collect(),
        boxes: frame.boxes.as_ref().map(|boxes| boxes.iter().map(tracked_box).collect()),
    };
    ClipJson {
        format: CLIP_FORMAT.to_owned(),
        name: clip.name.clone(),
        source: clip.source.clone(),
        licence: clip.licence.clone(),
        frames: clip.frames.iter().map(frame).collect(),
    }
}
