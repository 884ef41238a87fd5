//! The ground: carriageway, kerbs and pavements as an exact surface that rays meet, and its looks.

use glam::{Vec2, Vec3};
use lgs_formats::casts::to_f32;

use super::{
    maths::{cell, hash, mix, smoothstep, unit},
    road::Road,
    shapes::Ray,
    side_street::SideStreet,
    surface::{Texel, colour},
    texture::{octaves, pulse, stripes, survives},
};

/// Part of the ground.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Zone {
    /// Between the kerbs.
    Carriageway,
    /// The face of a kerb.
    Kerb,
    /// Outside the kerbs.
    Pavement,
}

/// Where a ray meets the ground.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GroundHit {
    pub(crate) t: f32,
    pub(crate) normal: Vec3,
    pub(crate) zone: Zone,
}

/// The ground of a street.
#[derive(Clone, Debug)]
pub(crate) struct Ground {
    pub(crate) road: Road,
    /// Size of texture features relative to the usual.
    pub(crate) texture_scale: f32,
    pub(crate) asphalt: Vec3,
    pub(crate) paving: Vec3,
    pub(crate) verge: Vec3,
    /// Length of paving slabs (metres).
    pub(crate) slab: f32,
    /// Places along the street of zebra crossings (metres).
    pub(crate) crossings: Vec<f32>,
    pub(crate) side: Option<SideStreet>,
    pub(crate) seed: u32,
}

impl Ground {
    /// Where a ray that starts above the ground meets it between `t_min` and `t_max`.
    pub(crate) fn intersect(&self, ray: &Ray, t_min: f32, t_max: f32) -> Option<GroundHit> {
        let down = -ray.direction.z;
        let (kerb, height) = (to_f32(self.road.kerb_offset()), to_f32(self.road.kerb_height));
        if down <= 0.0 || ray.origin.z <= height {
            return None;
        }
        if let Some(side) = self.side {
            return Some(self.with_side_street(side, ray)).filter(|hit| hit.t > t_min && hit.t < t_max);
        }
        let offset = |t: f32| self.road.offset(ray.at(t).truncate());
        let upper = (ray.origin.z - height) / down;
        let hit = if offset(upper).abs() >= kerb {
            GroundHit { t: upper, normal: Vec3::Z, zone: Zone::Pavement }
        } else {
            let lower = ray.origin.z / down;
            let end = offset(lower);
            if end.abs() < kerb {
                GroundHit { t: lower, normal: Vec3::Z, zone: Zone::Carriageway }
            } else {
                let t = crossing(offset, upper, lower, kerb.copysign(end));
                let left = self.road.left(ray.at(t).truncate()) * -end.signum();
                GroundHit { t, normal: Vec3::new(left.x, left.y, 0.0), zone: Zone::Kerb }
            }
        };
        (hit.t > t_min && hit.t < t_max).then_some(hit)
    }

    /// As [`Self::intersect`], for a ray that comes down from above the kerbs, where a side street has kerbs of its own.
    fn with_side_street(&self, side: SideStreet, ray: &Ray) -> GroundHit {
        let (kerb, height) = (to_f32(self.road.kerb_offset()), to_f32(self.road.kerb_height));
        let from_kerbs = |t: f32| {
            let at = ray.at(t).truncate();
            [self.road.offset(at).abs() - kerb, side.outside(&self.road, at)]
        };
        let raised = |t: f32| from_kerbs(t).into_iter().fold(f32::INFINITY, f32::min);
        let (upper, lower) = ((ray.origin.z - height) / -ray.direction.z, ray.origin.z / -ray.direction.z);
        if raised(upper) >= 0.0 {
            return GroundHit { t: upper, normal: Vec3::Z, zone: Zone::Pavement };
        }
        if raised(lower) < 0.0 {
            return GroundHit { t: lower, normal: Vec3::Z, zone: Zone::Carriageway };
        }
        let t = crossing(raised, upper, lower, 0.0);
        let (at, [own, others]) = (ray.at(t).truncate(), from_kerbs(t));
        let left = self.road.left(at);
        let inward = if own < others {
            left * -self.road.offset(at).signum()
        } else {
            -left.perp() * (to_f32(side.s) - self.road.coordinates(at).x).signum()
        };
        GroundHit { t, normal: Vec3::new(inward.x, inward.y, 0.0), zone: Zone::Kerb }
    }

    /// Whether a ground point lies on the side street, its mouths and the crossing.
    fn is_on_side_street(&self, at: Vec2) -> bool {
        self.side.is_some_and(|side| side.outside(&self.road, at) < 0.0)
    }

    /// What the ground does with light at a world point.
    pub(crate) fn texel(&self, point: Vec3, zone: Zone, footprint: f32) -> Texel {
        let at = self.road.coordinates(Vec2::new(point.x, point.y));
        let w = footprint / self.texture_scale;
        match zone {
            Zone::Carriageway => {
                let side = self.is_on_side_street(Vec2::new(point.x, point.y));
                self.carriageway(at, footprint, w, side)
            }
            Zone::Kerb => {
                let joint = stripes(at.x, 1.0, 0.03, footprint);
                let tone = 1.0 + 0.3 * octaves(at.x, point.z * 4.0, 4.0, 3, footprint, self.seed ^ 6);
                Texel { openness: 0.75, ..Texel::opaque(colour(0.62, 0.61, 0.6) * tone * (1.0 - 0.5 * joint)) }
            }
            Zone::Pavement => self.pavement(at, footprint, w),
        }
    }

