//! Who crosses the street and who turns into or out of the side street.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::{DMat3, DVec3};
use lgs_formats::pose::Pose;

use super::{Filling, ROOM};
use crate::scenes::{
    course::{Course, Piece, Way},
    maths::rotation_z,
    rng::Rng,
    side_street::{HALF_WIDTH, SideStreet},
    vehicles::{car, truck},
};

/// Length of the straight way before a turn (metres).
const APPROACH: f64 = 30.0;

impl Filling<'_> {
    /// Across the street on the side street, in the middle of the clip at most 9 m from the street's middle line.
    pub(super) fn crossing(&mut self, number: usize, side: SideStreet) {
        for k in 0..number {
            let model = self.vehicle();
            self.add(format!("crossing-{k}"), model, ROOM, |filling, rng| {
                let left = if rng.chance(0.5) { 1.0 } else { -1.0 };
                let frame = filling.road.frame(side.s + left * 0.5 * HALF_WIDTH, 0.0, 0.0);
                let speed = rng.uniform(1.5, 10.0);
                Some(filling.straight(frame, left, rng.uniform(-9.0, 9.0), speed))
            });
        }
    }

    /// Straight to the left (1) or right (-1) of a frame, `d` to its left in the middle of the clip.
    pub(super) fn straight(&self, frame: Pose, left: f64, d: f64, speed: f64) -> Course {
        let start = frame * Pose::new(rotation_z(left * FRAC_PI_2), DVec3::ZERO);
        Course::Way(Way { start, pieces: Vec::new(), place: left * d - 0.5 * speed * self.end, speed })
    }

    /// From the street into the side street or back, somewhere in the turn in the middle of the clip.
    pub(super) fn turning(&mut self, number: usize, side: SideStreet) {
        for k in 0..number {
            let model = if self.rng.chance(0.12) {
                truck(&mut self.rng, self.palette)
            } else {
                car(&mut self.rng, self.palette)
            };
            self.add(format!("turning-{k}"), model, ROOM, |filling, rng| Some(filling.turn(side, rng)));
        }
    }

    fn turn(&self, side: SideStreet, rng: &mut Rng) -> Course {
        let sign = |rng: &mut Rng| if rng.chance(0.5) { 1.0 } else { -1.0 };
        // Along the street and towards its left, each in (1) or against (-1) that direction, and the turn to the left (1) or right.
        let (turn, into) = (sign(rng), rng.chance(0.5));
        let entering = sign(rng);
        let leaving = entering * turn * if into { 1.0 } else { -1.0 };
        let (along, across) = if into { (entering, leaving) } else { (leaving, entering) };
        let lane = if turn > 0.0 { 0 } else { self.road.num_lanes - 1 };
        let corner = self.road.frame(
            side.s + across * 0.5 * HALF_WIDTH,
            -along * (lane as f64 + 0.5) * self.road.lane_width,
            0.0,
        );
        let heading = match (into, entering > 0.0) {
            (true, true) => 0.0,
            (true, false) => PI,
            (false, _) => entering * FRAC_PI_2,
        };
        let radius = if turn > 0.0 { rng.uniform(6.5, 9.0) } else { rng.uniform(4.2, 6.0) };
        let back = Pose::new(DMat3::IDENTITY, DVec3::NEG_X * (radius + APPROACH));
        let arc = radius * FRAC_PI_2;
        let pieces = vec![Piece { length: APPROACH, curvature: 0.0 }, Piece { length: arc, curvature: turn / radius }];
        let speed = rng.uniform(2.0, 6.5);
        let place = APPROACH + arc * rng.uniform(0.1, 0.9) - 0.5 * speed * self.end;
        let start = corner * Pose::new(rotation_z(heading), DVec3::ZERO) * back;
        Course::Way(Way { start, pieces, place, speed })
    }
}
