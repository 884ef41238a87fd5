//! The street of a seed: where houses, trees, furniture and traffic stand.

use glam::{DVec3, Vec3};
use lgs_formats::casts::to_f32;
use lgs_formats::pose::Pose;

use super::{
    buildings,
    config::SceneConfig,
    furniture::Furniture,
    ground::Ground,
    material::Material,
    maths::rotation_z,
    object::{Object, Palette},
    primitive::{Part, Primitive},
    rng::Rng,
    road::Road,
    shapes::Shape,
    side_street::{HALF_WIDTH, SideStreet},
    streams,
    surface::colour,
    traffic,
    trees::Foliage,
};

/// Part of the street that is built up, along the middle line (metres).
const BUILT: [f64; 2] = [-80.0, 210.0];

/// Part of the street with trees and furniture (metres).
const FURNISHED: [f64; 2] = [-60.0, 170.0];

/// All that a street holds.
#[derive(Debug)]
pub(crate) struct Layout {
    pub(crate) ground: Ground,
    pub(crate) materials: Vec<Material>,
    /// What stands still, parked cars included.
    pub(crate) statics: Vec<Primitive>,
    /// Everything with a track; parked cars too.
    pub(crate) objects: Vec<Object>,
    pub(crate) ego: super::motion::EgoMotion,
}

/// A street while it is being built.
struct Builder<'a> {
    config: &'a SceneConfig,
    road: Road,
    palette: Palette,
    statics: Vec<Primitive>,
    crossings: Vec<f64>,
    side: Option<SideStreet>,
}

impl Layout {
    /// The street of a configuration that is valid.
    pub(crate) fn new(config: &SceneConfig) -> Self {
        let street = &config.street;
        let road = Road {
            curvature: street.curvature,
            lane_width: street.lane_width_m,
            num_lanes: street.num_lanes,
            parking_width: if street.parking { 2.2 } else { 0.0 },
            pavement_width: street.pavement_m,
            kerb_height: 0.13,
        };
        let mut rng = Rng::new(config.seed, streams::GROUND);
        let mut crossings = Vec::new();
        let mut s = rng.uniform(12.0, 45.0);
        while s < FURNISHED[1] {
            crossings.push(s);
            s += rng.uniform(45.0, 100.0);
        }
        let side = config.traffic.busy.as_ref().and_then(|busy| busy.side_street).map(|s| SideStreet { s });
        crossings.retain(|&s| side.is_none_or(|side| side.is_clear(s, 6.0)));
        let ground = Ground { side, ..ground(config, road, &crossings, &mut rng) };
        let mut builder = Builder { config, road, palette: Palette::default(), statics: Vec::new(), crossings, side };
        builder.houses();
        builder.backdrop();
        builder.trees();
        builder.furniture();
        let kept_free: Vec<f64> = builder.crossings.iter().copied().chain(side.map(|side| side.s)).collect();
        let traffic = traffic::Traffic::new(config, &road, &kept_free, &mut builder.palette);
        for (k, object) in (0_u32..).zip(&traffic.objects) {
            if !object.is_mobile() {
                let pose = object.course.at(&road, 0.0).pose;
                builder.statics.extend(object.model.parts.iter().map(|part| part.placed(&pose, Some(k))));
            }
        }
        let Builder { palette, statics, .. } = builder;
        Self { ground, materials: palette.0, statics, objects: traffic.objects, ego: traffic.ego }
    }
}

fn ground(config: &SceneConfig, road: Road, crossings: &[f64], rng: &mut Rng) -> Ground {
    let grey = rng.uniform32(0.30, 0.42);
    let stone = rng.uniform32(0.54, 0.68);
    let warmth = rng.uniform32(0.9, 1.0);
    let green = rng.uniform32(0.38, 0.5);
    Ground {
        road,
        texture_scale: to_f32(config.street.texture_scale),
        asphalt: colour(grey, grey, grey * rng.uniform32(0.98, 1.04)),
        paving: colour(stone, stone * (0.5 + 0.5 * warmth), stone * warmth),
        verge: colour(0.8 * green, green, 0.5 * green),
        slab: rng.pick(&[0.5, 0.6, 0.9]),
        crossings: crossings.iter().map(|&s| to_f32(s)).collect(),
        side: None,
        seed: rng.bits(),
    }
}

