//! What surfaces look like: albedo from the place on a primitive.

use glam::Vec3;

use super::{
    car_texture,
    facade::Facade,
    maths::{hash, unit},
    sign_texture::{self, SignFace},
    surface::{Surface, Texel},
    texture::{octaves, stripes},
};

/// A kind of surface.
#[derive(Clone, Debug)]
pub(crate) enum Material {
    /// One colour with noise: `grain` is its contrast, `frequency` its features per metre.
    Paint { colour: Vec3, grain: f32, frequency: f32 },
    /// A wall with windows and doors.
    Facade(Box<Facade>),
    /// Rows of tiles.
    Tiles { colour: Vec3 },
    /// Two colours in turn, for awnings and barriers.
    Striped { colours: [Vec3; 2], period: f32 },
    /// Lower part of a car, with doors, lights, wheel arches and number plates.
    CarBody { paint: Vec3 },
    /// Upper part of a car: windows, pillars, roof.
    CarCabin { paint: Vec3 },
    /// The closed box of a van or truck.
    Cargo { paint: Vec3, band: Vec3 },
    /// A wheel whose axle is the cylinder's z.
    Wheel,
    /// A clump of leaves.
    Leaves { colour: Vec3 },
    /// A trunk.
    Bark { colour: Vec3 },
    /// A traffic sign; its front is the face +x.
    Sign(SignFace),
}

impl Material {
    /// What the material does with light at a place.
    pub(crate) fn texel(&self, at: &Surface) -> Texel {
        match self {
            Self::Paint { colour, grain, frequency } => Texel::opaque(grained(*colour, *grain, *frequency, at)),
            Self::Facade(facade) => facade.texel(at),
            Self::Tiles { colour } => tiles(*colour, at),
            Self::Striped { colours, period } => {
                let share = stripes(at.on_face().u, 2.0 * period, *period, at.footprint);
                Texel::opaque(colours[0].lerp(colours[1], share))
            }
            Self::CarBody { paint } => car_texture::body(*paint, at),
            Self::CarCabin { paint } => car_texture::cabin(*paint, at),
            Self::Cargo { paint, band } => car_texture::cargo(*paint, *band, at),
            Self::Wheel => car_texture::wheel(at),
            Self::Leaves { colour } => leaves(*colour, at),
            Self::Bark { colour } => {
                let p = at.local;
                let ridges = octaves(p.x + p.y * 1.7, 0.3 * p.z, 14.0, 3, at.footprint, at.seed);
                Texel::opaque(*colour * (1.0 + 0.6 * ridges))
            }
            Self::Sign(face) => sign_texture::texel(*face, at),
        }
    }
}

fn grained(colour: Vec3, grain: f32, frequency: f32, at: &Surface) -> Vec3 {
    let p = at.local;
    // A skewed section through the solid keeps the pattern from being constant along any face.
    let n = octaves(p.x + 0.61 * p.z, p.y + 0.73 * p.z, frequency, 4, at.footprint, at.seed);
    colour * (1.0 + grain * n).max(0.0)
}

fn tiles(colour: Vec3, at: &Surface) -> Texel {
    let p = at.local;
    let along = if at.face < 2 { p.y } else { p.x };
    let gap = stripes(p.z, 0.28, 0.05, at.footprint).max(0.7 * stripes(along, 0.3, 0.03, at.footprint));
    let tone = 1.0 + 0.35 * octaves(along, 1.5 * p.z, 1.2, 3, at.footprint, at.seed);
    Texel::opaque(colour * tone * (1.0 - 0.5 * gap))
}

fn leaves(colour: Vec3, at: &Surface) -> Texel {
    let p = at.local;
    let tint = unit(hash(0, 1, at.seed)) - 0.5;
    let tone = 1.0 + 0.5 * tint + 0.8 * octaves(p.x, p.y, 5.0, 3, at.footprint, at.seed);
    let warm = Vec3::new(1.0 + 0.35 * tint, 1.0, 1.0 - 0.3 * tint);
    Texel::opaque(colour * warm * tone.max(0.2))
}
