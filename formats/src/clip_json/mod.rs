//! The text of `clip.json`: the mirror that serde reads and writes, and its way to and from [`Clip`].

mod camera;
pub(crate) mod check;

use std::path::{Path, PathBuf};

use glam::DMat3;
use serde::{Deserialize, Serialize};

use crate::{
    camera::{Camera, Distortion, Intrinsics, Readout},
    clip::{CLIP_FORMAT, CameraRecord, Clip, Compensation, DepthKind, Frame, SensorsRecord, TrackedBox},
    error::{FormatError, Result},
    pose::Pose,
};
use check::Checker;

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
    #[serde(default, skip_serializing_if = "Option::is_none")]
    times: Option<PathBuf>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    motion_compensated: Option<CompensationJson>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    sensors: Option<SensorsJson>,
}

#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected `false` or {\"to\": seconds since the sweep's timestamp}")]
enum CompensationJson {
    Is(bool),
    To(ToJson),
}

#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ToJson {
    to: f64,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SensorsJson {
    file: PathBuf,
    lidar_from_sensor: Vec<Rows>,
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
    fisheye: Option<[f64; 4]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pinhole: Option<PinholeJson>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    readout: Option<Readout>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    mask: Option<PathBuf>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    depth: Option<DepthJson>,
    world_from_camera: Rows,
}

/// The pinhole that is cut out of a fisheye's image.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PinholeJson {
    width: u32,
    height: u32,
    intrinsics: Intrinsics,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    fisheye_from_pinhole: Option<[[f64; 3]; 3]>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct DepthJson {
    file: PathBuf,
    kind: DepthKind,
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
    let text = without_mark(text);
    let mut deserializer = serde_json::Deserializer::from_slice(text);
    let json: ClipJson = serde_path_to_error::deserialize(&mut deserializer)
        .map_err(|e| wrong_format(file, text).unwrap_or_else(|| syntax_error(file, text, &e)))?;
    deserializer.end().map_err(|e| line_error(file, text, "end of file", &e))?;
    Checker::new(file).clip(json)
}

/// The text without the mark of UTF-8 that some editors put before it.
pub(crate) fn without_mark(text: &[u8]) -> &[u8] {
    text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text)
}

/// The text of the `clip.json` of a clip, which [`parse`] reads back to the same bits.
///
/// # Errors
/// A clip that [`parse`] would refuse.
pub(crate) fn to_text(file: &Path, clip: &Clip) -> Result<Vec<u8>> {
    Checker::new(file).clip(mirror(clip))?;
    let mut text =
        serde_json::to_vec_pretty(&mirror(clip)).map_err(|e| FormatError::syntax(file, "clip", e.to_string()))?;
    text.push(b'\n');
    Ok(text)
}

/// The clip, when [`parse`] would take it; `file` is what errors name.
///
/// # Errors
/// Values out of range, each by its field.
pub(crate) fn checked(file: &Path, clip: &Clip) -> Result<Clip> {
    Checker::new(file).clip(mirror(clip))
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

/// The error of a JSON parser with the path of the field and its line.
pub(crate) fn syntax_error(
    file: &Path,
    text: &[u8],
    error: &serde_path_to_error::Error<serde_json::Error>,
) -> FormatError {
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
    FormatError::syntax(file, format!("{path} (line {line})"), message)
}

/// The mirror of a compensation; the default is not said.
fn compensation(found: Compensation) -> Option<CompensationJson> {
    match found {
        found if found == Compensation::default() => None,
        Compensation::To(to) => Some(CompensationJson::To(ToJson { to })),
        Compensation::None => Some(CompensationJson::Is(false)),
    }
}

/// The mirror of a camera, without files.
fn of_camera(camera: &Camera) -> CameraJson {
    let json = CameraJson {
        name: camera.name.clone(),
        file: PathBuf::new(),
        timestamp: camera.timestamp,
        width: camera.width,
        height: camera.height,
        intrinsics: camera.intrinsics,
        distortion: None,
        fisheye: None,
        pinhole: None,
        readout: camera.readout,
        mask: None,
        depth: None,
        world_from_camera: camera.world_from_camera.rows(),
    };
    match camera.distortion {
        None => json,
        Some(Distortion::BrownConrady(coefficients)) => CameraJson { distortion: Some(coefficients), ..json },
        Some(Distortion::Fisheye(lens)) => {
            let own = (json.width, json.height, json.intrinsics) == (lens.width, lens.height, lens.intrinsics);
            let turned = (lens.fisheye_from_pinhole != DMat3::IDENTITY)
                .then(|| lens.fisheye_from_pinhole.transpose().to_cols_array_2d());
            let pinhole = PinholeJson {
                width: json.width,
                height: json.height,
                intrinsics: json.intrinsics,
                fisheye_from_pinhole: turned,
            };
            CameraJson {
                width: lens.width,
                height: lens.height,
                intrinsics: lens.intrinsics,
                fisheye: Some(lens.coefficients),
                pinhole: (!own || turned.is_some()).then_some(pinhole),
                world_from_camera: lens.world_from_fisheye.rows(),
                ..json
            }
        }
    }
}

/// The mirror of a clip.
fn mirror(clip: &Clip) -> ClipJson {
    let camera = |record: &CameraRecord| CameraJson {
        mask: record.mask.clone(),
        depth: record.depth.as_ref().map(|depth| DepthJson { file: depth.file.clone(), kind: depth.kind }),
        file: record.file.clone(),
        ..of_camera(&record.camera)
    };
    let tracked_box = |b: &TrackedBox| BoxJson {
        track: b.track.clone(),
        category: b.category.clone(),
        size: b.size,
        world_from_box: b.world_from_box.rows(),
    };
    let sensors = |sensors: &SensorsRecord| SensorsJson {
        file: sensors.file.clone(),
        lidar_from_sensor: sensors.lidar_from_sensor.iter().map(Pose::rows).collect(),
    };
    let frame = |frame: &Frame| FrameJson {
        lidar: LidarJson {
            file: frame.lidar.file.clone(),
            timestamp: frame.lidar.timestamp,
            world_from_lidar: frame.lidar.world_from_lidar.rows(),
            times: frame.lidar.returns.times.clone(),
            motion_compensated: compensation(frame.lidar.returns.compensation),
            sensors: frame.lidar.returns.sensors.as_ref().map(sensors),
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
