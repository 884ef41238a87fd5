//! Who drives, walks and parks: motions that never meet.

use std::f64::consts::PI;

use super::{
    busy,
    config::SceneConfig,
    course::Course,
    motion::{EGO_HALF_LENGTH, EgoMotion, Motion},
    object::{Object, Palette},
    rng::Rng,
    road::Road,
    streams, vehicles,
};

/// Room that drivers keep to the next vehicle of their lane (metres).
const GAP: f64 = 3.5;

/// Fastest speed that accelerating cars reach, m/s.
const TOP_SPEED: f64 = 20.0;

/// All traffic of a street.
#[derive(Debug)]
pub(crate) struct Traffic {
    pub(crate) ego: EgoMotion,
    pub(crate) objects: Vec<Object>,
}

impl Traffic {
    /// The traffic of a configuration that is valid.
    pub(crate) fn new(config: &SceneConfig, road: &Road, crossings: &[f64], palette: &mut Palette) -> Self {
        let mut rng = Rng::new(config.seed, streams::TRAFFIC);
        let ego = ego(config, road, &mut rng);
        let mut objects = Vec::new();
        drive(config, road, &ego, &mut rng, palette, &mut objects);
        walk(config, road, &mut rng, palette, &mut objects);
        park(config, road, crossings, palette, &mut objects);
        if let Some(spec) = &config.traffic.busy {
            busy::join(config, spec, road, &ego, palette, &mut objects);
        }
        Self { ego, objects }
    }
}

fn ego(config: &SceneConfig, road: &Road, rng: &mut Rng) -> EgoMotion {
    let lane = rng.index(road.num_lanes);
    let motion = Motion {
        s: 0.0,
        d: -(lane as f64 + 0.5) * road.lane_width,
        speed: config.traffic.ego_speed,
        acceleration: 0.0,
        heading: 0.0,
        height: 0.0,
    };
    let moves = if config.traffic.ego_speed > 0.0 { 1.0 } else { 0.0 };
    EgoMotion {
        motion,
        nod: [moves * rng.uniform(0.0, 0.006), rng.uniform(3.0, 7.0)],
        sway: [moves * rng.uniform(0.0, 0.08), rng.uniform(0.5, 1.5)],
    }
}

/// A thing in a lane, and its length in metres.
struct Moving {
    motion: Motion,
    length: f64,
}

/// Whether two things of one lane keep [`GAP`] through the clip.
fn keep_apart(config: &SceneConfig, road: &Road, a: &Moving, b: &Moving) -> bool {
    let end = config.frame_time(config.num_frames);
    (0..=20).all(|k| {
        let time = end * f64::from(k) / 20.0;
        (a.motion.place(road, time) - b.motion.place(road, time)).abs() > 0.5 * (a.length + b.length) + GAP
    })
}

/// The motion without its acceleration where that would turn it round or make it race before `end` (seconds).
fn steady(motion: Motion, end: f64) -> Motion {
    let last = (motion.speed + motion.acceleration * end) * motion.speed.signum();
    if (0.0..=TOP_SPEED).contains(&last) { motion } else { Motion { acceleration: 0.0, ..motion } }
}

fn drive(
    config: &SceneConfig,
    road: &Road,
    ego: &EgoMotion,
    rng: &mut Rng,
    palette: &mut Palette,
    objects: &mut Vec<Object>,
) {
    let [low, high] = config.traffic.speeds;
    for k in 0..config.traffic.num_cars {
        let truck = rng.chance(0.15);
        let model = if truck { vehicles::truck(rng, palette) } else { vehicles::car(rng, palette) };
        let length = model.size.x;
        // The first two are in sight at once: one ahead, one coming.
        let oncoming = if k < 2 { k == 1 } else { rng.chance(0.55) };
        let reach = if k < 2 { [9.0, 32.0] } else { [-30.0, 90.0] };
        let free = (0..40).find_map(|_| {
            let lane = (rng.index(road.num_lanes) as f64 + 0.5) * road.lane_width;
            let speed = rng.uniform(low, high);
            let motion = Motion {
                s: rng.uniform(reach[0], reach[1]),
                d: if oncoming { lane } else { -lane } + rng.uniform(-0.15, 0.15),
                speed: if oncoming { -speed } else { speed },
                acceleration: if rng.chance(0.4) { rng.uniform(-0.8, 0.8) } else { 0.0 },
                heading: if oncoming { PI } else { 0.0 },
                height: 0.0,
            };
            let motion = steady(motion, config.frame_time(config.num_frames));
            let same_lane = |d: f64| (d - motion.d).abs() < 0.7 * road.lane_width;
            let moving = |other: &Object| Some(Moving { motion: *other.course.street()?, length: other.model.size.x });
            let others = objects.iter().filter_map(moving);
            let clear = others
                .chain([Moving { motion: ego.motion, length: 2.0 * EGO_HALF_LENGTH }])
                .filter(|other| same_lane(other.motion.d))
                .all(|other| keep_apart(config, road, &Moving { motion, length }, &other));
            clear.then_some(motion)
        });
        if let Some(motion) = free {
            objects.push(Object { track: format!("{}-{k}", model.category), model, course: Course::Street(motion) });
        }
    }
}

