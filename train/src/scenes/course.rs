//! Ways that do not follow the street: straight pieces and arcs, so that vehicles cross it and turn.

use glam::DVec3;
use lgs_formats::pose::Pose;

use super::{
    maths::{rotation_z, sin_cos},
    motion::{Motion, Movement},
    road::Road,
};

/// A piece of a way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Piece {
    /// Metres.
    pub(crate) length: f64,
    /// 1/m, positive to the left; 0 for a straight piece.
    pub(crate) curvature: f64,
}

/// Motion along a way of its own. Before its first and behind its last piece the way goes straight on.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Way {
    /// Where it starts; x along it, z up.
    pub(crate) start: Pose,
    pub(crate) pieces: Vec<Piece>,
    /// Place along the way at time 0 (metres).
    pub(crate) place: f64,
    /// Speed, m/s, not negative.
    pub(crate) speed: f64,
}

/// How a thing moves.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Course {
    /// Along the street.
    Street(Motion),
    /// On a way of its own.
    Way(Way),
}

impl Way {
    /// Where the body is at a time (seconds) and how it moves.
    pub(crate) fn at(&self, time: f64) -> Movement {
        let mut rest = self.place + self.speed * time;
        let mut from = self.start;
        let mut curvature = 0.0;
        for piece in &self.pieces {
            if rest < 0.0 {
                break;
            }
            curvature = piece.curvature;
            if rest <= piece.length {
                break;
            }
            from = from * along(piece.length, curvature);
            rest -= piece.length;
            curvature = 0.0;
        }
        let pose = from * along(rest, curvature);
        Movement {
            pose,
            velocity: pose.rotation().x_axis * self.speed,
            turn_rate: if rest < 0.0 { 0.0 } else { curvature * self.speed },
        }
    }
}

/// The frame `length` metres further on an arc that starts at the origin towards +x.
fn along(length: f64, curvature: f64) -> Pose {
    let half = 0.5 * length * curvature;
    let (sin, cos) = sin_cos(half);
    let chord = if half.abs() < 1e-9 { length } else { length * sin / half };
    Pose::new(rotation_z(2.0 * half), DVec3::new(chord * cos, chord * sin, 0.0))
}

impl Course {
    /// Where the body is at a time (seconds) and how it moves.
    pub(crate) fn at(&self, road: &Road, time: f64) -> Movement {
        match self {
            Self::Street(motion) => motion.at(road, time),
            Self::Way(way) => way.at(time),
        }
    }

    /// Speed at a time (seconds), m/s.
    pub(crate) fn speed(&self, time: f64) -> f64 {
        match self {
            Self::Street(motion) => (motion.speed + motion.acceleration * time).abs(),
            Self::Way(way) => way.speed,
        }
    }

    /// Whether the body ever changes its place.
    pub(crate) fn is_mobile(&self) -> bool {
        match self {
            Self::Street(motion) => motion.speed != 0.0 || motion.acceleration != 0.0,
            Self::Way(way) => way.speed != 0.0,
        }
    }

    /// The motion along the street; `None` for a way of its own.
    pub(crate) fn street(&self) -> Option<&Motion> {
        match self {
            Self::Street(motion) => Some(motion),
            Self::Way(_) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn turning(place: f64) -> Way {
        let straight = |length| Piece { length, curvature: 0.0 };
        let pieces = vec![straight(10.0), Piece { length: 6.0 * std::f64::consts::FRAC_PI_2, curvature: 1.0 / 6.0 }];
        Way { start: Pose::new(rotation_z(0.3), DVec3::new(4.0, -3.0, 0.0)), pieces, place, speed: 5.0 }
    }

    #[test]
    fn velocities_are_the_derivatives_of_positions() {
        let corner = DVec3::new(2.2, -0.9, 1.0);
        for place in [-2.0, 4.0, 12.0, 18.0, 25.0] {
            let (way, step) = (turning(place), 1e-5);
            let now = way.at(0.1);
            let at = |time| way.at(time).pose.transform_point(corner);
            let numeric = (at(0.1 + step) - at(0.1 - step)) / (2.0 * step);
            let exact = now.velocity_at(now.pose.transform_point(corner));
            assert!((numeric - exact).length() < 1e-5, "{place}: {numeric} {exact}");
        }
    }

    #[test]
    fn a_quarter_turn_turns_by_a_quarter() {
        let [before, after] = [0.0, 30.0].map(|place| turning(place).at(0.0).pose);
        assert!((before.rotation().y_axis - after.rotation().x_axis).length() < 1e-12);
        let course = Course::Way(Way { speed: 0.0, ..turning(3.0) });
        assert!(!course.is_mobile() && course.speed(1.0) == 0.0 && course.street().is_none());
    }
}
