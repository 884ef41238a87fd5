//! What surfaces look like: albedo from the place on a primitive.

use glam::Vec3;

use super::{
    car_texture,
    facade::Facade,
    maths::{hash, mix, smoothstep, unit},
    sign_texture::{self, SignFace},
    texture::{octaves, pulse, stripes},
};

/// A place on a primitive, in the primitive's frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Surface {
    /// The point (metres).
    pub(crate) local: Vec3,
    /// The face as in [`super::shapes::LocalHit`].
    pub(crate) face: u8,
    /// Half extents of the shape.
    pub(crate) half: Vec3,
    /// Width of a pixel on the surface (metres).
    pub(crate) footprint: f32,
    /// Seed of the primitive.
    pub(crate) seed: u32,
}

impl Surface {
    /// The place on the face as seen from outside: metres to the right of the left edge and above the lower edge,
    /// and the extents of the face. Top and bottom faces count x and y.
    pub(crate) fn on_face(&self) -> FacePoint {
        let (p, h) = (self.local, self.half);
        let (right, up, half_width, half_height) = match self.face {
            0 => (p.y, p.z, h.y, h.z),
            1 => (-p.y, p.z, h.y, h.z),
            2 => (-p.x, p.z, h.x, h.z),
            3 => (p.x, p.z, h.x, h.z),
            _ => (p.x, p.y, h.x, h.y),
        };
        FacePoint { u: right + half_width, v: up + half_height, width: 2.0 * half_width, height: 2.0 * half_height }
    }
}

/// A place on a face of a box.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FacePoint {
    pub(crate) u: f32,
    pub(crate) v: f32,
    pub(crate) width: f32,
    pub(crate) height: f32,
}

/// What a surface does with light.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Texel {
    /// Diffuse reflectance, linear RGB.
    pub(crate) albedo: Vec3,
    /// Share of glass, which LiDAR mostly passes through.
    pub(crate) glass: f32,
    /// Share of the ambient light that reaches it.
    pub(crate) openness: f32,
}

impl Texel {
    /// An opaque texel in full ambient light.
    pub(crate) const fn opaque(albedo: Vec3) -> Self {
        Self { albedo, glass: 0.0, openness: 1.0 }
    }

    /// This texel with `cover` of another one over it.
    pub(crate) fn under(self, over: Self, cover: f32) -> Self {
        Self {
            albedo: self.albedo.lerp(over.albedo, cover),
            glass: mix(self.glass, over.glass, cover),
            openness: mix(self.openness, over.openness, cover),
        }
    }
}

/// Linear RGB of a colour as it looks on a screen (gamma 2).
pub(crate) fn colour(red: f32, green: f32, blue: f32) -> Vec3 {
    Vec3::new(red * red, green * green, blue * blue)
}

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

/// How much of the ambient light reaches a place `height` above the ground at a wall.
pub(crate) fn openness_above_ground(height: f32) -> f32 {
    mix(0.55, 1.0, smoothstep(-0.2, 1.6, height))
}

/// Cover of a rectangle in face coordinates.
pub(crate) fn rectangle(at: (f32, f32), low: (f32, f32), high: (f32, f32), footprint: f32) -> f32 {
    pulse(at.0, low.0, high.0, footprint) * pulse(at.1, low.1, high.1, footprint)
}
