//! What cars look like: paint, seams, windows, lights, wheels. The object's front is +x.

use glam::Vec3;

use super::{
    maths::{hash, mix, smoothstep, unit},
    surface::{FacePoint, Surface, Texel, colour, rectangle},
    texture::{octaves, pulse, stripes},
};

/// Distance between the axles as a share of the length.
pub(crate) const WHEELBASE: f32 = 0.6;

fn glass(shade: f32) -> Texel {
    Texel { albedo: colour(0.16, 0.20, 0.24).lerp(colour(0.48, 0.56, 0.64), shade), glass: 0.8, openness: 0.9 }
}

/// Paint with a little dust; darker towards the ground.
fn painted(paint: Vec3, at: &Surface) -> Vec3 {
    let p = at.local;
    let dust = octaves(p.x + 0.4 * p.y, p.z + 0.4 * p.y, 2.5, 4, at.footprint, at.seed);
    let height = smoothstep(-at.half.z, 0.2 * at.half.z, p.z);
    paint * (1.0 + 0.13 * dust) * mix(0.6, 1.0, height)
}

/// The lower part of a car.
pub(crate) fn body(paint: Vec3, at: &Surface) -> Texel {
    let (p, w) = (at.on_face(), at.footprint);
    let base = Texel::opaque(painted(paint, at));
    let dark = Texel { openness: 0.6, ..Texel::opaque(Vec3::splat(0.012)) };
    match at.face {
        0 => front(base, &p, at),
        1 => rear(base, &p, at),
        2 | 3 => {
            let seams = [-0.14, 0.1, 0.29].map(|share| {
                let x = at.local.x - share * 2.0 * at.half.x;
                pulse(x, -0.015, 0.015, w) * pulse(p.v, 0.15, p.height, w)
            });
            let seam = seams[0].max(seams[1]).max(seams[2]);
            let handles = [-0.08, 0.15].map(|share| {
                let x = at.local.x - share * 2.0 * at.half.x;
                rectangle((x, p.v), (-0.1, 0.72 * p.height), (0.1, 0.78 * p.height), w)
            });
            let crease = pulse(p.v, 0.55 * p.height, 0.59 * p.height, w);
            let arch = wheel_arch(at);
            let skirt = pulse(p.v, 0.0, 0.12, w);
            base.under(Texel { albedo: base.albedo * 1.25, ..base }, crease)
                .under(dark, seam.max(0.7 * handles[0].max(handles[1])))
                .under(dark, arch.max(skirt))
        }
        4 => {
            // The bonnet and boot catch the sky; seams around them.
            let x = at.local.x / at.half.x;
            let seam = pulse(x, 0.42, 0.44, w).max(pulse(x, -0.72, -0.7, w));
            base.under(dark, 0.8 * seam)
        }
        _ => dark,
    }
}

/// Cover of the dark openings around the wheels on a car's side.
fn wheel_arch(at: &Surface) -> f32 {
    let axle = WHEELBASE * at.half.x;
    let x = at.local.x.abs() - axle;
    let z = at.local.z + at.half.z + 0.05;
    let distance = (x * x + z * z).sqrt();
    pulse(distance, -1.0, 0.42, at.footprint)
}

fn front(base: Texel, p: &FacePoint, at: &Surface) -> Texel {
    let (w, x) = (at.footprint, p.u / p.width - 0.5);
    let y = p.v / p.height;
    let wn = w / p.height;
    let lamps = pulse(x.abs(), 0.30, 0.47, wn) * pulse(y, 0.55, 0.82, wn);
    let grille = pulse(x.abs(), -1.0, 0.24, wn) * pulse(y, 0.5, 0.8, wn);
    let bars = 0.3 * stripes(y, 0.08, 0.03, wn);
    let intake = pulse(x.abs(), -1.0, 0.4, wn) * pulse(y, 0.05, 0.25, wn);
    base.under(Texel::opaque(Vec3::splat(0.02 + 0.2 * bars)), grille.max(intake))
        .under(Texel::opaque(colour(0.93, 0.94, 0.96)), lamps)
        .under(plate(x, y, wn, at), pulse(x.abs(), -1.0, 0.16, wn) * pulse(y, 0.3, 0.45, wn))
}

