//! DGP scenes (DDAD): `scene_*.json`, `calibration/`, `ontology/`, `point_cloud/`, `rgb/`, `bounding_box_3d/`.
//!
//! # Source
//! TRI-ML/dgp, `dgp/proto` (scene, sample, geometry, annotations). A datum's pose is that of the sensor in the world at
//! its own time; boxes are in the sensor's frame. Principal points count from the centre of the first pixel (`OpenCV`'s
//! convention, by which its `camera.py` projects), so that half a pixel is added.

mod scene;

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::Arc,
};

use glam::DMat3;
use scene::{AnnotationsJson, CalibrationJson, DatumJson, OntologyJson, PoseJson, SceneJson};

use super::{
    Selection, Source, folder_name,
    npz::read_npz,
    values::{At, entries, inside, read_json},
};
use crate::{
    camera::{Camera, Distortion, Fisheye, Intrinsics},
    clip::{CameraRecord, Frame, LidarRecord, TrackedBox},
    clip_dir::Decode,
    error::{FormatError, Result},
    pose::Pose,
    sweep::Sweep,
};

/// Keys of 3D boxes in the tables of annotations: the number and the name of the same constant.
const BOXES_3D: [&str; 2] = ["1", "BOUNDING_BOX_3D"];
/// 2100-01-01, microseconds since 1970: DDAD's later moments count ticks of 1e-7 s where the format counts 1e-6 s.
const FIRST_TICK_MOMENT: i64 = 4_102_444_800_000_000;

/// Whether a folder holds the description of one scene.
pub(super) fn is_of(folder: &Path) -> bool {
    scene_file(folder).is_ok() && folder.join("calibration").is_dir()
}

fn scene_file(folder: &Path) -> Result<PathBuf> {
    let names: Vec<String> = entries(folder, &[".json"])?.into_iter().filter(|n| n.starts_with("scene_")).collect();
    match names.as_slice() {
        [one] => Ok(folder.join(one)),
        other => Err(FormatError::invalid(folder, "scene", "one file `scene_*.json`", format!("{}", other.len()))),
    }
}

/// Whether a folder holds some of a scene.
pub(super) fn resembles(folder: &Path) -> bool {
    let of_scene = |names: Vec<String>| names.iter().any(|name| name.starts_with("scene_"));
    entries(folder, &[".json"]).is_ok_and(of_scene)
        || ["point_cloud", "rgb", "calibration"].iter().filter(|name| folder.join(name).is_dir()).count() > 1
}

/// The frames of a scene's folder.
pub(super) fn read(folder: &Path, selection: &Selection) -> Result<Source> {
    let file = scene_file(folder)?;
    let scene: SceneJson = read_json(&file)?;
    let data: BTreeMap<&str, &DatumJson> = scene.data.iter().map(|datum| (datum.key.as_str(), datum)).collect();
    let mut reader = Reader {
        folder,
        file: &file,
        scene: &scene,
        data,
        selection,
        categories: Reader::categories(folder, &file, &scene)?,
        calibrations: BTreeMap::new(),
        fields: BTreeMap::new(),
    };
    let frames = (0..scene.samples.len()).map(|index| reader.frame(index)).collect();
    let decoder = Arc::new(Decoder { fields: reader.fields });
    let images = scene.data.iter().filter(|datum| datum.datum.image.is_some());
    Ok(Source {
        root: folder.to_owned(),
        name: folder_name(folder),
        source: format!("DGP scene {}", if scene.name.is_empty() { &scene.log } else { &scene.name }),
        licence: "terms of the data set (DDAD: CC BY-NC-SA 4.0)".to_owned(),
        frames,
        cameras: images.map(|datum| datum.id.name.clone()).collect(),
        lidars: Vec::new(),
        decoder,
    })
}

struct Reader<'a> {
    folder: &'a Path,
    file: &'a Path,
    scene: &'a SceneJson,
    data: BTreeMap<&'a str, &'a DatumJson>,
    selection: &'a Selection,
    /// None where the ontology was not fetched: classes are then called by their numbers.
    categories: BTreeMap<i64, String>,
    calibrations: BTreeMap<&'a str, CalibrationJson>,
    /// Names of the values of each sweep file's rows.
    fields: BTreeMap<PathBuf, Vec<String>>,
}

