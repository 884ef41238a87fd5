//! A street at a moment: what a ray meets, how it moves, what it looks like.

use glam::{DVec3, Mat3, Vec2, Vec3};

use super::{
    bvh::Bvh,
    config::SceneConfig,
    ground::{Ground, Zone},
    layout::Layout,
    material::Material,
    maths::{mix, narrow3, smoothstep},
    motion::{EgoMotion, Movement},
    object::Object,
    primitive::Primitive,
    rng::Rng,
    shapes::{Ray, Shape},
    sky::Light,
    streams,
    surface::{Surface, Texel},
};

/// How far a shadow reaches (metres).
const SHADOW_REACH: f32 = 250.0;

/// Distance by which shadow rays leave their surface (metres).
const SHADOW_BIAS: f32 = 0.01;

/// A street with all that is on it.
#[derive(Debug)]
pub(crate) struct World {
    pub(crate) ground: Ground,
    pub(crate) light: Light,
    pub(crate) objects: Vec<Object>,
    pub(crate) ego: EgoMotion,
    materials: Vec<Material>,
    statics: Bvh,
}

/// What a ray meets first.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hit {
    /// In multiples of the ray's direction.
    pub(crate) t: f32,
    /// Unit length, in the world.
    pub(crate) normal: Vec3,
    pub(crate) face: u8,
    pub(crate) target: Target,
}

/// What was hit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Target {
    /// The ground.
    Ground(Zone),
    /// A primitive that stands still, by its place in the tree.
    Static(usize),
    /// A primitive that moves, by its place in the tree.
    Mover(usize),
}

/// The world at one time.
#[derive(Debug)]
pub(crate) struct Moment<'a> {
    pub(crate) world: &'a World,
    pub(crate) time: f64,
    /// Of every object.
    pub(crate) movements: Vec<Movement>,
    movers: Bvh,
    contacts: Vec<Contact>,
}

/// The rectangle over which an object keeps ambient light from the ground.
#[derive(Clone, Copy, Debug)]
struct Contact {
    centre: Vec2,
    forward: Vec2,
    half: Vec2,
}

impl World {
    /// The street of a configuration that is valid.
    pub(crate) fn new(config: &SceneConfig) -> Self {
        let layout = Layout::new(config);
        Self {
            ground: layout.ground,
            light: Light::new(&config.light, Rng::new(config.seed, streams::LIGHT).bits()),
            objects: layout.objects,
            ego: layout.ego,
            materials: layout.materials,
            statics: Bvh::new(layout.statics),
        }
    }

    /// The world at `time` seconds after the first sweep.
    pub(crate) fn at(&self, time: f64) -> Moment<'_> {
        let movements: Vec<Movement> =
            self.objects.iter().map(|object| object.course.at(&self.ground.road, time)).collect();
        let mut primitives = Vec::new();
        for (k, (object, movement)) in (0_u32..).zip(self.objects.iter().zip(&movements)) {
            if object.is_mobile() {
                primitives.extend(object.model.parts.iter().map(|part| part.placed(&movement.pose, Some(k))));
            }
        }
        let contacts = self.objects.iter().zip(&movements).map(|(object, movement)| Contact {
            centre: narrow3(movement.pose.translation()).truncate(),
            forward: narrow3(movement.pose.rotation().x_axis).truncate(),
            half: narrow3(object.model.size * 0.5).truncate(),
        });
        Moment { world: self, time, contacts: contacts.collect(), movers: Bvh::new(primitives), movements }
    }
}

