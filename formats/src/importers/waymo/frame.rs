//! The first form: a message `Frame` a record. What no clip needs is passed over unread.
//!
//! # Source
//! waymo-research/waymo-open-dataset, `dataset.proto` and `label.proto`: the numbers of the fields.

use std::{fs::File, io::BufReader, ops::Range, path::Path};

use super::{
    snapshot::{
        CameraMount, Image, Inclinations, Label, Laser, LaserMount, Sensor, Shutter, Snapshot, direction, pose_of,
    },
    wire::{Field, Fields, Input, Value},
};
use crate::{
    error::{FormatError, Result},
    pose::Pose,
};

/// Most lists of a frame: cameras, `LiDARs`.
const MAX_SENSORS: usize = 64;
/// Most labels of a frame.
const MAX_LABELS: usize = 100_000;

type Place = Range<u64>;
type Bytes<'a> = Input<'a, BufReader<File>>;

/// A frame and the name of the drive that it is of.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct NamedFrame {
    pub(super) segment: String,
    pub(super) snapshot: Snapshot<Place>,
}

/// Reads the messages of one frame.
struct Reader<'a> {
    path: &'a Path,
    /// Of the record.
    index: usize,
    input: Bytes<'a>,
}

/// The frame of the record `index`, whose content is there.
///
/// # Errors
/// A message that contradicts itself or lacks what a frame needs.
pub(super) fn read(path: &Path, index: usize, content: &Place) -> Result<NamedFrame> {
    let file = File::open(path).map_err(|e| FormatError::io(path, "read", e))?;
    let input = Input::new(path, format!("record {index}"), BufReader::new(file));
    let mut reader = Reader { path, index, input };
    let mut segment = String::new();
    let (mut timestamp, mut pose) = (None, None);
    let mut snapshot = Snapshot {
        timestamp_micros: 0,
        world_from_vehicle: Pose::IDENTITY,
        cameras: Vec::new(),
        mounts: Vec::new(),
        images: Vec::new(),
        lasers: Vec::new(),
        labels: Some(Vec::new()),
    };
    reader.each(content.clone(), |reader, Field { number, value }| {
        match number {
            1 => {
                let context = reader.input.message(&value)?;
                segment = reader.context(context, &mut snapshot)?;
            }
            2 => timestamp = Some(reader.input.integer(&value)?),
            3 => pose = Some(reader.transform(&value, "pose")?),
            4 => {
                let image = reader.image(&value, snapshot.images.len())?;
                snapshot.images.extend(image);
            }
            5 => {
                let laser = reader.laser(&value)?;
                snapshot.lasers.extend(laser);
            }
            6 => {
                let label = reader.label(&value)?;
                snapshot.labels.get_or_insert_default().push(label);
            }
            _ => {}
        }
        let lists = [snapshot.images.len(), snapshot.lasers.len()].into_iter().max().unwrap_or(0);
        if lists > MAX_SENSORS || snapshot.labels.as_ref().is_some_and(|labels| labels.len() > MAX_LABELS) {
            let expected = format!("at most {MAX_SENSORS} images and LiDARs, {MAX_LABELS} labels");
            return Err(reader.error("lists", expected, "more"));
        }
        Ok(())
    })?;
    let missing = |field: &str| reader.error(field, "one", "none");
    snapshot.timestamp_micros = timestamp.ok_or_else(|| missing("timestamp_micros"))?;
    snapshot.world_from_vehicle = pose.ok_or_else(|| missing("pose"))?;
    Ok(NamedFrame { segment, snapshot })
}