    fn carriageway(&self, at: Vec2, footprint: f32, w: f32, on_side_street: bool) -> Texel {
        let (s, d) = (at.x, at.y);
        let scaled = at / self.texture_scale;
        let patch = octaves(scaled.x * 0.35, scaled.y, 0.5, 3, w, self.seed);
        let grit = octaves(scaled.x, scaled.y, 4.0, 5, w, self.seed ^ 1);
        let mut albedo = self.asphalt * (1.0 + 0.22 * patch + 0.5 * grit);
        // Two dark tracks in each lane, where wheels run.
        let lane = to_f32(self.road.lane_width);
        let in_lane = (d / lane).rem_euclid(1.0) * lane - 0.5 * lane;
        let track = smoothstep(0.45, 0.0, (in_lane.abs() - 0.8).abs());
        albedo *= 1.0 - 0.13 * track * (1.0 + patch);
        // Repaired rectangles and thin cracks.
        let (i, j) = (cell(s / 9.0), cell(d / 2.3));
        let repair = unit(hash(i, j, self.seed ^ 2));
        if repair < 0.14 {
            let inside = pulse(s - i as f32 * 9.0, 1.0, 1.0 + 40.0 * repair, footprint)
                * pulse(d - j as f32 * 2.3, 0.3, 2.0, footprint);
            albedo = albedo.lerp(self.asphalt * 0.68 * (1.0 + 0.3 * grit), 0.85 * inside);
        }
        let vein = octaves(scaled.x, scaled.y, 0.45, 3, w, self.seed ^ 3).abs();
        albedo *= 1.0 - 0.4 * smoothstep(0.022, 0.0, vein) * smoothstep(0.0, 0.25, patch) * survives(9.0, w);
        let kerb = to_f32(self.road.kerb_offset());
        let gutter = if on_side_street { 0.0 } else { smoothstep(kerb - 0.5, kerb, d.abs()) };
        albedo = albedo.lerp(self.asphalt * 0.75, gutter);
        let worn = 0.78 + 0.3 * octaves(scaled.x, scaled.y, 3.0, 3, w, self.seed ^ 4);
        let markings = if on_side_street { 0.0 } else { self.markings(s, d, footprint) };
        let paint = markings * worn.clamp(0.0, 1.0);
        Texel { openness: 1.0 - 0.2 * gutter, ..Texel::opaque(albedo.lerp(colour(0.86, 0.86, 0.83), paint)) }
    }

    /// Cover of the white paint.
    fn markings(&self, s: f32, d: f32, w: f32) -> f32 {
        for &at in &self.crossings {
            if (s - at).abs() < 2.2 + w {
                let bars = stripes(d + 100.0, 1.0, 0.5, w);
                return bars * pulse(s, at - 1.8, at + 1.8, w);
            }
            let stop_line = pulse((s - at).abs(), 3.0, 3.4, w);
            let before = (s < at) == (d < 0.0);
            if stop_line > 0.0 && before {
                return stop_line;
            }
        }
        let lane = to_f32(self.road.lane_width);
        let dash = stripes(s + 1.5, 7.5, 3.0, w);
        let mut paint = dash * pulse(d, -0.07, 0.07, w);
        for k in 1..self.road.num_lanes {
            paint =
                paint.max(stripes(s, 9.0, 3.0, w) * pulse(d.abs(), k as f32 * lane - 0.06, k as f32 * lane + 0.06, w));
        }
        let edge = lane * self.road.num_lanes as f32;
        if self.road.parking_width > 0.0 {
            // The parking strip: a broken edge line and a bar every slot.
            paint = paint.max(pulse(d.abs(), edge - 0.05, edge + 0.05, w) * stripes(s, 6.0, 5.0, w));
            paint = paint.max(0.8 * stripes(s + 0.6, 6.0, 0.1, w) * pulse(d.abs(), edge, edge + 1.9, w));
        } else {
            paint = paint.max(pulse(d.abs(), edge - 0.35, edge - 0.23, w));
        }
        paint
    }