impl Moment<'_> {
    /// What `ray` meets first before `t_max`.
    pub(crate) fn cast(&self, ray: &Ray, t_max: f32) -> Option<Hit> {
        let mut best = self.world.ground.intersect(ray, 0.0, t_max).map(|hit| Hit {
            t: hit.t,
            normal: hit.normal,
            face: 0,
            target: Target::Ground(hit.zone),
        });
        for (tree, target) in
            [(&self.world.statics, Target::Static as fn(usize) -> Target), (&self.movers, Target::Mover)]
        {
            let limit = best.map_or(t_max, |hit| hit.t);
            if let Some(hit) = tree.first_hit(ray, 0.0, limit) {
                let normal = tree.primitives()[hit.index].world_from_local * hit.local.normal;
                best = Some(Hit { t: hit.local.t, normal, face: hit.local.face, target: target(hit.index) });
            }
        }
        best
    }

    /// The primitive that was hit; `None` for the ground.
    pub(crate) fn primitive(&self, target: Target) -> Option<&Primitive> {
        match target {
            Target::Ground(_) => None,
            Target::Static(index) => self.world.statics.primitives().get(index),
            Target::Mover(index) => self.movers.primitives().get(index),
        }
    }

    /// The object that was hit.
    pub(crate) fn object(&self, target: Target) -> Option<u32> {
        self.primitive(target).and_then(|primitive| primitive.object)
    }

    /// Velocity of the surface at a world point, m/s.
    pub(crate) fn velocity(&self, target: Target, point: Vec3) -> DVec3 {
        let Target::Mover(_) = target else { return DVec3::ZERO };
        self.object(target).map_or(DVec3::ZERO, |k| self.movements[k as usize].velocity_at(point.as_dvec3()))
    }

    /// Whether the surface belongs to an object that counts as moving.
    pub(crate) fn is_moving(&self, target: Target) -> bool {
        self.object(target).is_some_and(|k| self.world.objects[k as usize].is_moving(self.time))
    }

    /// 1 where the sun reaches a point of a surface, else 0.
    pub(crate) fn lit(&self, hit: &Hit, point: Vec3) -> f32 {
        let sun = self.world.light.sun;
        let leaf = self.is_leaf(hit.target);
        if !leaf && hit.normal.dot(sun) <= 0.0 {
            return 0.0;
        }
        let bias = if leaf { sun * (6.0 * SHADOW_BIAS) } else { hit.normal * SHADOW_BIAS };
        let ray = Ray { origin: point + bias, direction: sun };
        let blocked =
            self.world.statics.occluded(&ray, 0.0, SHADOW_REACH) || self.movers.occluded(&ray, 0.0, SHADOW_REACH);
        if blocked { 0.0 } else { 1.0 }
    }

    fn is_leaf(&self, target: Target) -> bool {
        self.primitive(target).is_some_and(|primitive| matches!(primitive.shape, Shape::Leaf { .. }))
    }

    /// What the surface does with light at a world point; `footprint` is the width of a pixel there (metres).
    pub(crate) fn texel(&self, hit: &Hit, point: Vec3, footprint: f32) -> Texel {
        match (hit.target, self.primitive(hit.target)) {
            (Target::Ground(zone), _) => self.world.ground.texel(point, zone, footprint),
            (_, Some(primitive)) => {
                let surface = Surface {
                    local: primitive.to_local(point),
                    face: hit.face,
                    half: primitive.shape.reach(&Mat3::IDENTITY),
                    footprint,
                    seed: primitive.seed,
                };
                let texel = self.world.materials[primitive.material.0 as usize].texel(&surface);
                Texel { openness: texel.openness * primitive.openness, ..texel }
            }
            (_, None) => Texel::opaque(Vec3::ZERO),
        }
    }

    /// Share of the ambient light that objects leave to a point on the ground.
    pub(crate) fn openness_beside_objects(&self, point: Vec3) -> f32 {
        let mut open = 1.0;
        for contact in &self.contacts {
            let offset = point.truncate() - contact.centre;
            let reach = contact.half.x + 1.0;
            if offset.length_squared() > reach * reach {
                continue;
            }
            let along = offset.dot(contact.forward);
            let across = offset.perp_dot(contact.forward);
            let outside = (Vec2::new(along, across).abs() - contact.half).max(Vec2::ZERO).length();
            open *= mix(0.35, 1.0, smoothstep(-0.25, 0.65, outside));
        }
        open
    }

    /// Radiance that leaves a surface towards the viewer, before haze.
    pub(crate) fn radiance(&self, hit: &Hit, texel: &Texel, ground_openness: f32, lit: f32) -> Vec3 {
        let light = &self.world.light;
        let openness = texel.openness * ground_openness;
        if self.is_leaf(hit.target) {
            light.through_leaves(texel.albedo, hit.normal, openness, lit)
        } else {
            light.reflected(texel.albedo, hit.normal, openness, lit)
        }
    }
}
