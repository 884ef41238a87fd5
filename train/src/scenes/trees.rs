//! Trees and hedges: trunks under clumps of leaves that rays half pass through.

use glam::{DMat3, DVec3, Vec3};
use lgs_formats::casts::to_f32;

use super::{
    material::Material,
    maths::{rotation_x, rotation_y, rotation_z},
    object::Palette,
    primitive::Part,
    rng::Rng,
    shapes::Shape,
    surface::colour,
};

/// The looks that the trees of a street share.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Foliage {
    colour: Vec3,
    bark: Vec3,
    /// Height of the crown's lower end and radii of the crown (metres).
    stem: f64,
    crown: DVec3,
    num_leaves: usize,
}

impl Foliage {
    /// The looks of one street's trees.
    pub(crate) fn new(rng: &mut Rng) -> Self {
        let greens =
            [[0.36, 0.50, 0.22], [0.30, 0.46, 0.26], [0.44, 0.54, 0.20], [0.56, 0.50, 0.20], [0.26, 0.42, 0.22]];
        let [r, g, b] = rng.pick(&greens);
        let grey = rng.uniform32(0.28, 0.46);
        let wide = rng.uniform(1.5, 2.6);
        Self {
            colour: colour(r, g, b),
            bark: colour(grey, 0.9 * grey, 0.8 * grey),
            stem: rng.uniform(2.0, 3.2),
            crown: DVec3::new(wide, wide, wide * rng.uniform(0.9, 1.5)),
            num_leaves: rng.between(260, 420),
        }
    }

    /// A tree whose foot is at the origin.
    pub(crate) fn tree(&self, rng: &mut Rng, palette: &mut Palette) -> Vec<Part> {
        let size = rng.uniform(0.8, 1.2);
        let (stem, crown) = (self.stem * rng.uniform(0.9, 1.15), self.crown * size);
        let centre = DVec3::Z * (stem + 0.8 * crown.z);
        let radius = rng.uniform(0.1, 0.18) * size;
        let bark = palette.add(Material::Bark { colour: self.bark });
        let tint = rng.uniform32(0.8, 1.25);
        let leaves = palette.add(Material::Leaves { colour: self.colour * tint });
        let trunk = Shape::Cylinder { radius: to_f32(radius), half_height: to_f32(0.5 * centre.z) };
        let mut parts = vec![Part::new(trunk, centre * 0.5, bark).seeded(rng.bits()).shaded(0.85)];
        for _ in 0..rng.between(3, 5) {
            let lean = rotation_z(rng.uniform(0.0, std::f64::consts::TAU)) * rotation_y(rng.uniform(0.35, 0.9));
            let length = rng.uniform(0.8, 1.2) * crown.x;
            let shape = Shape::Cylinder { radius: to_f32(0.4 * radius), half_height: to_f32(0.5 * length) };
            let at = DVec3::Z * (stem * rng.uniform(0.85, 1.2)) + lean.z_axis * (0.5 * length);
            parts.push(Part::new(shape, at, bark).turned(lean).seeded(rng.bits()).shaded(0.6));
        }
        // Boughs: leaves gather around a few centres, so that light falls through between them.
        let boughs: Vec<DVec3> = (0..rng.between(9, 14)).map(|_| in_ball(rng, 0.45) * crown).collect();
        for _ in 0..self.num_leaves {
            let bough = boughs[rng.index(boughs.len())];
            let offset = bough + in_ball(rng, 0.6) * (0.42 * crown);
            let share = (offset / crown).length();
            let size = rng.uniform(0.16, 0.36) * size * if share > 0.9 { 0.8 } else { 1.0 };
            let seed = rng.bits();
            let shape = Shape::Leaf { radius: to_f32(size), seed };
            let height = offset.z / crown.z;
            let openness = to_f32((0.45 + 0.35 * share + 0.2 * height).clamp(0.25, 1.0));
            parts.push(
                Part::new(shape, centre + offset, leaves).turned(any_rotation(rng)).seeded(seed).shaded(openness),
            );
        }
        parts
    }

    /// A hedge of the given length along x.
    pub(crate) fn hedge(&self, rng: &mut Rng, palette: &mut Palette, length: f64) -> Vec<Part> {
        let leaves = palette.add(Material::Leaves { colour: self.colour * 0.8 });
        let (height, depth) = (rng.uniform(0.7, 1.3), 0.35);
        let core = Vec3::new(to_f32(length - 0.2), to_f32(2.0 * depth - 0.3), to_f32(height - 0.15));
        let mut parts = vec![Part::new(Shape::cuboid(core), DVec3::Z * (0.5 * height), leaves).shaded(0.35)];
        let num = super::maths::count(length * 26.0);
        for _ in 0..num {
            let at = DVec3::new(
                rng.uniform(-0.5, 0.5) * length,
                rng.uniform(-depth, depth),
                0.1 + (height - 0.1) * rng.unit().sqrt(),
            );
            let seed = rng.bits();
            let openness = to_f32(0.5 + 0.5 * at.z / height);
            let shape = Shape::Leaf { radius: rng.uniform32(0.13, 0.22), seed };
            parts.push(Part::new(shape, at, leaves).turned(any_rotation(rng)).seeded(seed).shaded(openness));
        }
        parts
    }
}

/// A point of the unit ball outside a ball of radius `inner`, evenly spread.
fn in_ball(rng: &mut Rng, inner: f64) -> DVec3 {
    let direction = DVec3::new(rng.normal(), rng.normal(), rng.normal()).normalize_or(DVec3::Z);
    let low = inner * inner * inner;
    direction * libm::cbrt(rng.uniform(low, 1.0))
}

fn any_rotation(rng: &mut Rng) -> DMat3 {
    let turn = std::f64::consts::TAU;
    rotation_z(rng.uniform(0.0, turn)) * rotation_x(rng.uniform(0.0, turn)) * rotation_z(rng.uniform(0.0, turn))
}