impl<'a> Reader<'a> {
    fn categories(folder: &Path, file: &Path, scene: &SceneJson) -> Result<BTreeMap<i64, String>> {
        let Some(key) = BOXES_3D.iter().find_map(|key| scene.ontologies.get(*key)) else { return Ok(BTreeMap::new()) };
        let path = inside(At { file, field: "ontologies" }, &format!("ontology/{key}.json"))?;
        let path = folder.join(path);
        if !path.exists() {
            return Ok(BTreeMap::new());
        }
        let ontology: OntologyJson = read_json(&path)?;
        Ok(ontology.items.into_iter().map(|item| (item.id, item.name)).collect())
    }

    fn error<T>(&self, field: &str, expected: &str, found: impl Into<String>) -> Result<T> {
        Err(FormatError::invalid(self.file, field, expected, found))
    }

    fn frame(&mut self, index: usize) -> Result<Frame> {
        let at = format!("samples[{index}]");
        let sample = &self.scene.samples[index];
        let mut lidar = None;
        let mut cameras = Vec::new();
        let mut boxes = None;
        for key in &sample.datum_keys {
            let Some(&datum) = self.data.get(key.as_str()) else {
                return self.error(&format!("{at}.datum_keys"), "keys of `data`", format!("`{key}`"));
            };
            if datum.datum.image.is_some() {
                if !self.selection.camera(&datum.id.name) {
                    continue;
                }
                cameras.push(self.camera(&at, &sample.calibration_key, datum)?);
            } else if datum.datum.point_cloud.is_some() {
                if lidar.is_some() {
                    return self.error(&at, "one point cloud", format!("a second, `{}`", datum.id.name));
                }
                let record = self.lidar(&at, datum)?;
                boxes = self.boxes(&at, datum, &record.world_from_lidar)?;
                lidar = Some(record);
            }
        }
        match lidar {
            Some(lidar) => Ok(Frame { lidar, cameras, boxes }),
            None => self.error(&at, "one point cloud", "none"),
        }
    }

    fn lidar(&mut self, at: &str, datum: &DatumJson) -> Result<LidarRecord> {
        let at = format!("{at}: {}", datum.id.name);
        let Some(cloud) = &datum.datum.point_cloud else { return self.error(&at, "a point cloud", "none") };
        let file = inside(At { file: self.file, field: &at }, &cloud.filename)?;
        self.fields.insert(file.clone(), cloud.point_format.clone());
        Ok(LidarRecord::new(file, self.time(&at, datum)?, self.pose(&at, &cloud.pose)?))
    }

    fn camera(&mut self, at: &str, calibration_key: &'a str, datum: &DatumJson) -> Result<CameraRecord> {
        let name = &datum.id.name;
        let at = format!("{at}: {name}");
        let Some(image) = &datum.datum.image else { return self.error(&at, "an image", "none") };
        let place = inside(At { file: self.file, field: &at }, &format!("calibration/{calibration_key}.json"))?;
        let place = self.folder.join(place);
        if !self.calibrations.contains_key(calibration_key) {
            self.calibrations.insert(calibration_key, read_json(&place)?);
        }
        let calibration = &self.calibrations[calibration_key];
        let index = calibration.names.iter().position(|found| found == name);
        let Some((index, lens)) = index.and_then(|i| calibration.intrinsics.get(i).map(|lens| (i, lens))) else {
            let found = calibration.names.join(", ");
            return Err(FormatError::invalid(&place, "names", format!("`{name}` with intrinsics"), found));
        };
        if let Some((key, value, expected)) = lens.unsupported() {
            let field = format!("intrinsics[{index}].{key}");
            return Err(FormatError::invalid(&place, field, expected, value));
        }
        let intrinsics = Intrinsics { fx: lens.fx, fy: lens.fy, cx: lens.cx + 0.5, cy: lens.cy + 0.5 };
        let world_from_camera = self.pose(&at, &image.pose)?;
        let bent = [lens.k1, lens.k2, lens.p1, lens.p2, lens.k3];
        let fisheye = lens.fisheye().map(|coefficients| {
            Distortion::Fisheye(Fisheye {
                coefficients,
                width: image.width,
                height: image.height,
                intrinsics,
                world_from_fisheye: world_from_camera,
                fisheye_from_pinhole: DMat3::IDENTITY,
            })
        });
        let distortion = fisheye.or_else(|| bent.iter().any(|&k| k != 0.0).then_some(Distortion::BrownConrady(bent)));
        let camera = Camera {
            name: name.clone(),
            timestamp: self.time(&at, datum)?,
            width: image.width,
            height: image.height,
            intrinsics,
            distortion,
            readout: None,
            world_from_camera,
        };
        Ok(CameraRecord {
            file: inside(At { file: self.file, field: &at }, &image.filename)?,
            mask: None,
            depth: None,
            camera,
        })
    }

