//! Sweeps of a made street: what moves is told from what stands.

use super::{own_vehicle, registered, sweeps};
use crate::points::PointCloud;

/// A box that stands along the axes.
#[derive(Clone, Copy)]
struct Thing {
    low: [f64; 3],
    high: [f64; 3],
    velocity: [f64; 2],
}

impl Thing {
    const fn new(low: [f64; 3], high: [f64; 3]) -> Self {
        Self { low, high, velocity: [0.0; 2] }
    }

    /// Distance at which a ray meets it at a moment, metres.
    fn hit(&self, origin: [f64; 3], direction: [f64; 3], time: f64) -> Option<f64> {
        let (mut near, mut far) = (0.0_f64, f64::INFINITY);
        for k in 0..3 {
            let moved = if k < 2 { self.velocity[k] * time } else { 0.0 };
            let ends = [self.low[k], self.high[k]].map(|end| (end + moved - origin[k]) / direction[k]);
            near = near.max(ends[0].min(ends[1]));
            far = far.min(ends[0].max(ends[1]));
        }
        (near > 0.0 && near <= far).then_some(near)
    }
}

/// Index of the ground.
const GROUND: usize = 2;

/// A wall beside the road, poles before it, and a parked car.
fn street() -> Vec<Thing> {
    let mut things = vec![
        Thing::new([-30.0, 9.0, -2.0], [60.0, 10.0, 4.0]),
        Thing::new([14.0, -5.5, -1.6], [18.4, -3.7, -0.2]),
        Thing::new([-80.0, -80.0, -3.0], [80.0, 80.0, -1.8]),
    ];
    for k in 0..6 {
        let x = -15.0 + 9.0 * f64::from(k);
        things.push(Thing::new([x, 7.0, -1.8], [x + 0.2, 7.2, 3.0]));
    }
    things
}

/// A car that comes along the other lane.
const fn car(velocity: [f64; 2]) -> Thing {
    Thing { low: [10.0, 2.6, -1.6], high: [14.3, 4.4, -0.2], velocity }
}

/// Sweeps and where they were taken from, and which return is of which thing.
struct Sweeps {
    cloud: PointCloud,
    hits: Vec<usize>,
}

#[expect(clippy::cast_possible_truncation, reason = "points are f32")]
fn scan(things: &[Thing], times: &[f64]) -> Sweeps {
    let mut sweeps = Sweeps { cloud: PointCloud::default(), hits: Vec::new() };
    for (frame, &time) in (0_u32..).zip(times) {
        let origin = [5.0 * time, 0.0, 0.0];
        for beam in 0..40 {
            for azimuth in 0..900 {
                // Sweeps do not meet the same places twice.
                let turn = (f64::from(azimuth) + 0.37 * f64::from(frame)) * 0.4_f64.to_radians();
                let tilt = (-22.0 + 0.65 * f64::from(beam)).to_radians();
                let direction = [turn.cos() * tilt.cos(), turn.sin() * tilt.cos(), tilt.sin()];
                let hits =
                    things.iter().enumerate().filter_map(|(i, thing)| Some((i, thing.hit(origin, direction, time)?)));
                let Some((thing, range)) = hits.min_by(|a, b| a.1.total_cmp(&b.1)).filter(|hit| hit.1 < 75.0) else {
                    continue;
                };
                sweeps.cloud.positions.push([0, 1, 2].map(|k| (origin[k] + range * direction[k]) as f32));
                sweeps.cloud.times.push(time as f32);
                sweeps.cloud.frames.push(frame);
                sweeps.cloud.origins.push(origin.map(|v| v as f32));
                sweeps.hits.push(thing);
            }
        }
    }
    sweeps
}

impl Sweeps {
    /// Fails unless four in five returns of thing `moving` have nearly its velocity (without images its sides may slide along themselves), and
    /// all others none.
    fn check(&self, moving: Option<(usize, [f32; 2])>) {
        let found = registered(&self.cloud, &[]).velocities;
        let (mut right, mut count) = (0, 0);
        for (i, [x, y, z]) in found.into_iter().enumerate() {
            match moving {
                Some((thing, [a, b])) if self.hits[i] == thing => {
                    count += 1;
                    right += usize::from((x - a).abs() < 0.5 && (y - b).abs() < 0.5 && z == 0.0);
                }
                // The ground under a thing, where its shadow is, goes with it.
                Some(_) if self.hits[i] == GROUND => {}
                _ => assert_eq!([x, y, z], [0.0; 3], "thing {} at {:?}", self.hits[i], self.cloud.positions[i]),
            }
        }
        assert!(right * 5 >= count * 4, "{right} of {count} returns");
        assert!(moving.is_none() || count > 300, "{count} returns");
    }
}

const TIMES: [f64; 4] = [0.0, 0.1, 0.2, 0.3];

#[test]
fn a_car_that_passes_a_wall_and_poles_moves_and_nothing_else_does() {
    for velocity in [[-8.0, 0.0], [3.0, 0.0], [-17.0, 0.5]] {
        let things = [street(), vec![car(velocity)]].concat();
        scan(&things, &TIMES).check(Some((things.len() - 1, velocity.map(lgs_formats::casts::to_f32))));
    }
}

#[test]
fn a_parked_car_and_a_long_wall_stand_still() {
    scan(&[street(), vec![car([0.0; 2])]].concat(), &TIMES).check(None);
    scan(&street()[..3], &TIMES).check(None);
}

