//! Traffic as real streets have it: lorries, queues, crossing and turning cars, cyclists, people who cross. Nobody meets anybody.

mod across;

use std::f64::consts::PI;

use super::{
    config::{BusySpec, SceneConfig},
    course::Course,
    cyclist::cyclist,
    footprint::Footprint,
    lorry::lorry,
    motion::{EGO_HALF_LENGTH, EgoMotion, Motion},
    object::{Model, Object, Palette},
    rng::Rng,
    road::Road,
    side_street::SideStreet,
    streams,
    vehicles::{car, person, truck},
};

/// Places that are tried for a thing.
const TRIES: usize = 60;
/// Moments at which bodies are compared, and how far these reach beyond the clip (seconds): cameras may be early or late.
const MOMENTS: usize = 16;
const BEYOND_S: f64 = 0.2;
/// Room (metres) between vehicles, and around people and cyclists.
const ROOM: f64 = 0.3;
const CLOSE: f64 = 0.05;
/// Room before and behind the vehicle with the sensors (metres).
const EGO_GAP: f64 = 2.5;

/// A street that is being filled.
struct Filling<'a> {
    road: &'a Road,
    ego: &'a EgoMotion,
    end: f64,
    rng: Rng,
    palette: &'a mut Palette,
    objects: &'a mut Vec<Object>,
}

/// Adds what `spec` asks for to `objects`.
pub(crate) fn join(
    config: &SceneConfig,
    spec: &BusySpec,
    road: &Road,
    ego: &EgoMotion,
    palette: &mut Palette,
    objects: &mut Vec<Object>,
) {
    let end = config.frame_time(config.num_frames);
    let side = spec.side_street.map(|s| SideStreet { s });
    if let Some(side) = side {
        // Who walks along the pavement would float over the side street.
        objects.retain(|object| {
            let motion = object.course.street().filter(|motion| motion.height > 0.0);
            motion.is_none_or(|m| [-BEYOND_S, end + BEYOND_S].iter().all(|&t| side.is_clear(m.place(road, t), 1.0)))
        });
    }
    let rng = Rng::new(config.seed, streams::BUSY);
    let mut filling = Filling { road, ego, end, rng, palette, objects };
    if let Some(side) = side {
        filling.crossing(spec.crossing, side);
        filling.turning(spec.turning, side);
    }
    filling.queue(spec.queue);
    filling.lorries(spec.lorries);
    filling.cyclists(spec.cyclists);
    filling.people(spec.people_across);
}

impl Filling<'_> {
    /// Moments at which bodies are compared, seconds.
    fn moments(&self) -> impl Iterator<Item = f64> + use<> {
        let whole = self.end + 2.0 * BEYOND_S;
        (0..=MOMENTS).map(move |k| whole * k as f64 / MOMENTS as f64 - BEYOND_S)
    }

    fn is_clear(&self, object: &Object, room: f64) -> bool {
        self.moments().all(|time| {
            let own = object.footprint(self.road, time).grown(room);
            let length = 2.0 * (EGO_HALF_LENGTH + EGO_GAP);
            let ego = Footprint::of(&self.ego.motion.at(self.road, time), length, 2.0);
            !own.meets(&ego) && self.objects.iter().all(|other| !own.meets(&other.footprint(self.road, time)))
        })
    }

    /// Adds a thing on the first course that `draw` gives and that is clear; nothing if there is none.
    fn add(&mut self, track: String, model: Model, room: f64, draw: impl Fn(&Self, &mut Rng) -> Option<Course>) {
        let mut object = Object { track, model, course: Course::Street(Motion::still(0.0, 0.0, 0.0, 0.0)) };
        let mut rng = self.rng.clone();
        let found = (0..TRIES).any(|_| {
            let Some(course) = draw(self, &mut rng) else { return false };
            object.course = course;
            self.is_clear(&object, room)
        });
        self.rng = rng;
        if found {
            self.objects.push(object);
        }
    }

    /// A course in a lane of the street, in (1) or against (-1) its direction.
    fn lane(&self, s: f64, lane: usize, direction: f64, speed: f64) -> Course {
        Course::Street(Motion {
            s,
            d: -direction * (lane as f64 + 0.5) * self.road.lane_width,
            speed: direction * speed,
            acceleration: 0.0,
            heading: if direction > 0.0 { 0.0 } else { PI },
            height: 0.0,
        })
    }

    fn vehicle(&mut self) -> Model {
        match self.rng.index(10) {
            0 => lorry(&mut self.rng, self.palette),
            1 => truck(&mut self.rng, self.palette),
            _ => car(&mut self.rng, self.palette),
        }
    }

    fn queue(&mut self, number: usize) {
        let lane = self.rng.index(self.road.num_lanes);
        let direction = if self.rng.chance(0.6) { -1.0 } else { 1.0 };
        let pace = self.rng.uniform(0.7, 1.9);
        let mut s = self.rng.uniform(4.0, 12.0);
        for k in 0..number {
            let model = self.vehicle();
            let length = model.size.x;
            s += 0.5 * length;
            let own = pace * self.rng.uniform(0.85, 1.15);
            let before = self.objects.len();
            for _ in 0..12 {
                let course = self.lane(s, lane, direction, own);
                self.add(format!("queue-{k}"), model.clone(), ROOM, |_, _| Some(course.clone()));
                if self.objects.len() > before {
                    break;
                }
                s += 1.5;
            }
            s += 0.5 * length + self.rng.uniform(1.2, 3.0);
        }
    }

    fn lorries(&mut self, number: usize) {
        for k in 0..number {
            let model = lorry(&mut self.rng, self.palette);
            self.add(format!("lorry-{k}"), model, ROOM, |filling, rng| {
                let direction = if rng.chance(0.5) { -1.0 } else { 1.0 };
                let (s, lane) = (rng.uniform(-8.0, 48.0), rng.index(filling.road.num_lanes));
                Some(filling.lane(s, lane, direction, rng.uniform(1.0, 12.0)))
            });
        }
    }

    fn cyclists(&mut self, number: usize) {
        for k in 0..number {
            let model = cyclist(&mut self.rng, self.palette);
            self.add(format!("cyclist-{k}"), model, CLOSE, |filling, rng| {
                let direction = if rng.chance(0.5) { -1.0 } else { 1.0 };
                let edge = filling.road.lane_width * filling.road.num_lanes as f64;
                Some(Course::Street(Motion {
                    s: rng.uniform(4.0, 36.0),
                    d: -direction * (edge - rng.uniform(0.1, 0.5)),
                    speed: direction * rng.uniform(2.0, 7.0),
                    acceleration: 0.0,
                    heading: if direction > 0.0 { 0.0 } else { PI },
                    height: 0.0,
                }))
            });
        }
    }

    /// Across the carriageway, from kerb to kerb at most.
    fn people(&mut self, number: usize) {
        for k in 0..number {
            let model = person(&mut self.rng, self.palette);
            self.add(format!("walker-{k}"), model, CLOSE, |filling, rng| {
                let left = if rng.chance(0.5) { 1.0 } else { -1.0 };
                let (speed, kerb) = (rng.uniform(0.5, 1.8), filling.road.kerb_offset());
                let d = rng.uniform(-kerb, kerb);
                let reach = d.abs() + speed * (0.5 * filling.end + BEYOND_S) + 0.3;
                let frame = filling.road.frame(rng.uniform(7.0, 32.0), 0.0, 0.0);
                (reach < kerb).then(|| filling.straight(frame, left, d, speed))
            });
        }
    }
}

#[cfg(test)]
mod tests;
