//! The files of a DGP scene as they are written: protocol buffers in JSON, where zeros may be left out.

use std::{collections::BTreeMap, fmt};

use serde::Deserialize;

#[derive(Debug, Deserialize)]
pub(super) struct SceneJson {
    #[serde(default)]
    pub(super) name: String,
    #[serde(default)]
    pub(super) log: String,
    pub(super) data: Vec<DatumJson>,
    pub(super) samples: Vec<SampleJson>,
    #[serde(default)]
    pub(super) ontologies: BTreeMap<String, String>,
}

#[derive(Debug, Deserialize)]
pub(super) struct SampleJson {
    pub(super) calibration_key: String,
    pub(super) datum_keys: Vec<String>,
}

#[derive(Debug, Deserialize)]
pub(super) struct DatumJson {
    pub(super) key: String,
    pub(super) id: IdJson,
    pub(super) datum: DatumValueJson,
}

#[derive(Debug, Deserialize)]
pub(super) struct IdJson {
    pub(super) name: String,
    pub(super) timestamp: String,
}

#[derive(Debug, Deserialize)]
pub(super) struct DatumValueJson {
    pub(super) image: Option<ImageJson>,
    pub(super) point_cloud: Option<PointCloudJson>,
}

#[derive(Debug, Deserialize)]
pub(super) struct ImageJson {
    pub(super) filename: String,
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) pose: PoseJson,
}

#[derive(Debug, Deserialize)]
pub(super) struct PointCloudJson {
    pub(super) filename: String,
    pub(super) point_format: Vec<String>,
    pub(super) pose: PoseJson,
    #[serde(default)]
    pub(super) annotations: BTreeMap<String, String>,
}

#[derive(Debug, Default, Deserialize)]
pub(super) struct PoseJson {
    #[serde(default)]
    pub(super) rotation: QuaternionJson,
    #[serde(default)]
    pub(super) translation: VectorJson,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct QuaternionJson {
    qw: f64,
    qx: f64,
    qy: f64,
    qz: f64,
}

impl QuaternionJson {
    pub(super) const fn wxyz(&self) -> [f64; 4] {
        [self.qw, self.qx, self.qy, self.qz]
    }
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct VectorJson {
    x: f64,
    y: f64,
    z: f64,
}

impl VectorJson {
    pub(super) const fn xyz(&self) -> [f64; 3] {
        [self.x, self.y, self.z]
    }
}

#[derive(Debug, Deserialize)]
pub(super) struct CalibrationJson {
    pub(super) names: Vec<String>,
    pub(super) intrinsics: Vec<IntrinsicsJson>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct IntrinsicsJson {
    pub(super) fx: f64,
    pub(super) fy: f64,
    pub(super) cx: f64,
    pub(super) cy: f64,
    pub(super) k1: f64,
    pub(super) k2: f64,
    pub(super) k3: f64,
    pub(super) p1: f64,
    pub(super) p2: f64,
    /// 1: a fisheye by `OpenCV`'s model of four coefficients; 0: a pinhole.
    fisheye: serde_json::Value,
    k4: f64,
    /// Parameters of other camera models, which must be zero; `fov` follows from the others.
    #[serde(flatten)]
    others: BTreeMap<String, serde_json::Value>,
}

impl IntrinsicsJson {
    /// The coefficients of a fisheye; `None`: it is a pinhole.
    pub(super) fn fisheye(&self) -> Option<[f64; 4]> {
        let is_one = self.fisheye.as_f64() == Some(1.0) || self.fisheye.as_bool() == Some(true);
        is_one.then_some([self.k1, self.k2, self.k3, self.k4])
    }

    /// The first parameter of another camera model that is not zero, and what is read.
    pub(super) fn unsupported(&self) -> Option<(&str, String, &'static str)> {
        const PINHOLE: &str = "0 (a pinhole with k1, k2, k3, p1, p2)";
        const FISHEYE: &str = "0 (a fisheye with k1, k2, k3, k4)";
        let known =
            |value: &serde_json::Value| value.is_null() || value.as_bool().is_some() || value.as_f64() == Some(0.0);
        let is_fisheye = self.fisheye().is_some();
        let read = if is_fisheye { FISHEYE } else { PINHOLE };
        if !is_fisheye && !known(&self.fisheye) {
            return Some(("fisheye", self.fisheye.to_string(), "0 (a pinhole) or 1 (a fisheye)"));
        }
        let unread: &[_] = if is_fisheye { &[("p1", self.p1), ("p2", self.p2)] } else { &[("k4", self.k4)] };
        if let Some((key, value)) = unread.iter().find(|(_, value)| *value != 0.0) {
            return Some((key, value.to_string(), read));
        }
        let used = |value: &serde_json::Value| value.as_f64() != Some(0.0);
        let other = self.others.iter().find(|(key, value)| *key != "fov" && used(value));
        other.map(|(key, value)| (key.as_str(), value.to_string(), read))
    }
}

#[derive(Debug, Deserialize)]
pub(super) struct OntologyJson {
    pub(super) items: Vec<ItemJson>,
}

#[derive(Debug, Deserialize)]
pub(super) struct ItemJson {
    #[serde(default)]
    pub(super) id: i64,
    pub(super) name: String,
}

#[derive(Debug, Deserialize)]
pub(super) struct AnnotationsJson {
    #[serde(default)]
    pub(super) annotations: Vec<AnnotationJson>,
}

#[derive(Debug, Deserialize)]
pub(super) struct AnnotationJson {
    #[serde(rename = "box")]
    pub(super) shape: BoxJson,
    #[serde(default)]
    pub(super) class_id: i64,
    #[serde(default)]
    pub(super) instance_id: Number,
}

/// A 64-bit number, which protocol buffers write as a text and Python as a number.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
pub(super) enum Number {
    Number(i64),
    Text(String),
}

impl Default for Number {
    fn default() -> Self {
        Self::Number(0)
    }
}

impl fmt::Display for Number {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(number) => number.fmt(f),
            Self::Text(text) => text.fmt(f),
        }
    }
}

#[derive(Debug, Deserialize)]
pub(super) struct BoxJson {
    pub(super) pose: PoseJson,
    pub(super) length: f64,
    pub(super) width: f64,
    pub(super) height: f64,
}