fn rear(base: Texel, p: &FacePoint, at: &Surface) -> Texel {
    let (x, y) = (p.u / p.width - 0.5, p.v / p.height);
    let wn = at.footprint / p.height;
    let lamps = pulse(x.abs(), 0.35, 0.48, wn) * pulse(y, 0.58, 0.8, wn);
    let bumper = pulse(y, 0.0, 0.2, wn);
    base.under(Texel::opaque(Vec3::splat(0.02)), bumper)
        .under(Texel::opaque(colour(0.78, 0.08, 0.06)), lamps)
        .under(plate(x, y, wn, at), pulse(x.abs(), -1.0, 0.16, wn) * pulse(y, 0.4, 0.56, wn))
}

/// A number plate: dark characters on white.
fn plate(x: f32, y: f32, wn: f32, at: &Surface) -> Texel {
    let character = unit(hash(super::maths::cell(x * 50.0), 3, at.seed)) > 0.35;
    let ink = if character { 0.8 * pulse((y * 7.0).fract(), 0.2, 0.8, 7.0 * wn) } else { 0.0 };
    Texel::opaque(Vec3::splat(0.8 * (1.0 - ink)))
}

/// The upper part of a car: windows between pillars under a painted roof.
pub(crate) fn cabin(paint: Vec3, at: &Surface) -> Texel {
    let (p, w) = (at.on_face(), at.footprint);
    let base = Texel::opaque(painted(paint, at));
    if at.face >= 4 {
        return base;
    }
    let y = p.v / p.height;
    let sky = smoothstep(0.1, 1.1, y + 0.25 * octaves(p.u, p.v, 1.1, 2, w, at.seed));
    let pane = pulse(y, 0.06, 0.84, w / p.height);
    let cover = if at.face < 2 {
        pulse(p.u, 0.1, p.width - 0.1, w)
    } else {
        let x = at.local.x / at.half.x;
        let wn = w / at.half.x;
        // The panes end along slanted pillars and one pillar stands between the doors.
        pulse(x, -0.93 + 0.25 * y, 0.93 - 0.35 * y, wn) * (1.0 - pulse(x, -0.12, -0.02, wn))
    };
    base.under(glass(sky), pane * cover)
}

/// The closed box of a van or a truck: a band of colour and ribs.
pub(crate) fn cargo(paint: Vec3, band: Vec3, at: &Surface) -> Texel {
    let (p, w) = (at.on_face(), at.footprint);
    let base = Texel::opaque(painted(paint, at));
    if at.face >= 4 {
        return base;
    }
    let y = p.v / p.height;
    let wn = w / p.height;
    let emblem = octaves(p.u, p.v, 1.4, 2, w, at.seed ^ 0x77) > 0.12;
    let lettered = if emblem { pulse(y, 0.45, 0.8, wn) * pulse(p.u, 0.15 * p.width, 0.8 * p.width, w) } else { 0.0 };
    let ribs = 0.3 * stripes(p.u, 0.6, 0.04, w);
    base.under(Texel::opaque(band), pulse(y, 0.2, 0.34, wn).max(0.8 * lettered)).under(Texel::opaque(paint * 0.4), ribs)
}

/// A wheel: tyre, rim, spokes.
pub(crate) fn wheel(at: &Surface) -> Texel {
    if at.face == 0 {
        return Texel { openness: 0.6, ..Texel::opaque(Vec3::splat(0.02)) };
    }
    let (p, w) = (at.local, at.footprint);
    let radius = (p.x * p.x + p.y * p.y).sqrt();
    let rim = pulse(radius, -1.0, 0.68 * at.half.x, w);
    let hub = pulse(radius, -1.0, 0.16 * at.half.x, w);
    let spokes =
        smoothstep(-0.1, 0.2, (p.x * p.y * (p.x * p.x - p.y * p.y)) / (radius * radius * radius * radius + 1e-6));
    let metal = Vec3::splat(mix(0.07, 0.42, spokes.max(hub)));
    Texel { openness: 0.8, ..Texel::opaque(Vec3::splat(0.022).lerp(metal, rim)) }
}
