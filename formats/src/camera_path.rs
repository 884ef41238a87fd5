//! Camera paths: `lgs-path/1`, the places from which a film of a scene is taken, as a user writes them.

use std::path::Path;

use serde::Deserialize;

use crate::{
    camera::Intrinsics,
    clip_json::{check::Checker, syntax_error},
    error::{FormatError, Result},
    pose::Pose,
    read::read_file,
};

/// The value of `format` in a path's file.
pub const PATH_FORMAT: &str = "lgs-path/1";
/// Largest number of poses.
pub const MAX_POSES: usize = 10_000;
/// Largest file of a path, bytes.
const MAX_PATH_BYTES: u64 = 16 << 20;

/// A camera path.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraPath {
    /// The camera; `None`: one of the clip's.
    pub lens: Option<PathLens>,
    /// Where it is and when; at least one.
    pub keys: Vec<PathKey>,
}

/// The pinhole of a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathLens {
    /// Width of the pictures, pixels.
    pub width: u32,
    /// Height of the pictures, pixels.
    pub height: u32,
    /// Intrinsics at that size.
    pub intrinsics: Intrinsics,
}

/// One place on a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathKey {
    /// Moment that is shown, seconds, in the clip's own time scale.
    pub timestamp: f64,
    /// Pose of the camera in the clip's world frame.
    pub world_from_camera: Pose,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PathJson {
    format: String,
    #[serde(default)]
    camera: Option<LensJson>,
    poses: Vec<KeyJson>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct LensJson {
    width: u32,
    height: u32,
    intrinsics: Intrinsics,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct KeyJson {
    timestamp: f64,
    world_from_camera: [[f64; 4]; 4],
}

/// The camera path of a file.
///
/// # Errors
/// A file that is missing, too large or no JSON; another format; keys or types that the format does not know; no pose or more than
/// [`MAX_POSES`]; values out of range, each by its field.
pub fn read_path(file: &Path) -> Result<CameraPath> {
    let text = read_file(file, MAX_PATH_BYTES)?;
    parse(file, &text)
}

fn parse(file: &Path, text: &[u8]) -> Result<CameraPath> {
    #[derive(Deserialize)]
    struct FormatOnly {
        format: String,
    }
    let wrong = |found: &str| FormatError::invalid(file, "format", format!("`{PATH_FORMAT}`"), format!("`{found}`"));
    if let Ok(FormatOnly { format }) = serde_json::from_slice(text)
        && format != PATH_FORMAT
    {
        return Err(wrong(&format));
    }
    let mut deserializer = serde_json::Deserializer::from_slice(text);
    let json: PathJson =
        serde_path_to_error::deserialize(&mut deserializer).map_err(|e| syntax_error(file, text, &e))?;
    deserializer.end().map_err(|e| FormatError::syntax(file, "end of file", e.to_string()))?;
    if json.format != PATH_FORMAT {
        return Err(wrong(&json.format));
    }
    if json.poses.is_empty() || json.poses.len() > MAX_POSES {
        return Err(FormatError::invalid(file, "poses", format!("1 to {MAX_POSES}"), json.poses.len().to_string()));
    }
    let checker = Checker::new(file);
    let lens = json.camera.map(|LensJson { width, height, intrinsics }| {
        checker.pinhole("camera", [width, height], intrinsics)?;
        Ok(PathLens { width, height, intrinsics })
    });
    let key = |(i, json): (usize, KeyJson)| {
        Ok(PathKey {
            timestamp: checker.timestamp(&format!("poses[{i}].timestamp"), json.timestamp)?,
            world_from_camera: checker.pose(&format!("poses[{i}].world_from_camera"), &json.world_from_camera)?,
        })
    };
    let keys = json.poses.into_iter().enumerate().map(key).collect::<Result<_>>()?;
    Ok(CameraPath { lens: lens.transpose()?, keys })
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;

    fn good() -> Value {
        let pose = |x: f64| json!([[1, 0, 0, x], [0, 1, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]);
        json!({
            "format": PATH_FORMAT,
            "camera": {"width": 64, "height": 36, "intrinsics": {"fx": 50, "fy": 50, "cx": 32, "cy": 18}},
            "poses": [{"timestamp": 1.5e9, "world_from_camera": pose(1.0)}, {"timestamp": 1.5e9, "world_from_camera": pose(4.0)}],
        })
    }

    fn of(value: &Value) -> Result<CameraPath> {
        parse(Path::new("path.json"), value.to_string().as_bytes())
    }

    #[test]
    fn a_path_is_poses_and_perhaps_a_camera() {
        let path = of(&good()).unwrap();
        assert_eq!((path.keys.len(), path.lens.map(|lens| [lens.width, lens.height])), (2, Some([64, 36])));
        assert_eq!(path.keys[1].world_from_camera.translation().to_array(), [4.0, 2.0, 3.0]);
        let mut bare = good();
        bare.as_object_mut().unwrap().remove("camera");
        assert_eq!(of(&bare).unwrap().lens, None);
    }

    #[test]
    fn what_is_no_path_is_named_by_its_field() {
        let cases: [(&str, Value, &str); 12] = [
            ("/format", json!("lgs-path/2"), "format: expected `lgs-path/1`, found `lgs-path/2`"),
            ("/format", json!(1), "format (line 1): invalid type"),
            ("/poses", json!([]), "poses: expected 1 to 10000, found 0"),
            ("/poses/0/timestamp", json!(1e12), "poses[0].timestamp: expected finite seconds"),
            ("/poses/1/world_from_camera/0/0", json!(2.0), "poses[1].world_from_camera: expected a rigid 4x4 pose"),
            ("/poses/1/world_from_camera/0/3", json!(1e10), "poses[1].world_from_camera[0][3]: expected a translation"),
            ("/poses/1/world_from_camera/0", json!([1, 2]), "poses[1].world_from_camera[0] (line 1)"),
            ("/poses/0/time", json!(1), "poses[0].time (line 1): unknown field `time`"),
            ("/camera/width", json!(0), "camera.width: expected 1 to 16384 pixels, found 0"),
            ("/camera/height", json!(99999), "camera.height: expected 1 to 16384 pixels"),
            ("/camera/intrinsics/fx", json!(-1), "camera.intrinsics.fx: expected a focal length"),
            ("/camera/intrinsics", json!({}), "missing field `fx`"),
        ];
        for (pointer, value, expected) in cases {
            let mut bad = good();
            let (parent, key) = pointer.rsplit_once('/').unwrap();
            match bad.pointer_mut(parent).unwrap() {
                Value::Array(list) => list[key.parse::<usize>().unwrap()] = value,
                map => map[key] = value,
            }
            let message = of(&bad).unwrap_err().to_string();
            assert!(message.starts_with("path.json: ") && message.contains(expected), "{message}\nwant {expected}");
        }
        let text = good().to_string();
        for end in 0..text.len() {
            assert!(parse(Path::new("p"), &text.as_bytes()[..end]).is_err(), "{end}");
        }
        assert!(parse(Path::new("p"), format!("{text}{{}}").as_bytes()).unwrap_err().to_string().contains("trailing"));
    }
}