fn walk(config: &SceneConfig, road: &Road, rng: &mut Rng, palette: &mut Palette, objects: &mut Vec<Object>) {
    for k in 0..config.traffic.num_people {
        let side = if rng.chance(0.5) { 1.0 } else { -1.0 };
        let room = [(0.55 * road.pavement_width).min(1.5), (road.pavement_width - 0.9).max(0.9)];
        let backwards = rng.chance(0.5);
        let pace = if rng.chance(0.2) { 0.0 } else { rng.uniform(1.1, 1.8) };
        let motion = Motion {
            s: rng.uniform(6.0, 45.0),
            d: side * (road.kerb_offset() + rng.uniform(room[0].min(room[1]), room[1])),
            speed: if backwards { -pace } else { pace },
            acceleration: 0.0,
            heading: if backwards { PI } else { 0.0 },
            height: road.kerb_height,
        };
        let model = vehicles::person(rng, palette);
        objects.push(Object { track: format!("{}-{k}", model.category), model, course: Course::Street(motion) });
    }
}

fn park(config: &SceneConfig, road: &Road, crossings: &[f64], palette: &mut Palette, objects: &mut Vec<Object>) {
    if !config.street.parking {
        return;
    }
    let mut rng = Rng::new(config.seed, streams::PARKED);
    for side in [1.0, -1.0] {
        for slot in -10..26 {
            // The bars of the parking slots are painted 0.6 m before every sixth metre.
            let s = f64::from(slot) * 6.0 + 2.45 + rng.uniform(-0.3, 0.3);
            let free = crossings.iter().all(|&at| (s - at).abs() > 6.5);
            if !free || !rng.chance(config.traffic.parked) {
                continue;
            }
            let model = vehicles::car(&mut rng, palette);
            let d = side * (road.kerb_offset() - 1.15 + rng.uniform(-0.08, 0.08));
            let turned = if (side > 0.0) != rng.chance(0.1) { PI } else { 0.0 };
            let motion = Motion::still(s, d, turned + rng.uniform(-0.035, 0.035), 0.0);
            let which = if side > 0.0 { "left" } else { "right" };
            objects.push(Object { track: format!("parked-{which}{slot}"), model, course: Course::Street(motion) });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenes::presets;

    #[test]
    fn nobody_turns_round() {
        let braking = Motion { speed: 4.0, acceleration: -0.5, ..Motion::still(0.0, 0.0, 0.0, 0.0) };
        assert_eq!(steady(braking, 5.0), braking);
        assert_eq!(steady(braking, 15.0).acceleration, 0.0);
        let oncoming = Motion { speed: -4.0, acceleration: -0.5, ..braking };
        assert_eq!(steady(oncoming, 15.0), oncoming);
        assert_eq!(steady(oncoming, 40.0).acceleration, 0.0);
    }

    #[test]
    fn nobody_collides_and_somebody_moves() {
        let mut moving = 0;
        for seed in 0..30 {
            let config = presets::varied(seed);
            let road = crate::scenes::road::tests::example(config.street.curvature);
            let traffic = Traffic::new(&config, &road, &[], &mut Palette::default());
            for (k, a) in traffic.objects.iter().enumerate() {
                assert!(traffic.objects[..k].iter().all(|b| b.track != a.track), "seed {seed}: track {}", a.track);
                for b in &traffic.objects[..k] {
                    let [am, bm] = [a, b].map(|object| *object.course.street().unwrap());
                    let short = |object: &Object, motion| Moving { motion, length: object.model.size.x - GAP };
                    let clear = (am.d - bm.d).abs() > 0.5 * (a.model.size.y + b.model.size.y) - 0.2
                        || keep_apart(&config, &road, &short(a, am), &short(b, bm));
                    let people = a.model.category == "pedestrian" || b.model.category == "pedestrian";
                    assert!(clear || people, "seed {seed}: {} and {}", a.track, b.track);
                }
                moving += usize::from(a.is_moving(0.0));
            }
        }
        assert!(moving > 30, "{moving}");
    }
}