impl Builder<'_> {
    /// Stands `parts` at `(s, d)`, turned by `heading` from the street's direction.
    fn place(&mut self, parts: &[Part], s: f64, d: f64, heading: f64) {
        let height = if d.abs() > self.road.kerb_offset() { self.road.kerb_height } else { 0.0 };
        let frame = self.road.frame(s, d, height);
        let pose = Pose::new(frame.rotation() * rotation_z(heading), frame.translation());
        self.statics.extend(parts.iter().map(|part| part.placed(&pose, None)));
    }

    /// Heading that looks from a side (1 left, -1 right) at the street.
    fn inward(side: f64) -> f64 {
        -side * std::f64::consts::FRAC_PI_2
    }

    fn is_free(&self, s: f64) -> bool {
        self.crossings.iter().all(|&at| (s - at).abs() > 4.0) && self.is_clear(s, 1.5)
    }

    /// Whether something `reach` metres long on both sides of `s` keeps clear of a side street.
    fn is_clear(&self, s: f64, reach: f64) -> bool {
        self.side.is_none_or(|side| side.is_clear(s, reach))
    }

    /// As [`Self::place`], but nothing where a side street runs.
    fn place_beside(&mut self, parts: &[Part], s: f64, d: f64, heading: f64) {
        if self.is_clear(s, 1.2) {
            self.place(parts, s, d, heading);
        }
    }

    fn houses(&mut self) {
        let street = &self.config.street;
        let mut rng = Rng::new(self.config.seed, streams::HOUSES);
        let foliage = Foliage::new(&mut Rng::new(self.config.seed, streams::TREES));
        for side in [1.0, -1.0] {
            let line = side * self.road.building_offset();
            let mut s = BUILT[0] + rng.uniform(-6.0, 0.0);
            while s < BUILT[1] {
                let plot = rng.uniform(7.0, 17.0);
                let width = plot * (1.0 - self.road.curvature * line);
                let middle = s + 0.5 * plot;
                if !self.is_clear(middle, 0.5 * plot + 0.3) {
                    s += plot;
                    continue;
                }
                if rng.chance(street.open_plots) {
                    let hedge = foliage.hedge(&mut rng, &mut self.palette, width - 1.0);
                    self.place(&hedge, middle, line + side * 0.6, 0.0);
                    let tree = foliage.tree(&mut rng, &mut self.palette);
                    let back = rng.uniform(4.0, 8.0);
                    self.place(&tree, middle + rng.uniform(-2.0, 2.0), line + side * back, rng.uniform(0.0, 6.0));
                } else {
                    let house = buildings::house(street, width, &mut rng, &mut self.palette);
                    self.place(&house, middle, line + side * rng.uniform(0.0, 0.35), Self::inward(side));
                }
                s += plot;
            }
        }
        if rng.chance(0.6) {
            let mut d = -45.0;
            while d < 45.0 {
                let width = rng.uniform(9.0, 16.0);
                let house = buildings::house(street, width, &mut rng, &mut self.palette);
                self.place(&house, BUILT[1] + 8.0, d + 0.5 * width, std::f64::consts::PI);
                d += width;
            }
        }
    }

    /// Hills around, and tall houses behind the first row.
    fn backdrop(&mut self) {
        let mut rng = Rng::new(self.config.seed, streams::BACKDROP);
        let wood = self.palette.add(Material::Paint { colour: colour(0.30, 0.40, 0.24), grain: 0.8, frequency: 0.12 });
        for k in 0..16 {
            let bearing = f64::from(k) * std::f64::consts::TAU / 16.0 + rng.uniform(-0.15, 0.15);
            let radii = Vec3::new(rng.uniform32(60.0, 130.0), rng.uniform32(60.0, 120.0), rng.uniform32(12.0, 42.0));
            let hill = Part::new(Shape::Ellipsoid { radii }, DVec3::X * rng.uniform(380.0, 480.0), wood);
            let pose = Pose::new(rotation_z(bearing), DVec3::new(60.0, 0.0, -3.0));
            self.statics.push(hill.seeded(rng.bits()).placed(&pose, None));
        }
        let tall = super::config::StreetSpec { floors: [4, 9], ..self.config.street.clone() };
        for _ in 0..rng.between(4, 12) {
            let side = if rng.chance(0.5) { 1.0 } else { -1.0 };
            let house = buildings::house(&tall, rng.uniform(12.0, 22.0), &mut rng, &mut self.palette);
            self.place(&house, rng.uniform(-20.0, 200.0), side * rng.uniform(42.0, 95.0), Self::inward(side));
        }
    }

    fn trees(&mut self) {
        let mut rng = Rng::new(self.config.seed, streams::TREES);
        let foliage = Foliage::new(&mut rng);
        let spacing = self.config.street.tree_spacing_m;
        let d = self.road.kerb_offset() + 0.8;
        for side in [1.0, -1.0] {
            let mut s = FURNISHED[0] + rng.uniform(0.0, spacing);
            while s < FURNISHED[1] {
                if self.is_free(s) {
                    let tree = foliage.tree(&mut rng, &mut self.palette);
                    self.place(&tree, s, side * d, rng.uniform(0.0, 6.0));
                }
                s += spacing * rng.uniform(0.7, 1.4);
            }
        }
    }

    fn furniture(&mut self) {
        let mut rng = Rng::new(self.config.seed, streams::FURNITURE);
        let furniture = Furniture::new(&mut rng, &mut self.palette);
        let (kerb, wall) = (self.road.kerb_offset(), self.road.building_offset());
        let lamp = furniture.lamp_post(rng.uniform(5.0, 7.5));
        let gap = rng.uniform(20.0, 32.0);
        for side in [1.0, -1.0] {
            let facing = if side > 0.0 { 0.0 } else { std::f64::consts::PI };
            let mut s = FURNISHED[0] + if side > 0.0 { 0.0 } else { 0.5 * gap };
            while s < FURNISHED[1] {
                self.place_beside(&lamp, s, side * (kerb + 0.45), Self::inward(side));
                s += gap;
            }
            let mut s = FURNISHED[0] + rng.uniform(0.0, 20.0);
            while s < FURNISHED[1] {
                let parts = if rng.chance(0.25) {
                    furniture.board(&mut rng, &mut self.palette)
                } else {
                    furniture.sign(&mut rng, &mut self.palette)
                };
                self.place_beside(&parts, s, side * (kerb + rng.uniform(0.4, 0.7)), facing + rng.uniform(-0.15, 0.15));
                s += rng.uniform(14.0, 34.0);
            }
            let mut s = FURNISHED[0] + rng.uniform(0.0, 8.0);
            while s < FURNISHED[1] {
                let parts = furniture.small(&mut rng, &mut self.palette);
                let d = if rng.chance(0.6) { wall - 0.5 } else { kerb + 0.5 };
                self.place_beside(&parts, s, side * d, Self::inward(side));
                s += rng.uniform(5.0, 16.0);
            }
            for at in self.crossings.clone() {
                let light = furniture.traffic_light(&mut rng, &mut self.palette);
                self.place(&light, at + side * 3.2, side * (kerb + 0.5), facing);
            }
        }
        if let Some(side) = self.side {
            self.corners(&furniture, side, &mut rng);
        }
    }

    /// Poles at the corners of a side street and rows of bollards or posts beside them, behind which others pass.
    fn corners(&mut self, furniture: &Furniture, street: SideStreet, rng: &mut Rng) {
        let kerb = self.road.kerb_offset();
        for (side, before) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
            let corner = street.s + before * (HALF_WIDTH + 1.3);
            let parts = if rng.chance(0.5) {
                furniture.traffic_light(rng, &mut self.palette)
            } else {
                furniture.lamp_post(rng.uniform(4.0, 6.0))
            };
            self.place(&parts, corner, side * (kerb + 0.6), Self::inward(side));
            if rng.chance(0.4) {
                continue;
            }
            let post = furniture.post(if rng.chance(0.6) { 0.95 } else { rng.uniform(2.0, 3.0) });
            let gap = rng.uniform(1.4, 2.6);
            for k in 1..rng.between(4, 9) {
                self.place(&post, corner + before * gap * k as f64, side * (kerb + 0.35), 0.0);
            }
        }
    }
}
