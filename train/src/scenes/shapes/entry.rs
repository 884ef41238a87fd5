//! Where rays enter each kind of shape. A ray that starts inside one does not enter it.

use glam::{Vec2, Vec3};

use super::{LocalHit, Plane, Ray};
use crate::scenes::texture;

/// Entry into a box by slabs.
pub(super) fn cuboid(ray: &Ray, half: Vec3) -> Option<LocalHit> {
    let inverse = ray.inverse_direction();
    let near = (-half * inverse.signum() - ray.origin) * inverse;
    let far = (half * inverse.signum() - ray.origin) * inverse;
    let t = near.max_element();
    if t > far.min_element() {
        return None;
    }
    let axis = if t == near.x {
        0
    } else if t == near.y {
        1
    } else {
        2
    };
    let sign = -inverse[axis].signum();
    let mut normal = Vec3::ZERO;
    normal[axis] = sign;
    let face = [0, 2, 4][axis] + u8::from(sign < 0.0);
    Some(LocalHit { t, normal, face })
}

/// Entry into the intersection of half spaces.
pub(super) fn convex(ray: &Ray, planes: &[Plane; 6]) -> Option<LocalHit> {
    let (mut enter, mut exit, mut entered) = (f32::NEG_INFINITY, f32::INFINITY, 0_u8);
    for (face, plane) in (0_u8..).zip(planes) {
        let rate = plane.normal.dot(ray.direction);
        let room = plane.offset - plane.normal.dot(ray.origin);
        if rate < 0.0 {
            let t = room / rate;
            if t > enter {
                (enter, entered) = (t, face);
            }
        } else if rate > 0.0 {
            exit = exit.min(room / rate);
        } else if room < 0.0 {
            return None;
        }
    }
    (enter <= exit && enter.is_finite()).then(|| LocalHit {
        t: enter,
        normal: planes[usize::from(entered)].normal,
        face: entered,
    })
}

/// Entry into a capped cylinder around z.
pub(super) fn cylinder(ray: &Ray, radius: f32, half_height: f32) -> Option<LocalHit> {
    let (o, d) = (ray.origin, ray.direction);
    let cap_sign = -d.z.signum();
    let cap_near = (cap_sign * half_height - o.z) / d.z;
    let cap_far = (-cap_sign * half_height - o.z) / d.z;
    let a = d.x * d.x + d.y * d.y;
    if a < 1e-12 {
        let inside = o.x * o.x + o.y * o.y < radius * radius;
        return inside.then_some(LocalHit { t: cap_near, normal: Vec3::Z * cap_sign, face: cap_face(cap_sign) });
    }
    let b = (o.x * d.x + o.y * d.y) / a;
    let c = (o.x * o.x + o.y * o.y - radius * radius) / a;
    let root = (b * b - c).max(-1.0);
    if root < 0.0 {
        return None;
    }
    let (near, far) = (-b - root.sqrt(), -b + root.sqrt());
    let level = d.z == 0.0;
    if level && o.z.abs() > half_height {
        return None;
    }
    if level || near > cap_near {
        let inside = level || near <= cap_far.min(far);
        let p = ray.at(near);
        return inside.then(|| LocalHit { t: near, normal: Vec3::new(p.x, p.y, 0.0) / radius, face: 0 });
    }
    (cap_near <= far).then_some(LocalHit { t: cap_near, normal: Vec3::Z * cap_sign, face: cap_face(cap_sign) })
}

fn cap_face(sign: f32) -> u8 {
    if sign > 0.0 { 4 } else { 5 }
}

/// Entry into an ellipsoid.
pub(super) fn ellipsoid(ray: &Ray, radii: Vec3) -> Option<LocalHit> {
    let (o, d) = (ray.origin / radii, ray.direction / radii);
    let a = d.length_squared();
    let b = o.dot(d) / a;
    let nearest = o - d * b;
    let root = (1.0 - nearest.length_squared()) / a;
    (root >= 0.0).then(|| {
        let t = -b - root.sqrt();
        LocalHit { t, normal: (ray.at(t) / (radii * radii)).normalize(), face: 0 }
    })
}

/// Whether a clump of leaves covers a place, in radii from its middle: a disc with holes and a ragged rim.
pub(crate) fn leaf_is_solid(place: Vec2, seed: u32) -> bool {
    let rim = place.length_squared();
    rim < 1.0 && texture::noise(place.x * 2.6 + 17.3, place.y * 2.6 + 5.1, seed) > 1.5 * rim - 0.85
}

/// Where a ray meets a clump of leaves; its normal looks against the ray.
pub(super) fn leaf(ray: &Ray, radius: f32, seed: u32) -> Option<LocalHit> {
    let t = -ray.origin.z / ray.direction.z;
    let place = ray.at(t).truncate() / radius;
    let normal = Vec3::new(0.0, 0.0, -ray.direction.z.signum());
    (t.is_finite() && leaf_is_solid(place, seed)).then_some(LocalHit { t, normal, face: 0 })
}
