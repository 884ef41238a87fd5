//! Cars, vans, trucks and people, composed of a few shapes.

use glam::{DVec3, Vec3};
use lgs_formats::casts::to_f32;

use super::{
    car_texture::WHEELBASE,
    material::Material,
    maths::{narrow3, rotation_x, rotation_y},
    object::{Model, Palette},
    primitive::{MaterialId, Part},
    rng::Rng,
    shapes::{Shape, Taper},
    surface::colour,
};

/// Paints of cars as they look on a screen.
pub(crate) const PAINTS: [[f32; 3]; 10] = [
    [0.88, 0.88, 0.87],
    [0.70, 0.71, 0.73],
    [0.45, 0.46, 0.48],
    [0.16, 0.17, 0.19],
    [0.70, 0.13, 0.12],
    [0.14, 0.26, 0.50],
    [0.22, 0.40, 0.56],
    [0.20, 0.36, 0.27],
    [0.78, 0.66, 0.42],
    [0.80, 0.46, 0.16],
];

/// Proportions of a car: everything in metres.
struct Proportions {
    category: &'static str,
    size: DVec3,
    /// Height of the bonnet.
    bonnet: f64,
    /// Rear and front end of the upper part at its bottom, as shares of the length.
    cabin: [f64; 2],
    taper: Taper,
    wheel: f64,
}

/// A passenger car or van with paint and proportions of its own.
pub(crate) fn car(rng: &mut Rng, palette: &mut Palette) -> Model {
    let stretch = rng.uniform(0.94, 1.06);
    let size = |l: f64, w: f64, h: f64| DVec3::new(l * stretch, w, h * (0.5 + 0.5 * stretch));
    let taper = |front, rear, sides| Taper { front, rear, sides };
    let p = match rng.index(10) {
        0..4 => Proportions {
            category: "car",
            size: size(4.5, 1.8, 1.46),
            bonnet: 0.86,
            cabin: [-0.41, 0.19],
            taper: taper(0.62, 0.5, 0.2),
            wheel: 0.32,
        },
        4..7 => Proportions {
            category: "car",
            size: size(4.0, 1.76, 1.5),
            bonnet: 0.9,
            cabin: [-0.485, 0.22],
            taper: taper(0.6, 0.22, 0.17),
            wheel: 0.31,
        },
        7..9 => Proportions {
            category: "car",
            size: size(4.6, 1.9, 1.72),
            bonnet: 1.05,
            cabin: [-0.485, 0.2],
            taper: taper(0.5, 0.2, 0.15),
            wheel: 0.36,
        },
        _ => Proportions {
            category: "van",
            size: size(5.0, 1.95, 2.05),
            bonnet: 1.15,
            cabin: [-0.49, 0.36],
            taper: taper(0.75, 0.06, 0.12),
            wheel: 0.34,
        },
    };
    assemble(&p, rng, palette)
}

fn assemble(p: &Proportions, rng: &mut Rng, palette: &mut Palette) -> Model {
    let [r, g, b] = rng.pick(&PAINTS);
    let paint = colour(r, g, b);
    let seed = rng.bits();
    let body = palette.add(Material::CarBody { paint });
    let cabin = palette.add(Material::CarCabin { paint });
    let (length, width, height) = (p.size.x, p.size.y, p.size.z);
    let ground = 0.24;
    let lower = DVec3::new(length, width, p.bonnet - ground);
    let overlap = 0.05;
    let upper = DVec3::new((p.cabin[1] - p.cabin[0]) * length, width - 0.06, height - p.bonnet + overlap);
    let lower_taper = Taper { front: 0.16, rear: 0.1, sides: 0.05 };
    let mut parts = vec![
        Part::new(Shape::tapered(narrow3(lower), lower_taper), DVec3::Z * (ground + 0.5 * lower.z), body).seeded(seed),
        Part::new(
            Shape::tapered(narrow3(upper), p.taper),
            DVec3::new(0.5 * (p.cabin[0] + p.cabin[1]) * length, 0.0, height - 0.5 * upper.z),
            cabin,
        )
        .seeded(seed ^ 1),
    ];
    parts.extend(wheels(length, width, p.wheel, palette));
    Model { category: p.category, size: p.size + DVec3::Y * 0.03, parts }
}

/// Four wheels under a vehicle.
fn wheels(length: f64, width: f64, radius: f64, palette: &mut Palette) -> Vec<Part> {
    let material = palette.add(Material::Wheel);
    let axle = 0.5 * f64::from(WHEELBASE) * length;
    let mut parts = Vec::new();
    for front in [-1.0, 1.0] {
        for left in [-1.0, 1.0] {
            parts.push(wheel(front * axle, left, width, radius, material));
        }
    }
    parts
}

/// A wheel at `x` along a vehicle of this width, on its left (1) or right (-1) side.
pub(crate) fn wheel(x: f64, left: f64, width: f64, radius: f64, material: MaterialId) -> Part {
    let at = DVec3::new(x, left * (0.5 * width - 0.09), radius);
    let shape = Shape::Cylinder { radius: to_f32(radius), half_height: 0.105 };
    // The cylinder's top looks outward.
    Part::new(shape, at, material).turned(rotation_x(-left * std::f64::consts::FRAC_PI_2))
}

