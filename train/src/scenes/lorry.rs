//! Lorries with a semi-trailer.

use glam::{DVec3, Vec3};

use super::{
    material::Material,
    maths::narrow3,
    object::{Model, Palette},
    primitive::{MaterialId, Part},
    rng::Rng,
    shapes::{Shape, Taper},
    surface::colour,
    vehicles::{PAINTS, wheel},
};

const NONE: Taper = Taper { front: 0.0, rear: 0.0, sides: 0.0 };

/// A lorry with a trailer, 15.5 to 18.5 m long, as one rigid body.
pub(crate) fn lorry(rng: &mut Rng, palette: &mut Palette) -> Model {
    let size = DVec3::new(rng.uniform(15.5, 18.5), 2.5, rng.uniform(3.6, 4.0));
    let [paint, band] = [rng.pick(&PAINTS), rng.pick(&PAINTS)].map(|[r, g, b]| colour(r, g, b));
    let seed = rng.bits();
    let hold_paint = if rng.chance(0.5) { colour(0.85, 0.84, 0.82) } else { paint };
    let cargo = palette.add(Material::Cargo { paint: hold_paint, band });
    let (body, cabin) = (palette.add(Material::CarBody { paint }), palette.add(Material::CarCabin { paint }));
    let dark = palette.add(Material::Paint { colour: Vec3::splat(0.015), grain: 0.3, frequency: 3.0 });
    let block = |size: DVec3, taper, at: DVec3, material: MaterialId| {
        Part::new(Shape::tapered(narrow3(size), taper), at, material)
    };
    let cab_length = 2.2;
    let cab_x = 0.5 * (size.x - cab_length);
    let hold = DVec3::new(size.x - cab_length - 0.8, size.y, size.z - 1.15);
    let tail = -0.5 * size.x;
    let cab = |height: f64| DVec3::new(cab_length, 2.4, height);
    let mut parts = vec![
        block(hold, NONE, DVec3::new(tail + 0.5 * hold.x, 0.0, size.z - 0.5 * hold.z), cargo).seeded(seed),
        block(cab(1.3), NONE, DVec3::new(cab_x, 0.0, 1.05), body).seeded(seed ^ 1),
        block(cab(1.5), Taper { front: 0.25, rear: 0.0, sides: 0.06 }, DVec3::new(cab_x, 0.0, 2.45), cabin)
            .seeded(seed ^ 2),
        // The frames of tractor and trailer: light falls between and under them.
        block(DVec3::new(5.6, 1.1, 0.35), NONE, DVec3::new(0.5 * size.x - 3.1, 0.0, 0.8), dark),
        block(DVec3::new(hold.x - 0.6, 1.0, 0.3), NONE, DVec3::new(tail + 0.5 * hold.x, 0.0, 1.0), dark),
        // The guard at the trailer's end.
        block(DVec3::new(0.12, 2.3, 0.15), NONE, DVec3::new(tail + 0.15, 0.0, 0.5), dark),
    ];
    let rubber = palette.add(Material::Wheel);
    let front = 0.5 * size.x;
    for axle in [front - 1.4, front - 5.0, tail + 1.6, tail + 2.9, tail + 4.2] {
        parts.extend([-1.0, 1.0].map(|left| wheel(axle, left, size.y, 0.5, rubber)));
    }
    Model { category: "truck", size: size + DVec3::Y * 0.03, parts }
}
