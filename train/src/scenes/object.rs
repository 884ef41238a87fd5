//! Tracked things: what they are made of, how they move, the box around them.

use glam::{DMat3, DVec3};
use lgs_formats::{clip::TrackedBox, pose::Pose};

use super::{
    course::Course, footprint::Footprint, material::Material, primitive::MaterialId, primitive::Part, road::Road,
};

/// Speed above which a thing counts as moving, m/s.
pub(crate) const MOVING_SPEED: f64 = 1.0;

/// The materials of a scene while it is being built.
#[derive(Debug, Default)]
pub(crate) struct Palette(pub(crate) Vec<Material>);

impl Palette {
    /// The place of `material` in the list.
    pub(crate) fn add(&mut self, material: Material) -> MaterialId {
        let id = u32::try_from(self.0.len()).unwrap_or(u32::MAX);
        self.0.push(material);
        MaterialId(id)
    }
}

/// A thing as a class of its own: parts in its frame (x forward, z up, origin on the ground in the middle).
#[derive(Clone, Debug)]
pub(crate) struct Model {
    pub(crate) category: &'static str,
    /// Length, width, height of the box around all parts (metres).
    pub(crate) size: DVec3,
    pub(crate) parts: Vec<Part>,
}

/// A thing with a track.
#[derive(Clone, Debug)]
pub(crate) struct Object {
    pub(crate) track: String,
    pub(crate) model: Model,
    pub(crate) course: Course,
}

impl Object {
    /// Whether it ever changes its place.
    pub(crate) fn is_mobile(&self) -> bool {
        self.course.is_mobile()
    }

    /// Whether it counts as moving at a time (seconds).
    pub(crate) fn is_moving(&self, time: f64) -> bool {
        self.course.speed(time) > MOVING_SPEED
    }

    /// The ground that it takes up at a time (seconds).
    pub(crate) fn footprint(&self, road: &Road, time: f64) -> Footprint {
        Footprint::of(&self.course.at(road, time), self.model.size.x, self.model.size.y)
    }

    /// The box around it at a time (seconds), in the scene's world.
    pub(crate) fn tracked_box(&self, road: &Road, time: f64) -> TrackedBox {
        let middle = Pose::new(DMat3::IDENTITY, DVec3::Z * (0.5 * self.model.size.z));
        TrackedBox {
            track: self.track.clone(),
            category: self.model.category.to_owned(),
            size: self.model.size.to_array(),
            world_from_box: self.course.at(road, time).pose * middle,
        }
    }
}
