//! A placed shape with its material: what rays meet. Parts are primitives before they are placed.

use glam::{DMat3, DVec3, Mat3, Vec2, Vec3};
use lgs_formats::pose::Pose;

use super::{
    maths::{narrow_mat, narrow3},
    shapes::{LocalHit, Ray, Shape, leaf_is_solid},
};

/// Index into the world's list of materials.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct MaterialId(pub(crate) u32);

/// A shape in the frame of the object that it belongs to.
#[derive(Clone, Debug)]
pub(crate) struct Part {
    pub(crate) shape: Shape,
    pub(crate) rotation: DMat3,
    pub(crate) position: DVec3,
    pub(crate) material: MaterialId,
    /// Seed of the texture.
    pub(crate) seed: u32,
    /// Share of the ambient light that reaches it.
    pub(crate) openness: f32,
}

impl Part {
    /// A part that stands upright at `position` in full ambient light.
    pub(crate) fn new(shape: Shape, position: DVec3, material: MaterialId) -> Self {
        Self { shape, rotation: DMat3::IDENTITY, position, material, seed: 0, openness: 1.0 }
    }

    /// The same part turned by `rotation` about its own centre.
    pub(crate) fn turned(mut self, rotation: DMat3) -> Self {
        self.rotation = rotation;
        self
    }

    /// The same part with another texture seed.
    pub(crate) fn seeded(mut self, seed: u32) -> Self {
        self.seed = seed;
        self
    }

    /// The same part, reached by less ambient light.
    pub(crate) fn shaded(mut self, openness: f32) -> Self {
        self.openness = openness;
        self
    }

    /// The part where its object stands.
    pub(crate) fn placed(&self, world_from_object: &Pose, object: Option<u32>) -> Primitive {
        Primitive {
            world_from_local: narrow_mat(world_from_object.rotation() * self.rotation),
            centre: narrow3(world_from_object.transform_point(self.position)),
            shape: self.shape.clone(),
            material: self.material,
            seed: self.seed,
            openness: self.openness,
            object,
        }
    }
}

/// A shape in the world.
#[derive(Clone, Debug)]
pub(crate) struct Primitive {
    pub(crate) world_from_local: Mat3,
    pub(crate) centre: Vec3,
    pub(crate) shape: Shape,
    pub(crate) material: MaterialId,
    pub(crate) seed: u32,
    pub(crate) openness: f32,
    /// The tracked object that it is part of.
    pub(crate) object: Option<u32>,
}

impl Primitive {
    /// A world point in the shape's frame.
    pub(crate) fn to_local(&self, point: Vec3) -> Vec3 {
        self.world_from_local.transpose() * (point - self.centre)
    }

    /// Where a world ray enters, in the shape's frame; distances are those of the world ray.
    pub(crate) fn intersect(&self, ray: &Ray, t_min: f32, t_max: f32) -> Option<LocalHit> {
        if let Shape::Leaf { radius, seed } = self.shape {
            return self.intersect_leaf(ray, radius, seed).filter(|hit| hit.t > t_min && hit.t < t_max);
        }
        let local_from_world = self.world_from_local.transpose();
        let local =
            Ray { origin: local_from_world * (ray.origin - self.centre), direction: local_from_world * ray.direction };
        self.shape.intersect(&local, t_min, t_max)
    }

    /// As the shape does, without turning the whole ray for the many that pass beside the disc.
    fn intersect_leaf(&self, ray: &Ray, radius: f32, seed: u32) -> Option<LocalHit> {
        let axis = self.world_from_local.z_axis;
        let slope = ray.direction.dot(axis);
        let t = (self.centre - ray.origin).dot(axis) / slope;
        let offset = ray.at(t) - self.centre;
        // Written so that a ray along the disc (t not finite) is turned away too.
        if offset.length_squared() < radius * radius {
            let place = Vec2::new(offset.dot(self.world_from_local.x_axis), offset.dot(self.world_from_local.y_axis));
            let normal = Vec3::new(0.0, 0.0, -slope.signum());
            return leaf_is_solid(place / radius, seed).then_some(LocalHit { t, normal, face: 0 });
        }
        None
    }

    /// Lower and upper corner of the axis-aligned bounds.
    pub(crate) fn bounds(&self) -> (Vec3, Vec3) {
        let reach = self.shape.reach(&self.world_from_local);
        (self.centre - reach, self.centre + reach)
    }
}
