//! Faces of traffic signs and boards.

use glam::Vec3;

use super::{
    maths::{cell, hash, unit},
    surface::{Surface, Texel, colour, rectangle},
    texture::pulse,
};

/// What a sign shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SignFace {
    /// A red ring around dark figures on white (round plate).
    Limit,
    /// A white arrow on blue (round plate).
    Direction,
    /// A white bar on red (round plate).
    NoEntry,
    /// Lines of white writing on a coloured board (rectangular plate).
    Board,
    /// Red, amber and green lamps above each other (upright box).
    Lights,
}

/// What the sign does with light at a place. Its front is the face +x of a box or the top of a cylinder.
pub(crate) fn texel(face: SignFace, at: &Surface) -> Texel {
    let is_front = if at.half.x == at.half.y { at.face == 4 } else { at.face == 0 };
    if !is_front {
        return Texel::opaque(Vec3::splat(if face == SignFace::Lights { 0.02 } else { 0.3 }));
    }
    // Across and up as shares of the half extents; a cylinder's cap lies in its x (down) and y (right).
    let (x, y, reach) = if at.face == 4 {
        (at.local.y / at.half.y, -at.local.x / at.half.x, at.half.x)
    } else {
        (at.local.y / at.half.y, at.local.z / at.half.z, at.half.z)
    };
    let w = at.footprint / reach;
    let radius = (x * x + y * y).sqrt();
    let (white, red) = (Vec3::splat(0.82), colour(0.78, 0.08, 0.09));
    let albedo = match face {
        SignFace::Limit => {
            let figures = rectangle((x.abs(), y), (0.08, -0.35), (0.42, 0.35), w)
                - rectangle((x.abs(), y), (0.19, -0.2), (0.31, 0.22), w);
            let inner = white.lerp(Vec3::splat(0.02), figures.clamp(0.0, 1.0));
            red.lerp(inner, pulse(radius, -1.0, 0.72, w))
        }
        SignFace::Direction => {
            let shaft = rectangle((x, y), (-0.12, -0.6), (0.12, 0.2), w);
            let head = pulse(x.abs() + y, -9.0, 0.62, w) * pulse(y, 0.1, 1.0, w);
            colour(0.08, 0.28, 0.68).lerp(white, shaft.max(head))
        }
        SignFace::NoEntry => red.lerp(white, rectangle((x, y), (-0.66, -0.17), (0.66, 0.17), w)),
        SignFace::Board => {
            let ground = colour(0.06, 0.34, 0.22).lerp(colour(0.1, 0.2, 0.55), unit(hash(1, 1, at.seed)).round());
            let line = cell(y * 2.5 + 20.0);
            let word = unit(hash(cell(x * 7.0), line, at.seed)) < 0.72;
            let ink = pulse((y * 2.5 + 20.0).fract(), 0.25, 0.75, 2.5 * w) * pulse(x.abs(), -1.0, 0.82, w);
            let border = 1.0 - rectangle((x, y), (-0.94, -0.9), (0.94, 0.9), w);
            ground.lerp(white, border.max(if word { ink } else { 0.0 }))
        }
        SignFace::Lights => {
            let lamp = |centre: f32| {
                let (dx, dy) = (x * at.half.y / at.half.z, y - centre);
                pulse((dx * dx + dy * dy).sqrt(), -1.0, 0.24, w)
            };
            let shown = hash(2, 2, at.seed) % 3;
            let glow = |k: u32| if k == shown { 3.0 } else { 0.15 };
            Vec3::splat(0.02)
                .lerp(colour(0.9, 0.1, 0.08) * glow(0), lamp(0.62))
                .lerp(colour(0.95, 0.7, 0.1) * glow(1), lamp(0.0))
                .lerp(colour(0.1, 0.85, 0.45) * glow(2), lamp(-0.62))
        }
    };
    Texel::opaque(albedo)
}
