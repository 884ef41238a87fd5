//! What scenes with real traffic promise: returns, boxes and velocities that agree while things cross, turn and creep.

use glam::{DVec3, Vec3};
use lgs_formats::clip::TrackedBox;

use super::{
    Scene, SceneConfig, Split,
    config::Origin,
    maths::{narrow_mat, narrow3},
    presets,
    shapes::Ray,
};

/// Distance before a surface at which rays start again (metres).
const STEP: f32 = 0.05;

/// A street with traffic whose sweeps are exact, at the origin of its world.
fn exact(number: u64) -> SceneConfig {
    let mut config = presets::traffic(Split::TrafficTest.seed(number));
    config.origin = Origin { position: [0.0; 3], heading_deg: 0.0, time_s: 0.0 };
    config.box_reach_m = 500.0;
    let lidar = &mut config.rig.lidar;
    (lidar.num_beams, lidar.num_azimuths, lidar.range_noise_m) = (40, 700, 0.0);
    config
}

fn of_track<'a>(boxes: &'a [TrackedBox], track: &str) -> &'a TrackedBox {
    boxes.iter().find(|tracked| tracked.track == track).unwrap()
}

/// Largest excess of a point over the faces of a box, metres.
fn outside(tracked: &TrackedBox, point: DVec3) -> f64 {
    let local = tracked.world_from_box.inverse().transform_point(point);
    (local.abs() - DVec3::from_array(tracked.size) * 0.5).max_element()
}

#[test]
fn returns_moved_with_their_boxes_lie_on_the_thing_at_another_sweep() {
    let (mut on_it, mut all, mut turning) = (0, 0, 0);
    for number in 0..5 {
        let scene = Scene::new(exact(number)).unwrap();
        let (tracks, step) = (scene.tracks(), 1e-4);
        let [then, later] = [1, 5].map(|frame| scene.config().frame_time(frame));
        let [at, before, after, there] = [then, then - step, then + step, later].map(|time| scene.boxes_at(time));
        let moment = scene.world.at(later);
        let (pose, scan) = (scene.world_from_lidar(1), scene.scan(1));
        for (k, &point) in scan.sweep.points.iter().enumerate() {
            let Some(object) = scan.objects[k].filter(|&object| scene.world.objects[object as usize].is_mobile())
            else {
                continue;
            };
            let track = tracks[object as usize];
            let point = pose.transform_point(Vec3::from_array(point).as_dvec3());
            let tracked = of_track(&at, track);
            assert!(outside(tracked, point) < 0.02, "{track}: {} m outside", outside(tracked, point));
            let held = tracked.world_from_box.inverse().transform_point(point);
            let placed = |boxes: &[TrackedBox]| of_track(boxes, track).world_from_box.transform_point(held);
            let velocity = (placed(&after) - placed(&before)) / (2.0 * step);
            let told = Vec3::from_array(scan.velocities[k]).as_dvec3();
            assert!((velocity - told).length() < 0.01, "{track}: {velocity} against {told}");
            let turned =
                of_track(&there, track).world_from_box.rotation() * tracked.world_from_box.rotation().transpose();
            let direction = narrow_mat(turned) * narrow3((point - pose.translation()).normalize());
            let ray = Ray { origin: narrow3(placed(&there)) - direction * STEP, direction };
            let hit = moment.cast(&ray, 2.0 * STEP).filter(|hit| (hit.t - STEP).abs() < 0.005);
            on_it += usize::from(hit.is_some_and(|hit| moment.object(hit.target) == Some(object)));
            turning += usize::from(turned.x_axis.x < 0.97);
            all += 1;
        }
    }
    assert!(all > 2000 && turning > 100, "{all} returns, {turning} of them on what turns");
    assert!(on_it * 100 >= all * 99, "{on_it} of {all} returns lie on their thing four sweeps later");
}

#[test]
fn returns_of_a_sweep_that_takes_time_stand_where_their_things_were_then() {
    let (mut all, mut displaced) = (0, 0);
    for number in 0..3 {
        let mut config = exact(number);
        // It begins and ends ahead, where most of the traffic is.
        (config.rig.lidar.sweep_s, config.rig.lidar.azimuth_deg) = (0.1, [0.0, -360.0]);
        let scene = Scene::new(config).unwrap();
        let (tracks, pose, scan) = (scene.tracks(), scene.world_from_lidar(3), scene.scan(3));
        let times = scan.sweep.times.as_ref().unwrap();
        assert!(times.iter().all(|time| time.abs() < 0.05));
        assert!([-0.04, 0.04].iter().all(|&edge: &f32| times.iter().any(|time| (time - edge) * edge > 0.0)));
        let timestamp = scene.config().frame_time(3);
        let at_timestamp = scene.boxes_at(timestamp);
        let mut then: (f32, Vec<TrackedBox>) = (f32::NAN, Vec::new());
        for (k, &point) in scan.sweep.points.iter().enumerate() {
            let Some(object) = scan.objects[k].filter(|&object| scene.world.objects[object as usize].is_mobile())
            else {
                continue;
            };
            if then.0 != times[k] {
                then = (times[k], scene.boxes_at(timestamp + f64::from(times[k])));
            }
            let track = tracks[object as usize];
            let point = pose.transform_point(Vec3::from_array(point).as_dvec3());
            let over = outside(of_track(&then.1, track), point);
            assert!(over < 0.02, "{track}: {over} m outside");
            displaced += usize::from(outside(of_track(&at_timestamp, track), point) > 0.05);
            all += 1;
        }
    }
    assert!(all > 1000 && displaced > 50, "{displaced} of {all} returns are off their boxes of the sweep's timestamp");
}

#[test]
fn cameras_are_off_the_time_of_the_sweep() {
    for number in 0..20 {
        let config = presets::traffic(Split::Traffic.seed(number));
        assert!(config.rig.cameras.iter().all(|camera| (0.02..=0.1).contains(&camera.delay_s.abs())));
    }
}
