//! The tables of a nuScenes release, row by row: those of a full release do not fit in memory.

use std::{fmt, fs::File, io::BufReader, marker::PhantomData, path::Path};

use serde::{
    Deserialize, Deserializer,
    de::{DeserializeOwned, DeserializeSeed, SeqAccess, Visitor},
};

use crate::{
    error::{FormatError, Result},
    read::{MAX_DATA_BYTES, file_size},
};

#[derive(Debug, Deserialize)]
pub(super) struct Scene {
    pub(super) token: String,
    pub(super) name: String,
}

#[derive(Debug, Deserialize)]
pub(super) struct Sample {
    pub(super) token: String,
    pub(super) scene_token: String,
    /// Microseconds since 1970.
    pub(super) timestamp: i64,
}

#[derive(Debug, Deserialize)]
pub(super) struct SampleData {
    pub(super) token: String,
    pub(super) sample_token: String,
    pub(super) ego_pose_token: String,
    pub(super) calibrated_sensor_token: String,
    pub(super) filename: String,
    pub(super) timestamp: i64,
    pub(super) is_key_frame: bool,
    /// 0 for what is no image.
    #[serde(default)]
    pub(super) width: u32,
    #[serde(default)]
    pub(super) height: u32,
}

#[derive(Debug, Deserialize)]
pub(super) struct EgoPose {
    pub(super) token: String,
    /// (w, x, y, z).
    pub(super) rotation: [f64; 4],
    pub(super) translation: [f64; 3],
}

#[derive(Debug, Deserialize)]
pub(super) struct CalibratedSensor {
    pub(super) token: String,
    pub(super) sensor_token: String,
    pub(super) rotation: [f64; 4],
    pub(super) translation: [f64; 3],
    /// Rows, none for what is no camera.
    #[serde(default)]
    camera_intrinsic: Vec<Vec<f64>>,
}

impl CalibratedSensor {
    /// The rows of a pinhole without skew.
    pub(super) fn pinhole(&self) -> Option<[[f64; 3]; 3]> {
        let [a, b, c] = self.camera_intrinsic.as_slice() else { return None };
        let rows: [[f64; 3]; 3] =
            [a.as_slice().try_into().ok()?, b.as_slice().try_into().ok()?, c.as_slice().try_into().ok()?];
        let plain = rows[0][1] == 0.0 && rows[1][0] == 0.0 && rows[2] == [0.0, 0.0, 1.0];
        plain.then_some(rows)
    }
}

#[derive(Debug, Deserialize)]
pub(super) struct Sensor {
    pub(super) token: String,
    pub(super) channel: String,
    pub(super) modality: String,
}

#[derive(Debug, Deserialize)]
pub(super) struct Annotation {
    pub(super) token: String,
    pub(super) sample_token: String,
    pub(super) instance_token: String,
    pub(super) rotation: [f64; 4],
    pub(super) translation: [f64; 3],
    /// Width, length, height.
    pub(super) size: [f64; 3],
}

#[derive(Debug, Deserialize)]
pub(super) struct Instance {
    pub(super) token: String,
    pub(super) category_token: String,
}

#[derive(Debug, Deserialize)]
pub(super) struct Category {
    pub(super) token: String,
    pub(super) name: String,
}

/// The rows of a table for which `keep` holds.
///
/// # Errors
/// A file that is missing or no list of such rows, by the row's number.
pub(super) fn read_table<T: DeserializeOwned>(file: &Path, keep: impl FnMut(&T) -> bool) -> Result<Vec<T>> {
    file_size(file, MAX_DATA_BYTES)?;
    let reader = BufReader::new(File::open(file).map_err(|e| FormatError::io(file, "read", e))?);
    let mut json = serde_json::Deserializer::from_reader(reader);
    let mut row = 0;
    let rows = Rows { keep, row: &mut row, kind: PhantomData };
    let rows = rows.deserialize(&mut json).and_then(|rows| json.end().map(|()| rows));
    rows.map_err(|e| FormatError::syntax(file, format!("row {row}"), e.to_string()))
}

struct Rows<'a, T, K> {
    keep: K,
    /// The row that is being read, for errors.
    row: &'a mut usize,
    kind: PhantomData<T>,
}

impl<'de, T: Deserialize<'de>, K: FnMut(&T) -> bool> DeserializeSeed<'de> for Rows<'_, T, K> {
    type Value = Vec<T>;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> std::result::Result<Self::Value, D::Error> {
        deserializer.deserialize_seq(self)
    }
}

impl<'de, T: Deserialize<'de>, K: FnMut(&T) -> bool> Visitor<'de> for Rows<'_, T, K> {
    type Value = Vec<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a list of rows")
    }

    fn visit_seq<A: SeqAccess<'de>>(mut self, mut list: A) -> std::result::Result<Self::Value, A::Error> {
        let mut rows = Vec::new();
        while let Some(row) = list.next_element()? {
            if (self.keep)(&row) {
                rows.push(row);
            }
            *self.row += 1;
        }
        Ok(rows)
    }
}