    /// The boxes of a point cloud, `None` when it names none or their file was not fetched.
    fn boxes(&self, at: &str, datum: &DatumJson, world_from_lidar: &Pose) -> Result<Option<Vec<TrackedBox>>> {
        let at = format!("{at}: {}: annotations", datum.id.name);
        let annotations = datum.datum.point_cloud.as_ref().map(|cloud| &cloud.annotations);
        let Some(path) = annotations.and_then(|found| BOXES_3D.iter().find_map(|key| found.get(*key))) else {
            return Ok(None);
        };
        let file = self.folder.join(inside(At { file: self.file, field: &at }, path)?);
        if !file.exists() {
            return Ok(None);
        }
        let json: AnnotationsJson = read_json(&file)?;
        let tracked = |(i, item): (usize, scene::AnnotationJson)| {
            let at = At { file: &file, field: &format!("annotations[{i}].box.pose") };
            let pose = at.pose(item.shape.pose.rotation.wxyz(), item.shape.pose.translation.xyz())?;
            let category = self.categories.get(&item.class_id);
            Ok(TrackedBox {
                track: item.instance_id.to_string(),
                category: category.cloned().unwrap_or_else(|| format!("class {}", item.class_id)),
                size: [item.shape.length, item.shape.width, item.shape.height],
                world_from_box: *world_from_lidar * pose,
            })
        };
        json.annotations.into_iter().enumerate().map(tracked).collect::<Result<_>>().map(Some)
    }

    fn pose(&self, at: &str, json: &PoseJson) -> Result<Pose> {
        At { file: self.file, field: &format!("{at}: pose") }.pose(json.rotation.wxyz(), json.translation.xyz())
    }

    /// Seconds since 1970.
    #[expect(clippy::cast_precision_loss, reason = "a microsecond of this century is exact within 2^-22 s")]
    fn time(&self, at: &str, datum: &DatumJson) -> Result<f64> {
        let at = At { file: self.file, field: &format!("{at}: timestamp") };
        let count = at.micros(&datum.id.timestamp, 'T', "Z")?;
        Ok(if count >= FIRST_TICK_MOMENT { count as f64 / 1e7 } else { count as f64 / 1e6 })
    }
}

/// Sweeps in `.npz` files: an array `data` whose columns the scene names.
#[derive(Debug)]
struct Decoder {
    fields: BTreeMap<PathBuf, Vec<String>>,
}

impl Decode for Decoder {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "metres and intensities of a sensor, kept as f32 by the format"
    )]
    fn decode(&self, path: &Path, record: &LidarRecord) -> Result<Sweep> {
        let array = read_npz(path, "data")?;
        let fields = self.fields.get(&record.file).map(Vec::as_slice).unwrap_or_default();
        let width = match *array.shape {
            [_, width] if width > 0 && width == fields.len() => width,
            _ => {
                let expected = format!("rows of {}", fields.join(", "));
                return Err(FormatError::invalid(path, "data", expected, format!("shape {:?}", array.shape)));
            }
        };
        let column = |name: &str| fields.iter().position(|field| field.eq_ignore_ascii_case(name));
        let [Some(x), Some(y), Some(z)] = ["x", "y", "z"].map(column) else {
            return Err(FormatError::invalid(path, "point_format", "X, Y and Z", fields.join(", ")));
        };
        let intensity = column("intensity");
        let rows = array.values.chunks_exact(width).map(|row| {
            let brightness = intensity.map_or(0.0, |i| row[i]);
            [row[x], row[y], row[z], brightness].map(|value| value as f32)
        });
        Sweep::of_rows(path, rows)
    }
}
