//! Traffic as real streets have it: lorries, queues, crossing and turning cars, cyclists, people who cross. Nobody meets anybody.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::DVec3;
use lgs_formats::pose::Pose;

use super::{
    config::{BusySpec, SceneConfig},
    course::{Course, Piece, Way},
    cyclist::cyclist,
    dice::Dice,
    footprint::Footprint,
    layout::streams,
    lorry::lorry,
    maths::rotation_z,
    motion::{EgoMotion, Motion},
    object::{Model, Object, Palette},
    road::Road,
    side_street::{HALF_WIDTH, SideStreet},
    traffic::EGO_HALF_LENGTH,
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
/// Length of the straight way before a turn (metres).
const APPROACH: f64 = 30.0;

/// A street that is being filled.
struct Filling<'a> {
    road: &'a Road,
    ego: &'a EgoMotion,
    end: f64,
    dice: Dice,
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
    let dice = Dice::new(config.seed, streams::BUSY);
    let mut filling = Filling { road, ego, end, dice, palette, objects };
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
    fn add(&mut self, track: String, model: Model, room: f64, draw: impl Fn(&Self, &mut Dice) -> Option<Course>) {
        let mut object = Object { track, model, course: Course::Street(Motion::still(0.0, 0.0, 0.0, 0.0)) };
        let mut dice = self.dice.clone();
        let found = (0..TRIES).any(|_| {
            let Some(course) = draw(self, &mut dice) else { return false };
            object.course = course;
            self.is_clear(&object, room)
        });
        self.dice = dice;
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
        match self.dice.index(10) {
            0 => lorry(&mut self.dice, self.palette),
            1 => truck(&mut self.dice, self.palette),
            _ => car(&mut self.dice, self.palette),
        }
    }

    fn queue(&mut self, number: usize) {
        let lane = self.dice.index(self.road.num_lanes);
        let direction = if self.dice.chance(0.6) { -1.0 } else { 1.0 };
        let pace = self.dice.uniform(0.7, 1.9);
        let mut s = self.dice.uniform(4.0, 12.0);
        for k in 0..number {
            let model = self.vehicle();
            let length = model.size.x;
            s += 0.5 * length;
            let own = pace * self.dice.uniform(0.85, 1.15);
            let before = self.objects.len();
            for _ in 0..12 {
                let course = self.lane(s, lane, direction, own);
                self.add(format!("queue-{k}"), model.clone(), ROOM, |_, _| Some(course.clone()));
                if self.objects.len() > before {
                    break;
                }
                s += 1.5;
            }
            s += 0.5 * length + self.dice.uniform(1.2, 3.0);
        }
    }

    fn lorries(&mut self, number: usize) {
        for k in 0..number {
            let model = lorry(&mut self.dice, self.palette);
            self.add(format!("lorry-{k}"), model, ROOM, |filling, dice| {
                let direction = if dice.chance(0.5) { -1.0 } else { 1.0 };
                let (s, lane) = (dice.uniform(-8.0, 48.0), dice.index(filling.road.num_lanes));
                Some(filling.lane(s, lane, direction, dice.uniform(1.0, 12.0)))
            });
        }
    }

    /// Across the street on the side street, in the middle of the clip at most 9 m from the street's middle line.
    fn crossing(&mut self, number: usize, side: SideStreet) {
        for k in 0..number {
            let model = self.vehicle();
            self.add(format!("crossing-{k}"), model, ROOM, |filling, dice| {
                let left = if dice.chance(0.5) { 1.0 } else { -1.0 };
                let frame = filling.road.frame(side.s + left * 0.5 * HALF_WIDTH, 0.0, 0.0);
                let speed = dice.uniform(1.5, 10.0);
                Some(filling.straight(frame, left, dice.uniform(-9.0, 9.0), speed))
            });
        }
    }

    /// Straight to the left (1) or right (-1) of a frame, `d` to its left in the middle of the clip.
    fn straight(&self, frame: Pose, left: f64, d: f64, speed: f64) -> Course {
        let start = frame * Pose::new(rotation_z(left * FRAC_PI_2), DVec3::ZERO);
        Course::Way(Way { start, pieces: Vec::new(), place: left * d - 0.5 * speed * self.end, speed })
    }

    /// From the street into the side street or back, somewhere in the turn in the middle of the clip.
    fn turning(&mut self, number: usize, side: SideStreet) {
        for k in 0..number {
            let model = if self.dice.chance(0.12) {
                truck(&mut self.dice, self.palette)
            } else {
                car(&mut self.dice, self.palette)
            };
            self.add(format!("turning-{k}"), model, ROOM, |filling, dice| Some(filling.turn(side, dice)));
        }
    }

    fn turn(&self, side: SideStreet, dice: &mut Dice) -> Course {
        let sign = |dice: &mut Dice| if dice.chance(0.5) { 1.0 } else { -1.0 };
        // Along the street and towards its left, each in (1) or against (-1) that direction, and the turn to the left (1) or right.
        let (turn, into) = (sign(dice), dice.chance(0.5));
        let entering = sign(dice);
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
            (false, ahead) => {
                if ahead {
                    FRAC_PI_2
                } else {
                    -FRAC_PI_2
                }
            }
        };
        let radius = if turn > 0.0 { dice.uniform(6.5, 9.0) } else { dice.uniform(4.2, 6.0) };
        let back = Pose::new(glam::DMat3::IDENTITY, DVec3::NEG_X * (radius + APPROACH));
        let arc = radius * FRAC_PI_2;
        let pieces = vec![Piece { length: APPROACH, curvature: 0.0 }, Piece { length: arc, curvature: turn / radius }];
        let speed = dice.uniform(2.0, 6.5);
        let place = APPROACH + arc * dice.uniform(0.1, 0.9) - 0.5 * speed * self.end;
        let start = corner * Pose::new(rotation_z(heading), DVec3::ZERO) * back;
        Course::Way(Way { start, pieces, place, speed })
    }

    fn cyclists(&mut self, number: usize) {
        for k in 0..number {
            let model = cyclist(&mut self.dice, self.palette);
            self.add(format!("cyclist-{k}"), model, CLOSE, |filling, dice| {
                let direction = if dice.chance(0.5) { -1.0 } else { 1.0 };
                let edge = filling.road.lane_width * filling.road.num_lanes as f64;
                Some(Course::Street(Motion {
                    s: dice.uniform(4.0, 36.0),
                    d: -direction * (edge - dice.uniform(0.1, 0.5)),
                    speed: direction * dice.uniform(2.0, 7.0),
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
            let model = person(&mut self.dice, self.palette);
            self.add(format!("walker-{k}"), model, CLOSE, |filling, dice| {
                let left = if dice.chance(0.5) { 1.0 } else { -1.0 };
                let (speed, kerb) = (dice.uniform(0.5, 1.8), filling.road.kerb_offset());
                let d = dice.uniform(-kerb, kerb);
                let reach = d.abs() + speed * (0.5 * filling.end + BEYOND_S) + 0.3;
                let frame = filling.road.frame(dice.uniform(7.0, 32.0), 0.0, 0.0);
                (reach < kerb).then(|| filling.straight(frame, left, d, speed))
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::scenes::{Scene, SceneConfig, Split, presets};

    fn objects(seed: u64) -> (SceneConfig, Scene) {
        let config = presets::traffic(Split::Traffic.seed(seed));
        (config.clone(), Scene::new(config).unwrap())
    }

    #[test]
    fn streets_hold_what_real_ones_have_and_nobody_meets_anybody() {
        let mut seen = std::collections::BTreeMap::new();
        for seed in 0..24 {
            let (config, scene) = objects(seed);
            let world = &scene.world;
            let end = config.frame_time(config.num_frames);
            for (k, a) in world.objects.iter().enumerate() {
                let kind = a.track.split('-').next().unwrap().to_owned();
                *seen.entry(kind).or_insert(0) += 1;
                assert!(world.objects[..k].iter().all(|b| b.track != a.track), "seed {seed}: track {}", a.track);
                let people = |category: &str| category == "pedestrian";
                for b in world.objects[..k].iter().filter(|b| !people(a.model.category) && !people(b.model.category)) {
                    for time in [0.0, 0.3 * end, 0.7 * end, end] {
                        let [at, other] = [a, b].map(|object| object.footprint(&world.ground.road, time));
                        assert!(!at.meets(&other), "seed {seed}: {} meets {}", a.track, b.track);
                    }
                }
            }
        }
        for kind in ["queue", "lorry", "crossing", "turning", "cyclist", "walker"] {
            assert!(seen.get(kind).is_some_and(|&number| number >= 8), "{kind}: {seen:?}");
        }
    }

    #[test]
    fn what_turns_changes_its_heading() {
        let mut turned = 0;
        for seed in 0..16 {
            let (config, scene) = objects(seed);
            let [first, last] = [0, config.num_frames - 1].map(|frame| scene.boxes(frame));
            for a in first.iter().filter(|a| a.track.starts_with("turning")) {
                let Some(b) = last.iter().find(|b| b.track == a.track) else { continue };
                let cosine = a.world_from_box.rotation().x_axis.dot(b.world_from_box.rotation().x_axis);
                turned += usize::from(cosine < 0.97);
            }
        }
        assert!(turned >= 6, "{turned} boxes turn by more than 14 degrees");
    }
}
