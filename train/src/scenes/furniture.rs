//! Street furniture: lamps, signs, traffic lights, bins, bollards, benches. Fronts look along +x.

use glam::{DMat3, DVec3, Vec3};
use lgs_formats::casts::to_f32;

use super::{
    material::Material,
    maths::narrow3,
    object::Palette,
    primitive::{MaterialId, Part},
    rng::Rng,
    shapes::{Shape, Taper},
    sign_texture::SignFace,
    surface::colour,
};

/// Materials that all furniture of a street shares.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Furniture {
    metal: MaterialId,
    dark: MaterialId,
    wood: MaterialId,
    lamp: MaterialId,
}

/// A pole of `height` at a place on the ground.
fn pole(at: DVec3, height: f64, radius: f32, material: MaterialId) -> Part {
    let shape = Shape::Cylinder { radius, half_height: to_f32(0.5 * height) };
    Part::new(shape, at + DVec3::Z * (0.5 * height), material)
}

fn block(size: DVec3, at: DVec3, material: MaterialId) -> Part {
    Part::new(Shape::cuboid(narrow3(size)), at, material)
}

impl Furniture {
    /// The materials of one street.
    pub(crate) fn new(rng: &mut Rng, palette: &mut Palette) -> Self {
        let metals = [[0.52, 0.54, 0.55], [0.20, 0.28, 0.24], [0.16, 0.17, 0.19], [0.36, 0.37, 0.38]];
        let [r, g, b] = rng.pick(&metals);
        let mut paint = |colour, grain| palette.add(Material::Paint { colour, grain, frequency: 5.0 });
        Self {
            metal: paint(colour(r, g, b), 0.25),
            dark: paint(colour(0.13, 0.14, 0.15), 0.2),
            wood: paint(colour(0.52, 0.36, 0.22), 0.5),
            lamp: paint(colour(0.95, 0.94, 0.88), 0.05),
        }
    }

    /// A lamp post whose arm reaches along +x.
    pub(crate) fn lamp_post(&self, height: f64) -> Vec<Part> {
        let arm = 1.5;
        vec![
            pole(DVec3::ZERO, 0.9, 0.12, self.metal),
            pole(DVec3::ZERO, height, 0.075, self.metal),
            block(DVec3::new(arm, 0.07, 0.07), DVec3::new(0.5 * arm, 0.0, height - 0.05), self.metal),
            block(DVec3::new(0.7, 0.26, 0.12), DVec3::new(arm, 0.0, height - 0.08), self.dark),
            block(DVec3::new(0.5, 0.2, 0.04), DVec3::new(arm, 0.0, height - 0.16), self.lamp),
        ]
    }

    /// A round traffic sign.
    pub(crate) fn sign(&self, rng: &mut Rng, palette: &mut Palette) -> Vec<Part> {
        let height = rng.uniform(2.1, 2.6);
        let plate = |z: f64, face: SignFace, palette: &mut Palette| {
            let shape = Shape::Cylinder { radius: 0.33, half_height: 0.015 };
            // The top of the cylinder looks along +x, its x points down.
            let facing = DMat3::from_cols(-DVec3::Z, DVec3::Y, DVec3::X);
            let material = palette.add(Material::Sign(face));
            Part::new(shape, DVec3::new(0.06, 0.0, z), material).turned(facing)
        };
        let faces = [SignFace::Limit, SignFace::Direction, SignFace::NoEntry];
        let mut parts = vec![pole(DVec3::ZERO, height + 0.3, 0.035, self.metal)];
        parts.push(plate(height, rng.pick(&faces), palette));
        if rng.chance(0.35) {
            parts.push(plate(height - 0.72, rng.pick(&faces), palette));
        }
        parts
    }

    /// A board with writing on two poles.
    pub(crate) fn board(&self, rng: &mut Rng, palette: &mut Palette) -> Vec<Part> {
        let (wide, high) = (rng.uniform(1.3, 2.2), rng.uniform(0.6, 1.1));
        let material = palette.add(Material::Sign(SignFace::Board));
        let plate = block(DVec3::new(0.05, wide, high), DVec3::new(0.07, 0.0, 2.5 + 0.5 * high), material);
        vec![
            pole(DVec3::Y * (0.4 * wide), 2.5 + high, 0.04, self.metal),
            pole(DVec3::Y * (-0.4 * wide), 2.5 + high, 0.04, self.metal),
            plate.seeded(rng.bits()),
        ]
    }

    /// A traffic light.
    pub(crate) fn traffic_light(&self, rng: &mut Rng, palette: &mut Palette) -> Vec<Part> {
        let material = palette.add(Material::Sign(SignFace::Lights));
        vec![
            pole(DVec3::ZERO, 3.3, 0.06, self.dark),
            block(DVec3::new(0.24, 0.32, 0.95), DVec3::new(0.15, 0.0, 2.85), material).seeded(rng.bits()),
        ]
    }

    /// A bollard or a post of this height (metres).
    pub(crate) fn post(&self, height: f64) -> Vec<Part> {
        vec![pole(DVec3::ZERO, height, 0.06, self.metal)]
    }

    /// A bin, a bollard, a cabinet or a bench.
    pub(crate) fn small(&self, rng: &mut Rng, palette: &mut Palette) -> Vec<Part> {
        match rng.index(5) {
            0 => {
                let green =
                    palette.add(Material::Paint { colour: colour(0.14, 0.36, 0.25), grain: 0.3, frequency: 4.0 });
                let taper = Taper { front: 0.05, rear: 0.05, sides: 0.04 };
                let shape = Shape::tapered(Vec3::new(0.52, 0.48, 1.0), taper);
                vec![
                    Part::new(shape, DVec3::Z * 0.5, green),
                    block(DVec3::new(0.66, 0.6, 0.08), DVec3::Z * 1.04, self.dark),
                ]
            }
            1 => vec![pole(DVec3::ZERO, 0.95, 0.08, self.metal)],
            2 => {
                let grey =
                    palette.add(Material::Paint { colour: colour(0.62, 0.64, 0.6), grain: 0.35, frequency: 3.0 });
                vec![block(DVec3::new(0.4, 0.9, 1.2), DVec3::Z * 0.6, grey)]
            }
            3 => {
                let stripes = [colour(0.8, 0.12, 0.1), colour(0.88, 0.88, 0.86)];
                let material = palette.add(Material::Striped { colours: stripes, period: 0.3 });
                vec![
                    block(DVec3::new(0.08, 1.6, 0.35), DVec3::Z * 0.85, material),
                    block(DVec3::new(0.4, 0.1, 1.0), DVec3::new(0.0, 0.7, 0.5), self.dark),
                    block(DVec3::new(0.4, 0.1, 1.0), DVec3::new(0.0, -0.7, 0.5), self.dark),
                ]
            }
            _ => vec![
                block(DVec3::new(0.5, 1.7, 0.07), DVec3::Z * 0.45, self.wood),
                block(DVec3::new(0.07, 1.7, 0.4), DVec3::new(-0.25, 0.0, 0.75), self.wood),
                block(DVec3::new(0.45, 0.08, 0.42), DVec3::new(0.0, 0.7, 0.21), self.dark),
                block(DVec3::new(0.45, 0.08, 0.42), DVec3::new(0.0, -0.7, 0.21), self.dark),
            ],
        }
    }
}
