//! The line that the street follows and the cross-section of the street around it.

use glam::{DVec2, DVec3, Vec2};
use lgs_formats::casts::to_f32;
use lgs_formats::pose::Pose;

use super::maths::{rotation_z, sin_cos};

/// A street along a circular arc that starts at the origin towards +x. `s` runs along the middle line, `d` to its
/// left (metres).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Road {
    /// Curvature of the middle line, 1/m, positive to the left.
    pub(crate) curvature: f64,
    /// Width of a lane.
    pub(crate) lane_width: f64,
    /// Lanes in each direction.
    pub(crate) num_lanes: usize,
    /// Width of the parking strip on each side; 0 for none.
    pub(crate) parking_width: f64,
    /// Width of each pavement.
    pub(crate) pavement_width: f64,
    /// Height of the pavements above the carriageway.
    pub(crate) kerb_height: f64,
}

impl Road {
    /// Distance of the kerbs from the middle line.
    pub(crate) fn kerb_offset(&self) -> f64 {
        self.lane_width * self.num_lanes as f64 + self.parking_width
    }

    /// Distance of the building line from the middle line.
    pub(crate) fn building_offset(&self) -> f64 {
        self.kerb_offset() + self.pavement_width
    }

    /// The frame at `(s, d)`: x along the street, y to the left, z up, origin `height` above the carriageway.
    pub(crate) fn frame(&self, s: f64, d: f64, height: f64) -> Pose {
        let heading = self.curvature * s;
        let (sin, cos) = sin_cos(heading);
        // Along the arc; the chord form holds for a straight line too.
        let half = 0.5 * heading;
        let chord = if half.abs() < 1e-9 { s } else { s * sin_cos(half).0 / half };
        let (sin_half, cos_half) = sin_cos(half);
        let middle = DVec2::new(chord * cos_half, chord * sin_half);
        let at = middle + DVec2::new(-sin, cos) * d;
        Pose::new(rotation_z(heading), DVec3::new(at.x, at.y, height))
    }

    /// `(s, d)` of a point.
    pub(crate) fn coordinates(&self, at: Vec2) -> Vec2 {
        let k = to_f32(self.curvature);
        if k.abs() < 1e-6 {
            return at;
        }
        let (across, along) = (1.0 - k * at.y, k * at.x);
        let s = libm::atan2f(along, across) / k;
        Vec2::new(s, self.offset(at))
    }

    /// `d` of a point.
    pub(crate) fn offset(&self, at: Vec2) -> f32 {
        let k = to_f32(self.curvature);
        // (1 - |1 - k p|) / k without the cancellation.
        let across = 1.0 - k * at.y;
        let along = k * at.x;
        let distance = (across * across + along * along).sqrt();
        (2.0 * at.y - k * at.length_squared()) / (1.0 + distance)
    }

    /// The unit vector to the left of the street at a point: the gradient of `d`.
    pub(crate) fn left(&self, at: Vec2) -> Vec2 {
        let k = to_f32(self.curvature);
        Vec2::new(-k * at.x, 1.0 - k * at.y).normalize()
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) fn example(curvature: f64) -> Road {
        Road { curvature, lane_width: 3.4, num_lanes: 1, parking_width: 2.2, pavement_width: 3.0, kerb_height: 0.13 }
    }

    #[test]
    fn coordinates_invert_the_frame() {
        for curvature in [0.0, 1.0 / 150.0, -1.0 / 400.0] {
            let road = example(curvature);
            for s in [-70.0, -1.0, 0.0, 35.0, 180.0] {
                for d in [-12.0, 0.0, 4.5] {
                    let pose = road.frame(s, d, 1.0);
                    let at = Vec2::new(to_f32(pose.translation().x), to_f32(pose.translation().y));
                    let back = road.coordinates(at);
                    assert!((f64::from(back.x) - s).abs() < 1e-3, "{curvature} {s} {d}: {back}");
                    assert!((f64::from(back.y) - d).abs() < 1e-3, "{curvature} {s} {d}: {back}");
                    let left = pose.rotation().y_axis;
                    assert!((road.left(at) - Vec2::new(to_f32(left.x), to_f32(left.y))).length() < 1e-5);
                }
            }
        }
    }
}
