//! How vehicles and people move along the street.

use glam::DVec3;
use lgs_formats::pose::Pose;

use super::{
    maths::{rotation_z, sin_cos},
    road::Road,
};

/// Half of the length that the vehicle with the sensors takes up (metres).
pub(crate) const EGO_HALF_LENGTH: f64 = 2.4;

/// Motion along the street at a fixed distance from its middle line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Motion {
    /// Place along the street at time 0 (metres).
    pub(crate) s: f64,
    /// Distance to the left of the middle line (metres).
    pub(crate) d: f64,
    /// Speed at time 0, m/s; negative against the street's direction.
    pub(crate) speed: f64,
    /// Change of the speed, m/s^2.
    pub(crate) acceleration: f64,
    /// Heading relative to the street's direction (radians).
    pub(crate) heading: f64,
    /// Height of the ground there (metres).
    pub(crate) height: f64,
}

/// Position and velocity of a rigid body at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Movement {
    /// `world_from_object`; x forward, z up, origin on the ground.
    pub(crate) pose: Pose,
    /// Velocity of the origin, m/s.
    pub(crate) velocity: DVec3,
    /// Rotation about z, rad/s.
    pub(crate) turn_rate: f64,
}

impl Movement {
    /// Velocity of the body at a world point, m/s.
    pub(crate) fn velocity_at(&self, point: DVec3) -> DVec3 {
        let arm = point - self.pose.translation();
        self.velocity + self.turn_rate * DVec3::new(-arm.y, arm.x, 0.0)
    }
}

impl Motion {
    /// A thing that stands still.
    pub(crate) const fn still(s: f64, d: f64, heading: f64, height: f64) -> Self {
        Self { s, d, speed: 0.0, acceleration: 0.0, heading, height }
    }

    /// Place along the street at a time (seconds).
    pub(crate) fn place(&self, road: &Road, time: f64) -> f64 {
        self.s + (self.speed * time + 0.5 * self.acceleration * time * time) / self.stretch(road)
    }

    /// Where the body is at a time (seconds) and how it moves.
    pub(crate) fn at(&self, road: &Road, time: f64) -> Movement {
        let frame = road.frame(self.place(road, time), self.d, self.height);
        let speed = self.speed + self.acceleration * time;
        Movement {
            pose: Pose::new(frame.rotation() * rotation_z(self.heading), frame.translation()),
            velocity: frame.rotation().x_axis * speed,
            turn_rate: road.curvature * speed / self.stretch(road),
        }
    }

    /// Metres at this distance from the middle line per metre of the middle line.
    fn stretch(&self, road: &Road) -> f64 {
        1.0 - road.curvature * self.d
    }
}

/// How the vehicle with the sensors moves: along its lane, swaying and nodding a little.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct EgoMotion {
    pub(crate) motion: Motion,
    /// Largest pitch (radians) and its angular frequency (rad/s).
    pub(crate) nod: [f64; 2],
    /// Largest sideways shift (metres) and its angular frequency (rad/s).
    pub(crate) sway: [f64; 2],
}

impl EgoMotion {
    /// `world_from_vehicle` at a time (seconds).
    pub(crate) fn pose(&self, road: &Road, time: f64) -> Pose {
        let pose = self.motion.at(road, time).pose;
        let shift = self.sway[0] * sin_cos(self.sway[1] * time).0;
        let pitch = self.nod[0] * sin_cos(self.nod[1] * time).0;
        let nodding = Pose::new(super::maths::rotation_y(pitch), DVec3::new(0.0, shift, 0.0));
        pose * nodding
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenes::road;

    #[test]
    fn velocities_are_the_derivatives_of_positions() {
        let road = road::tests::example(1.0 / 150.0);
        let motion =
            Motion { s: 12.0, d: 1.7, speed: -9.0, acceleration: 1.5, heading: std::f64::consts::PI, height: 0.0 };
        let (time, step) = (0.4, 1e-5);
        let corner = DVec3::new(2.2, -0.9, 1.0);
        let now = motion.at(&road, time);
        let place = |t| motion.at(&road, t).pose.transform_point(corner);
        let numeric = (place(time + step) - place(time - step)) / (2.0 * step);
        let exact = now.velocity_at(now.pose.transform_point(corner));
        assert!((numeric - exact).length() < 1e-6, "{numeric} {exact}");
        assert!((now.velocity.length() - (9.0 - 1.5 * time)).abs() < 1e-9);
        // It drives forwards: the heading and the velocity agree.
        assert!(now.pose.rotation().x_axis.dot(now.velocity) > 0.0);
    }

    #[test]
    fn a_parked_thing_stays() {
        let road = road::tests::example(0.002);
        let motion = Motion::still(5.0, -4.0, 0.02, 0.13);
        assert_eq!(motion.at(&road, 0.0), motion.at(&road, 3.0));
        assert_eq!(motion.at(&road, 1.0).velocity, DVec3::ZERO);
    }
}