/// A truck with a closed box.
pub(crate) fn truck(rng: &mut Rng, palette: &mut Palette) -> Model {
    let size = DVec3::new(rng.uniform(6.6, 8.4), 2.4, rng.uniform(2.9, 3.4));
    let [r, g, b] = rng.pick(&PAINTS);
    let paint = colour(r, g, b);
    let [br, bg, bb] = rng.pick(&PAINTS);
    let seed = rng.bits();
    let cab_length = 1.9;
    let cargo = palette.add(Material::Cargo { paint: colour(0.85, 0.84, 0.82), band: colour(br, bg, bb) });
    let (body, cabin) = (palette.add(Material::CarBody { paint }), palette.add(Material::CarCabin { paint }));
    let dark = palette.add(Material::Paint { colour: Vec3::splat(0.015), grain: 0.3, frequency: 3.0 });
    let hold = DVec3::new(size.x - cab_length - 0.15, size.y, size.z - 0.95);
    let none = Taper { front: 0.0, rear: 0.0, sides: 0.0 };
    let cab_x = 0.5 * size.x - 0.5 * cab_length;
    let block = |size: DVec3, taper, at, material| Part::new(Shape::tapered(narrow3(size), taper), at, material);
    let mut parts = vec![
        block(hold, none, DVec3::new(-0.5 * (size.x - hold.x), 0.0, size.z - 0.5 * hold.z), cargo).seeded(seed),
        block(DVec3::new(cab_length, 2.3, 0.9), none, DVec3::new(cab_x, 0.0, 0.85), body).seeded(seed ^ 1),
        block(
            DVec3::new(cab_length, 2.3, 1.15),
            Taper { front: 0.3, rear: 0.0, sides: 0.1 },
            DVec3::new(cab_x, 0.0, 1.85),
            cabin,
        )
        .seeded(seed ^ 2),
        block(DVec3::new(size.x - 0.4, 1.2, 0.5), none, DVec3::new(0.0, 0.0, 0.75), dark),
    ];
    parts.extend(wheels(size.x, size.y, 0.46, palette));
    Model { category: "truck", size: size + DVec3::Y * 0.03, parts }
}

/// A walking or standing person.
pub(crate) fn person(rng: &mut Rng, palette: &mut Palette) -> Model {
    let height = rng.uniform(1.58, 1.9);
    let cloth = |rng: &mut Rng| {
        let base = [rng.uniform32(0.1, 0.75), rng.uniform32(0.1, 0.6), rng.uniform32(0.1, 0.7)];
        Material::Paint { colour: colour(base[0], base[1], base[2]), grain: 0.35, frequency: 7.0 }
    };
    let (coat, trousers) = (palette.add(cloth(rng)), palette.add(cloth(rng)));
    let skin = rng.uniform32(0.35, 0.85);
    let skin =
        palette.add(Material::Paint { colour: colour(skin, 0.78 * skin, 0.64 * skin), grain: 0.1, frequency: 9.0 });
    let hip = 0.48 * height;
    let limb = |at: DVec3, length: f64, swing: f64, radius: f32, material: MaterialId| {
        let shape = Shape::Cylinder { radius, half_height: to_f32(0.5 * length) };
        Part::new(shape, at, material).turned(rotation_y(swing))
    };
    let swing = rng.uniform(0.15, 0.4);
    let reach = 0.5 * hip * swing;
    let mut parts = vec![
        limb(DVec3::new(reach, 0.09, 0.5 * hip), hip - 0.04, -swing, 0.075, trousers),
        limb(DVec3::new(-reach, -0.09, 0.5 * hip), hip - 0.04, swing, 0.075, trousers),
        limb(DVec3::new(-0.08, 0.22, 0.66 * height), 0.33 * height, 0.7 * swing, 0.05, coat),
        limb(DVec3::new(0.08, -0.22, 0.66 * height), 0.33 * height, -0.7 * swing, 0.05, coat),
    ];
    let blob = |radii: Vec3, z: f64, material| Part::new(Shape::Ellipsoid { radii }, DVec3::Z * z, material);
    parts.push(blob(Vec3::new(0.15, 0.2, to_f32(0.21 * height)), 0.66 * height, coat));
    parts.push(blob(Vec3::new(0.105, 0.09, 0.13), height - 0.13, skin));
    let seed = rng.bits();
    let parts = parts.into_iter().map(|part| part.seeded(seed)).collect();
    Model { category: "pedestrian", size: DVec3::new(0.8, 0.6, height), parts }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenes::{cyclist::cyclist, lorry::lorry, maths::narrow_mat};

    /// Whether every part's bounds lie in the model's box, with `slack` metres to spare.
    fn fits_its_box(model: &Model, slack: f64) -> bool {
        model.parts.iter().all(|part| {
            let reach = part.shape.reach(&narrow_mat(part.rotation)).as_dvec3();
            let over = part.position.abs() + reach - 0.5 * model.size;
            over.x <= slack
                && over.y <= slack
                && part.position.z - reach.z >= -slack
                && part.position.z + reach.z <= model.size.z + slack
        })
    }

    #[test]
    fn models_fit_their_boxes() {
        for seed in 0..40 {
            let (mut rng, mut palette) = (Rng::new(seed, 0), Palette::default());
            for make in [car, truck, person, lorry, cyclist] {
                let model = make(&mut rng, &mut palette);
                assert!(fits_its_box(&model, 0.02), "seed {seed}: {} of {}", model.category, model.size);
            }
        }
    }

    #[test]
    fn wheels_show_their_rims_outward() {
        for part in wheels(4.0, 1.8, 0.3, &mut Palette::default()) {
            let outward = part.rotation * DVec3::Z;
            assert!(outward.y * part.position.y > 0.0);
            assert!((part.rotation.determinant() - 1.0).abs() < 1e-12);
        }
    }
}