    fn pavement(&self, at: Vec2, footprint: f32, w: f32) -> Texel {
        let (s, d) = (at.x, at.y.abs());
        let (kerb, building) = (to_f32(self.road.kerb_offset()), to_f32(self.road.building_offset()));
        let scaled = at / self.texture_scale;
        let grit = octaves(scaled.x, scaled.y, 4.0, 4, w, self.seed ^ 5);
        let stain = octaves(scaled.x, scaled.y, 0.4, 3, w, self.seed ^ 7);
        if d > building + 0.6 {
            let grass = octaves(scaled.x, scaled.y, 1.7, 5, w, self.seed ^ 8);
            let bare = smoothstep(0.1, 0.6, stain);
            let soil = colour(0.50, 0.44, 0.36) * (1.0 + 0.4 * grit);
            return Texel::opaque((self.verge * (1.0 + 0.75 * grass)).lerp(soil, bare));
        }
        let side = if at.y > 0.0 { 1 } else { 2 };
        let (i, j) = (cell(s / self.slab), cell((d - kerb) / self.slab));
        let shifted = if j % 2 == 0 { s } else { s + 0.5 * self.slab };
        let i = if j % 2 == 0 { i } else { cell(shifted / self.slab) };
        let tone = 0.3 * (unit(hash(i, j, self.seed ^ side)) - 0.5) * survives(0.5 / self.slab, footprint);
        let joint = stripes(shifted, self.slab, 0.03, footprint).max(stripes(d - kerb, self.slab, 0.03, footprint));
        let slab = self.paving * (1.0 + tone + 0.2 * grit + 0.2 * stain) * (1.0 - 0.5 * joint);
        let kerbstone = colour(0.70, 0.69, 0.67) * (1.0 + 0.2 * grit) * (1.0 - 0.45 * stripes(s, 1.0, 0.03, footprint));
        let wall = mix(1.0, 0.7, smoothstep(building - 0.7, building + 0.1, d));
        let albedo = slab.lerp(kerbstone, pulse(d, kerb - 1.0, kerb + 0.22, footprint));
        Texel { openness: wall, ..Texel::opaque(albedo) }
    }
}

/// The `t` between `low` and `high` at which `offset` reaches `goal`, by bisection.
fn crossing(offset: impl Fn(f32) -> f32, mut low: f32, mut high: f32, goal: f32) -> f32 {
    for _ in 0..24 {
        let middle = 0.5 * (low + high);
        if (offset(middle) - goal) * goal.signum() < 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    high
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenes::road;

    fn ground() -> Ground {
        Ground {
            road: road::tests::example(1.0 / 200.0),
            texture_scale: 1.0,
            asphalt: Vec3::splat(0.1),
            paving: Vec3::splat(0.3),
            verge: Vec3::splat(0.2),
            slab: 0.6,
            crossings: vec![20.0],
            side: None,
            seed: 1,
        }
    }

    #[test]
    fn rays_meet_carriageway_kerb_and_pavement_at_their_heights() {
        let ground = ground();
        let origin = Vec3::new(0.0, 0.0, 2.0);
        let mut seen = [0; 3];
        for k in 1..400_u16 {
            let ray = Ray { origin, direction: Vec3::new(0.01, f32::from(k) * 0.02, -1.0) };
            let hit = ground.intersect(&ray, 0.0, 100.0).unwrap();
            let (p, d) = (ray.at(hit.t), ground.road.offset(ray.at(hit.t).truncate()));
            match hit.zone {
                Zone::Carriageway => assert!(p.z.abs() < 1e-4 && d < 5.6001),
                Zone::Kerb => assert!(p.z > -1e-4 && p.z < 0.1301 && (d - 5.6).abs() < 1e-3 && hit.normal.y < -0.99),
                Zone::Pavement => assert!((p.z - 0.13).abs() < 1e-4 && d > 5.5999),
            }
            seen[hit.zone as usize] += 1;
        }
        assert!(seen.iter().all(|&n| n > 3), "{seen:?}");
        assert!(ground.intersect(&Ray { origin, direction: Vec3::X }, 0.0, 100.0).is_none());
    }

    #[test]
    fn a_side_street_lets_the_carriageway_through_the_pavements() {
        let ground = Ground { side: Some(SideStreet { s: 9.0 }), ..ground() };
        let origin = Vec3::new(4.0, 7.0, 2.0);
        let mut seen = [0; 3];
        for k in 1..400_u16 {
            let ray = Ray { origin, direction: Vec3::new(f32::from(k) * 0.02, 0.004 * f32::from(k % 9), -1.0) };
            let hit = ground.intersect(&ray, 0.0, 100.0).unwrap();
            let p = ray.at(hit.t);
            let outside = ground.side.unwrap().outside(&ground.road, p.truncate());
            match hit.zone {
                Zone::Carriageway => assert!(p.z.abs() < 1e-4 && outside < 1e-4, "{p}"),
                Zone::Kerb => {
                    assert!(outside.abs() < 1e-3 && hit.normal.dot(ray.direction) <= 0.0, "{p} {}", hit.normal)
                }
                Zone::Pavement => assert!((p.z - 0.13).abs() < 1e-4 && outside > -1e-4, "{p}"),
            }
            seen[hit.zone as usize] += 1;
        }
        assert!(seen.iter().all(|&n| n > 3), "{seen:?}");
    }

    #[test]
    fn crossings_are_painted() {
        let ground = ground();
        let lightest = |s: f64| {
            (0..50)
                .map(|k| ground.road.frame(s, -2.0 + f64::from(k) * 0.05, 0.0).translation())
                .map(|p| ground.texel(super::super::maths::narrow3(p), Zone::Carriageway, 0.01).albedo.y)
                .fold(0.0, f32::max)
        };
        assert!(lightest(20.0) > 0.4);
        assert!(lightest(27.0) < 0.25);
    }
}
