//! Houses. The front of a house looks along +x; its origin is on the ground in the middle of the front.

use glam::{DVec3, Vec3};

use super::{
    config::StreetSpec,
    facade::{Facade, Masonry},
    material::Material,
    maths::narrow3,
    object::Palette,
    primitive::Part,
    rng::Rng,
    shapes::{Shape, Taper},
    surface::colour,
};

/// Wall colours as they look on a screen.
const WALLS: [[f32; 3]; 12] = [
    [0.62, 0.36, 0.28],
    [0.55, 0.31, 0.25],
    [0.70, 0.48, 0.36],
    [0.80, 0.74, 0.62],
    [0.86, 0.82, 0.74],
    [0.74, 0.66, 0.52],
    [0.66, 0.68, 0.66],
    [0.56, 0.55, 0.53],
    [0.78, 0.62, 0.46],
    [0.62, 0.66, 0.72],
    [0.74, 0.56, 0.50],
    [0.84, 0.78, 0.56],
];

/// Doors and shop fronts as they look on a screen.
const ACCENTS: [[f32; 3]; 7] = [
    [0.12, 0.25, 0.38],
    [0.45, 0.10, 0.10],
    [0.12, 0.32, 0.22],
    [0.30, 0.20, 0.14],
    [0.16, 0.17, 0.19],
    [0.60, 0.42, 0.12],
    [0.40, 0.16, 0.34],
];

/// A house of the given width (along y); its depth runs to -x.
pub(crate) fn house(street: &StreetSpec, width: f64, rng: &mut Rng, palette: &mut Palette) -> Vec<Part> {
    let facade = facade(street, rng);
    let num_floors = rng.between(street.floors[0], street.floors[1]);
    let height = f64::from(facade.ground_height + facade.floor_height * num_floors as f32) + 0.9;
    let depth = rng.uniform(9.0, 13.0);
    let seed = rng.bits();
    let (trim, accent) = (facade.trim, facade.accent);
    let (bay, ground, floor) =
        (f64::from(facade.bay_width), f64::from(facade.ground_height), f64::from(facade.floor_height));
    let shop = facade.shop;
    let walls = palette.add(Material::Facade(Box::new(facade)));
    let stone = palette.add(Material::Paint { colour: trim * 0.8, grain: 0.2, frequency: 3.0 });
    let back = |x: f64| DVec3::new(x - 0.5 * depth, 0.0, 0.0);
    let block = |size: DVec3, at, material| Part::new(Shape::cuboid(narrow3(size)), at, material).seeded(seed);
    let mut parts = vec![
        block(DVec3::new(depth, width, height), back(0.0) + DVec3::Z * (0.5 * height), walls),
        block(DVec3::new(depth + 0.5, width, 0.22), back(0.25) + DVec3::Z * (height - 0.11), stone),
    ];
    if rng.chance(0.6) {
        let rise = rng.uniform(1.8, 3.2);
        let [r, g, b] = rng.pick(&[[0.50, 0.28, 0.22], [0.36, 0.35, 0.37], [0.42, 0.30, 0.26]]);
        let tiles = palette.add(Material::Tiles { colour: colour(r, g, b) });
        let taper = Taper { front: 3.2, rear: 3.2, sides: if rng.chance(0.5) { 0.05 } else { 1.4 } };
        let size = narrow3(DVec3::new(depth + 0.3, width, rise));
        parts.push(
            Part::new(Shape::tapered(size, taper), back(0.1) + DVec3::Z * (height + 0.5 * rise), tiles).seeded(seed),
        );
        let chimney = DVec3::new(-0.35 * depth, rng.uniform(-0.3, 0.3) * width, height + rise);
        parts.push(block(DVec3::new(0.7, 0.9, 2.0), chimney, walls));
    }
    if shop && rng.chance(0.6) {
        let stripes = Material::Striped { colours: [accent, Vec3::splat(0.75)], period: 0.35 };
        let material = palette.add(stripes);
        let size = Vec3::new(1.1, narrow3(DVec3::new(width * 0.7, 0.0, 0.0)).x, 0.5);
        let taper = Taper { front: 1.0, rear: 0.0, sides: 0.1 };
        parts.push(Part::new(Shape::tapered(size, taper), DVec3::new(0.55, 0.0, ground - 0.75), material));
    }
    if num_floors > 0 && rng.chance(0.4) {
        balconies(&mut parts, rng, palette, &Balconies { width, bay, ground, floor, num_floors });
    }
    parts
}

/// Where balconies may hang.
struct Balconies {
    width: f64,
    bay: f64,
    ground: f64,
    floor: f64,
    num_floors: usize,
}

fn balconies(parts: &mut Vec<Part>, rng: &mut Rng, palette: &mut Palette, place: &Balconies) {
    let slab = palette.add(Material::Paint { colour: colour(0.66, 0.65, 0.62), grain: 0.2, frequency: 3.0 });
    let rails = [colour(0.16, 0.17, 0.18), colour(0.44, 0.45, 0.46)];
    let rail = palette.add(Material::Striped { colours: rails, period: 0.12 });
    let num_bays = (place.width / place.bay).round().max(1.0);
    let bay = place.width / num_bays;
    let column = rng.between(0, super::maths::count(num_bays) - 1) as f64;
    let y = (column + 0.5) * bay - 0.5 * place.width;
    for k in 0..place.num_floors {
        let z = place.ground + k as f64 * place.floor;
        let wide = (0.9 * bay).min(place.width);
        let block = |size: DVec3, at, material| Part::new(Shape::cuboid(narrow3(size)), at, material);
        parts.push(block(DVec3::new(1.0, wide, 0.16), DVec3::new(0.5, y, z), slab));
        parts.push(block(DVec3::new(0.06, wide, 0.95), DVec3::new(0.95, y, z + 0.55), rail));
        for side in [-0.5, 0.5] {
            parts.push(block(DVec3::new(0.95, 0.05, 0.95), DVec3::new(0.48, y + side * wide, z + 0.55), rail));
        }
    }
}

fn facade(street: &StreetSpec, rng: &mut Rng) -> Facade {
    let [r, g, b] = rng.pick(&WALLS);
    let [ar, ag, ab] = rng.pick(&ACCENTS);
    let scale = super::maths::to_f32(street.texture_scale);
    let masonry = match rng.index(6) {
        0..3 => {
            let length = rng.uniform32(0.34, 0.6) * scale;
            Masonry::Bricks { length, course: length * rng.uniform32(0.36, 0.5), joint: 0.03 * scale }
        }
        3..5 => Masonry::Plaster,
        _ => Masonry::Panels { height: rng.uniform32(0.6, 1.2) * scale },
    };
    let light = rng.uniform32(0.72, 0.9);
    let trim = if rng.chance(0.8) { colour(light, 0.98 * light, 0.94 * light) } else { colour(0.3, 0.3, 0.32) };
    Facade {
        masonry,
        wall: colour(r, g, b) * rng.uniform32(0.85, 1.1),
        trim,
        accent: colour(ar, ag, ab),
        ground_height: rng.uniform32(3.3, 4.2),
        floor_height: rng.uniform32(2.8, 3.4),
        bay_width: rng.uniform32(1.9, 3.2),
        window: (rng.uniform32(0.42, 0.62), rng.uniform32(0.45, 0.62)),
        shop: rng.chance(0.45),
    }
}
