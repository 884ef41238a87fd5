//! A place on a surface, and what the surface does with light there.

use glam::Vec3;

use super::{
    maths::{mix, smoothstep},
    texture::pulse,
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

/// How much of the ambient light reaches a place `height` above the ground at a wall.
pub(crate) fn openness_above_ground(height: f32) -> f32 {
    mix(0.55, 1.0, smoothstep(-0.2, 1.6, height))
}

/// Cover of a rectangle in face coordinates.
pub(crate) fn rectangle(at: (f32, f32), low: (f32, f32), high: (f32, f32), footprint: f32) -> f32 {
    pulse(at.0, low.0, high.0, footprint) * pulse(at.1, low.1, high.1, footprint)
}
