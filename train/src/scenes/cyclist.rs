//! People on bicycles.

use glam::{DVec3, Vec3};
use lgs_formats::casts::to_f32;

use super::{
    material::Material,
    maths::{rotation_x, rotation_y},
    object::{Model, Palette},
    primitive::{MaterialId, Part},
    rng::Rng,
    shapes::Shape,
    surface::colour,
};

/// Radius of the wheels (metres).
const WHEEL: f64 = 0.34;
/// Distance of each axle from the middle (metres).
const AXLE: f64 = 0.52;

/// A person who rides a bicycle.
pub(crate) fn cyclist(rng: &mut Rng, palette: &mut Palette) -> Model {
    let cloth = |rng: &mut Rng| Material::Paint {
        colour: colour(rng.uniform32(0.1, 0.85), rng.uniform32(0.1, 0.7), rng.uniform32(0.1, 0.7)),
        grain: 0.35,
        frequency: 7.0,
    };
    let (coat, trousers) = (palette.add(cloth(rng)), palette.add(cloth(rng)));
    let skin = rng.uniform32(0.35, 0.85);
    let paint =
        |palette: &mut Palette, colour: Vec3| palette.add(Material::Paint { colour, grain: 0.1, frequency: 9.0 });
    let skin = paint(palette, colour(skin, 0.78 * skin, 0.64 * skin));
    let frame = paint(palette, colour(rng.uniform32(0.05, 0.7), rng.uniform32(0.05, 0.4), rng.uniform32(0.05, 0.5)));
    let rubber = paint(palette, Vec3::splat(0.02));
    let seat = rng.uniform(0.92, 1.02);
    let mut parts = Vec::new();
    for end in [-1.0, 1.0] {
        let shape = Shape::Cylinder { radius: to_f32(WHEEL), half_height: 0.02 };
        let at = DVec3::new(end * AXLE, 0.0, WHEEL);
        parts.push(Part::new(shape, at, rubber).turned(rotation_x(std::f64::consts::FRAC_PI_2)));
    }
    // Crossbar, down tube, handlebar.
    parts.push(rod(DVec3::new(-0.15, 0.0, seat - 0.15), DVec3::new(0.42, 0.0, seat - 0.1), 0.025, frame));
    parts.push(rod(DVec3::new(0.0, 0.0, 0.3), DVec3::new(0.42, 0.0, seat - 0.12), 0.025, frame));
    let bar = Shape::Cylinder { radius: 0.02, half_height: 0.27 };
    parts
        .push(Part::new(bar, DVec3::new(0.4, 0.0, seat + 0.02), frame).turned(rotation_x(std::f64::consts::FRAC_PI_2)));
    // Legs to pedals that are half a turn apart, arms to the handlebar.
    let pedal = rng.uniform(-0.16, 0.16);
    for left in [-1.0, 1.0] {
        let knee = DVec3::new(0.22, 0.1 * left, 0.68 + 0.5 * left * pedal);
        let foot = DVec3::new(0.05, 0.1 * left, 0.3 + left * pedal);
        parts.push(rod(DVec3::new(-0.15, 0.1 * left, seat), knee, 0.075, trousers));
        parts.push(rod(knee, foot, 0.06, trousers));
        let hand = DVec3::new(0.38, 0.24 * left, seat + 0.05);
        parts.push(rod(DVec3::new(0.08, 0.2 * left, seat + 0.47), hand, 0.05, coat));
    }
    let trunk = Shape::Ellipsoid { radii: Vec3::new(0.15, 0.2, 0.36) };
    parts.push(Part::new(trunk, DVec3::new(-0.03, 0.0, seat + 0.27), coat).turned(rotation_y(0.4)));
    let head = Shape::Ellipsoid { radii: Vec3::new(0.105, 0.09, 0.13) };
    parts.push(Part::new(head, DVec3::new(0.14, 0.0, seat + 0.7), skin));
    let seed = rng.bits();
    let parts = parts.into_iter().map(|part| part.seeded(seed)).collect();
    Model { category: "cyclist", size: DVec3::new(1.75, 0.62, seat + 0.84), parts }
}

/// A round rod from one point to another of the same y.
fn rod(from: DVec3, to: DVec3, radius: f32, material: MaterialId) -> Part {
    let along = to - from;
    let lean = libm::atan2(along.x, along.z);
    let shape = Shape::Cylinder { radius, half_height: to_f32(0.5 * along.length()) };
    Part::new(shape, (from + to) * 0.5, material).turned(rotation_y(lean))
}