#[test]
fn a_car_crosses_between_a_pole_and_a_kerb() {
    let kerb = Thing::new([5.0, -8.0, -1.8], [9.9, 4.0, -1.4]);
    let pole = Thing::new([13.0, -0.6, -1.8], [13.2, -0.4, 3.0]);
    let crossing = Thing { low: [10.5, -7.0, -1.6], high: [12.4, -2.7, -0.2], velocity: [0.0, 9.0] };
    let things = [street(), vec![kerb, pole, crossing]].concat();
    scan(&things, &[0.0, 0.2, 0.4]).check(Some((things.len() - 1, [0.0, 9.0])));
}

#[test]
fn a_lorry_with_a_trailer_moves_at_walking_pace_as_one() {
    let lorry = Thing { low: [4.0, 2.4, -1.3], high: [21.0, 4.9, 2.0], velocity: [1.7, 0.0] };
    let things = [street(), vec![lorry]].concat();
    scan(&things, &[0.0, 0.2, 0.4]).check(Some((things.len() - 1, [1.7, 0.0])));
}

#[test]
fn two_sweeps_are_enough() {
    let things = [street(), vec![car([-8.0, 0.0])]].concat();
    scan(&things, &[0.0, 0.2]).check(Some((things.len() - 1, [-8.0, 0.0])));
}

#[test]
fn where_nothing_can_be_told_nothing_moves() {
    let things = [street(), vec![car([-8.0, 0.0])]].concat();
    for times in [&[][..], &[0.0], &[0.0, 0.0, 0.0], &[0.0, 50.0], &[0.0, 1e300]] {
        scan(&things, times).check(None);
    }
    let mut sweeps = scan(&things, &[0.0, 0.2]);
    sweeps.cloud.times.fill(f32::NAN);
    sweeps.check(None);
}

#[test]
fn coincident_and_far_returns_do_no_harm() {
    let mut cloud = PointCloud::default();
    for i in 0..200_000_u32 {
        let far = if i % 4 < 2 { 0.0 } else { 1e5 * (i % 7) as f32 };
        cloud.positions.push([far, -far, 0.5]);
        cloud.frames.push(u32::from(i >= 100_000));
        cloud.times.push(if i >= 100_000 { 0.1 } else { 0.0 });
    }
    for far in [[0.0; 3], [1e6, -1e6, 1e6]] {
        cloud.origins = cloud.frames.iter().map(|&frame| if frame == 0 { [0.0; 3] } else { far }).collect();
        assert!(registered(&cloud, &[]).velocities.iter().all(|v| *v == [0.0; 3]));
    }
}

#[test]
fn threads_do_not_matter() {
    let things = [street(), vec![car([-8.0, 0.0])]].concat();
    let sweeps = scan(&things, &TIMES);
    let [one, three] = [1, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| registered(&sweeps.cloud, &[]).velocities)
    });
    assert!(one.iter().any(|v| *v != [0.0; 3]));
    assert_eq!(one, three);
}

/// Sweeps from a sensor that drives at 5 m/s, 0.2 s apart, with a bonnet before it; and which returns are of the bonnet.
fn with_bonnet(things: &[Thing]) -> (PointCloud, Vec<usize>) {
    let times = [0.0_f32, 0.2, 0.4];
    let seen = scan(things, &times.map(f64::from)).cloud;
    let (mut cloud, mut bonnet) = (PointCloud::default(), Vec::new());
    for (frame, time) in (0_u32..).zip(times) {
        let of_sweep = |&point: &usize| seen.frames[point] == frame;
        cloud.positions.extend((0..seen.len()).filter(of_sweep).map(|point| seen.positions[point]));
        bonnet.extend(cloud.len()..cloud.len() + 60);
        let along = 5.0 * time;
        cloud.positions.extend((0..60_u16).map(|k| [along + 1.2 + 0.02 * f32::from(k), 0.3, -0.9]));
        cloud.origins.resize(cloud.positions.len(), [along, 0.0, 0.0]);
        cloud.times.resize(cloud.positions.len(), time);
        cloud.frames.resize(cloud.positions.len(), frame);
    }
    (cloud, bonnet)
}

#[test]
fn returns_of_the_own_vehicle_go_with_it_and_a_wall_beside_it_does_not() {
    let (cloud, bonnet) = with_bonnet(&street());
    for (i, [x, y, _]) in registered(&cloud, &[]).velocities.into_iter().enumerate() {
        let want = if bonnet.contains(&i) { 5.0 } else { 0.0 };
        assert!((x - want).abs() < 0.01 && y.abs() < 0.01, "{x} {y} instead of {want} at {:?}", cloud.positions[i]);
    }
}

/// Its side is hit at the same places beside the sensor again, as the vehicle is.
#[test]
fn a_car_parked_beside_the_own_vehicle_is_not_of_it() {
    let parked = Thing::new([-1.5, 2.0, -1.6], [3.0, 3.8, -0.2]);
    let (cloud, bonnet) = with_bonnet(&[street(), vec![parked]].concat());
    let starts = [0, 1, 2, 3].map(|frame| cloud.frames.partition_point(|&other| other < frame));
    let runs: Vec<_> = starts.windows(2).map(|ends| ends[0]..ends[1]).collect();
    let own = own_vehicle::own(&cloud, &runs, &sweeps::prepare(&cloud, &runs));
    assert_eq!(own.iter().flat_map(|own| own.returns.clone()).collect::<Vec<_>>(), bonnet);
}