impl Reader<'_> {
    fn error(&self, field: &str, expected: impl Into<String>, found: impl Into<String>) -> FormatError {
        FormatError::invalid(self.path, format!("record {}: {field}", self.index), expected, found)
    }

    /// Calls `act` with each field of a message.
    fn each(&mut self, message: Place, mut act: impl FnMut(&mut Self, Field) -> Result<()>) -> Result<()> {
        let mut fields = Fields::new(message);
        while let Some(field) = fields.next(&mut self.input)? {
            act(self, field)?;
        }
        Ok(())
    }

    fn transform(&mut self, value: &Value, name: &str) -> Result<Pose> {
        let (message, mut numbers) = (self.input.message(value)?, Vec::new());
        self.each(message, |reader, field| match field.number {
            1 => reader.input.doubles(&field.value, &mut numbers),
            _ => Ok(()),
        })?;
        pose_of(self.path, || format!("record {}: {name}", self.index), &numbers)
    }

    /// The name of the drive; adds what carries its sensors to `snapshot`.
    fn context(&mut self, message: Place, snapshot: &mut Snapshot<Place>) -> Result<String> {
        let mut name = String::new();
        self.each(message, |reader, Field { number, value }| {
            match number {
                1 => name = reader.input.text(&value)?,
                2 => snapshot.cameras.extend(reader.camera(&value)?),
                3 => snapshot.mounts.extend(reader.mount(&value)?),
                _ => {}
            }
            if snapshot.cameras.len().max(snapshot.mounts.len()) > MAX_SENSORS {
                return Err(reader.error("context", format!("at most {MAX_SENSORS} sensors"), "more"));
            }
            Ok(())
        })?;
        Ok(name)
    }

    /// The mount of a camera; `None` for one of no name.
    fn camera(&mut self, value: &Value) -> Result<Option<CameraMount>> {
        let message = self.input.message(value)?;
        let (mut number, mut intrinsic, mut pose, mut size, mut way) = (0, Vec::new(), None, [0; 2], 0);
        self.each(message, |reader, Field { number: field, value }| {
            match field {
                1 => number = reader.input.integer(&value)?,
                2 => reader.input.doubles(&value, &mut intrinsic)?,
                3 => pose = Some(reader.transform(&value, "camera_calibrations: extrinsic")?),
                4 => size[0] = reader.input.integer(&value)?,
                5 => size[1] = reader.input.integer(&value)?,
                6 => way = reader.input.integer(&value)?,
                _ => {}
            }
            Ok(())
        })?;
        let Some(sensor) = Sensor::camera(number) else { return Ok(None) };
        let at = |field: &str| format!("camera_calibrations: {sensor}: {field}");
        let found = format!("{} numbers", intrinsic.len());
        let [width, height] = size;
        let sides = [width, height].map(|side| u32::try_from(side).ok());
        let [Some(width), Some(height)] = sides else {
            return Err(self.error(&at("width, height"), "numbers of pixels", format!("{width}, {height}")));
        };
        Ok(Some(CameraMount {
            sensor,
            intrinsic: intrinsic.try_into().map_err(|_e| self.error(&at("intrinsic"), "9 numbers", found))?,
            vehicle_from_camera: pose.ok_or_else(|| self.error(&at("extrinsic"), "a pose", "none"))?,
            size: [width, height],
            direction: direction(way),
        }))
    }

    /// The mount of a `LiDAR`; `None` for one of no name.
    fn mount(&mut self, value: &Value) -> Result<Option<LaserMount>> {
        let message = self.input.message(value)?;
        let (mut number, mut beams, mut ends, mut pose) = (0, Vec::new(), [None; 2], None);
        self.each(message, |reader, Field { number: field, value }| {
            match field {
                1 => number = reader.input.integer(&value)?,
                2 => reader.input.doubles(&value, &mut beams)?,
                3 => ends[0] = Some(reader.input.double(&value)?),
                4 => ends[1] = Some(reader.input.double(&value)?),
                5 => pose = Some(reader.transform(&value, "laser_calibrations: extrinsic")?),
                _ => {}
            }
            Ok(())
        })?;
        let Some(sensor) = Sensor::laser(number) else { return Ok(None) };
        let at = |field: &str| format!("laser_calibrations: {sensor}: {field}");
        let inclinations = match ends {
            _ if !beams.is_empty() => Inclinations::Each(beams),
            [Some(low), Some(high)] => Inclinations::Between([low, high]),
            _ => return Err(self.error(&at("beam_inclinations"), "a list, or a minimum and a maximum", "neither")),
        };
        let vehicle_from_laser = pose.ok_or_else(|| self.error(&at("extrinsic"), "a pose", "none"))?;
        Ok(Some(LaserMount { sensor, vehicle_from_laser, inclinations }))
    }

    /// An image; `None` for one of no camera or without a file.
    fn image(&mut self, value: &Value, index: usize) -> Result<Option<Image<Place>>> {
        let message = self.input.message(value)?;
        let (mut number, mut file, mut pose, mut time, mut shutter) = (0, None, None, None, [None; 3]);
        self.each(message, |reader, Field { number: field, value }| {
            match field {
                1 => number = reader.input.integer(&value)?,
                2 => file = Some(reader.input.message(&value)?),
                3 => pose = Some(reader.transform(&value, &format!("images[{index}].pose"))?),
                5 => time = Some(reader.input.double(&value)?),
                6 => shutter[0] = Some(reader.input.double(&value)?),
                7 => shutter[1] = Some(reader.input.double(&value)?),
                8 => shutter[2] = Some(reader.input.double(&value)?),
                _ => {}
            }
            Ok(())
        })?;
        let (Some(sensor), Some(file)) = (Sensor::camera(number), file.filter(|file| !file.is_empty())) else {
            return Ok(None);
        };
        let missing = |field: &str| self.error(&format!("images[{index}].{field}"), "one", "none");
        let shutter = match shutter {
            [Some(exposure), Some(trigger), Some(done)] => Some(Shutter { exposure, trigger, done }),
            _ => None,
        };
        Ok(Some(Image {
            sensor,
            file,
            world_from_vehicle: pose.ok_or_else(|| missing("pose"))?,
            pose_timestamp: time.ok_or_else(|| missing("pose_timestamp"))?,
            shutter,
        }))
    }

    /// The range images of a `LiDAR`; `None` for one of no name or without any.
    fn laser(&mut self, value: &Value) -> Result<Option<Laser<Place>>> {
        let message = self.input.message(value)?;
        let (mut number, mut returns, mut poses) = (0, [None, None], None);
        self.each(message, |reader, Field { number: field, value }| {
            match field {
                1 => number = reader.input.integer(&value)?,
                2 | 3 => {
                    let image = reader.input.message(&value)?;
                    reader.each(image, |reader, Field { number: inner, value }| {
                        match inner {
                            2 => returns[usize::from(field == 3)] = Some(reader.input.message(&value)?),
                            4 if field == 2 => poses = Some(reader.input.message(&value)?),
                            _ => {}
                        }
                        Ok(())
                    })?;
                }
                _ => {}
            }
            Ok(())
        })?;
        let returns = returns.map(|image| image.filter(|image: &Place| !image.is_empty()));
        let poses = poses.filter(|poses| !poses.is_empty());
        let is_empty = returns == [None, None];
        Ok(Sensor::laser(number).filter(|_| !is_empty).map(|sensor| Laser { sensor, returns, poses }))
    }

    fn label(&mut self, value: &Value) -> Result<Label> {
        let message = self.input.message(value)?;
        let mut label = Label { id: String::new(), kind: 0, centre: [0.0; 3], size: [0.0; 3], heading: 0.0 };
        self.each(message, |reader, Field { number, value }| {
            match number {
                1 => {
                    let place = reader.input.message(&value)?;
                    reader.each(place, |reader, Field { number, value }| {
                        let into = match number {
                            1 => &mut label.centre[0],
                            2 => &mut label.centre[1],
                            3 => &mut label.centre[2],
                            4 => &mut label.size[1],
                            5 => &mut label.size[0],
                            6 => &mut label.size[2],
                            7 => &mut label.heading,
                            _ => return Ok(()),
                        };
                        *into = reader.input.double(&value)?;
                        Ok(())
                    })?;
                }
                3 => label.kind = reader.input.integer(&value)?,
                4 => label.id = reader.input.text(&value)?,
                _ => {}
            }
            Ok(())
        })?;
        Ok(label)
    }
}
