//! What every scene promises: the same bytes again, sensors that agree, truth that fits.

use glam::{DVec3, Vec3};
use lgs_formats::{clip::TrackedBox, clip_dir::ClipDir, image::PixelLabel, sweep::Sweep};

use super::{
    config::{Origin, SceneConfig},
    depth_map::DepthMaps,
    export::{self, Export, ImageFormat},
    presets,
    scene::Scene,
};

/// A small scene whose sensors take exact data at the same moments.
fn exact(seed: u64) -> SceneConfig {
    let mut config = presets::street_clip(seed);
    config.num_frames = 3;
    config.traffic.num_cars = 5;
    config.rig.lidar.range_noise_m = 0.0;
    config.rig.lidar.num_beams = 24;
    for camera in &mut config.rig.cameras {
        (camera.height, camera.width, camera.delay_s) = (72, 120, 0.0);
    }
    config
}

fn in_pool<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work)
}

/// Largest excess of a point over the faces of a box, metres.
fn outside(tracked: &TrackedBox, point: DVec3) -> f64 {
    let local = tracked.world_from_box.inverse().transform_point(point);
    (local.abs() - DVec3::from_array(tracked.size) * 0.5).max_element()
}

#[test]
fn threads_do_not_change_a_bit() {
    let make = |threads| {
        in_pool(threads, || {
            let scene = Scene::new(presets::street_clip(4)).unwrap();
            (scene.capture(1, 0), scene.scan(1), scene.boxes(1))
        })
    };
    assert!(make(1) == make(2));
}

#[test]
fn seeds_differ() {
    let make = |seed| {
        let scene = Scene::new(exact(seed)).unwrap();
        (scene.capture(0, 0).rgb, scene.scan(0).sweep)
    };
    let [a, b] = [make(1), make(2)];
    assert_ne!(a.0, b.0);
    assert_ne!(a.1, b.1);
}

#[test]
fn lidar_points_lie_on_what_cameras_see() {
    for seed in [1, 2, 3] {
        let mut config = exact(seed);
        (config.rig.cameras[0].height, config.rig.cameras[0].width) = (240, 400);
        let scene = Scene::new(config).unwrap();
        let (camera, capture) = (scene.camera(1, 0), scene.capture(1, 0));
        let Sweep { points, .. } = scene.scan(1).sweep;
        let camera_from_lidar = camera.world_from_camera.inverse() * scene.world_from_lidar(1);
        let (width, height) = (capture.rgb.width, capture.rgb.height);
        let f = camera.intrinsics;
        let mut errors = Vec::new();
        for p in points
            .iter()
            .map(|&p| camera_from_lidar.transform_point(Vec3::from_array(p).as_dvec3()))
            .filter(|p| p.z > 0.5)
        {
            let (x, y) = (f.fx * p.x / p.z + f.cx, f.fy * p.y / p.z + f.cy);
            if x >= 0.0 && y >= 0.0 && x < width as f64 && y < height as f64 {
                let pixel = super::maths::count(y) * width + super::maths::count(x);
                errors.push((f64::from(capture.depth[pixel]) - p.z).abs() / p.z);
            }
        }
        errors.sort_by(f64::total_cmp);
        assert!(errors.len() > 300, "{} points in view", errors.len());
        let (median, ninth) = (errors[errors.len() / 2], errors[errors.len() * 8 / 10]);
        assert!(median < 0.005 && ninth < 0.1, "seed {seed}: relative errors {median} in the middle, {ninth} at 80 %");
    }
}

#[test]
fn boxes_hold_the_points_of_their_objects() {
    let mut moving_points = 0;
    for seed in [1, 2, 3] {
        let scene = Scene::new(SceneConfig { box_reach_m: 200.0, ..exact(seed) }).unwrap();
        let tracks = scene.tracks();
        for frame in [0, 2] {
            let (scan, boxes, pose) = (scene.scan(frame), scene.boxes(frame), scene.world_from_lidar(frame));
            for (k, &point) in scan.sweep.points.iter().enumerate() {
                let Some(object) = scan.objects[k] else { continue };
                let tracked = boxes.iter().find(|b| b.track == tracks[object as usize]).unwrap();
                let point = pose.transform_point(Vec3::from_array(point).as_dvec3());
                assert!(outside(tracked, point) < 0.02, "{}: {} m outside", tracked.track, outside(tracked, point));
                moving_points += usize::from(Vec3::from_array(scan.velocities[k]).length() > 1.0);
            }
        }
    }
    assert!(moving_points > 100, "{moving_points} points on moving things");
}

#[test]
fn masks_and_velocities_agree_with_boxes() {
    let mut dynamic = 0;
    for seed in [1, 2, 3] {
        let config = SceneConfig { box_reach_m: 300.0, frame_interval_s: 0.01, ..exact(seed) };
        let scene = Scene::new(config).unwrap();
        let (camera, capture) = (scene.camera(1, 0), scene.capture(1, 0));
        let [before, boxes, after] = [0, 1, 2].map(|frame| scene.boxes(frame));
        let f = camera.intrinsics;
        for (k, label) in capture.labels.iter().enumerate() {
            let velocity = Vec3::from_array(capture.velocity[k]).as_dvec3();
            assert_eq!(*label == PixelLabel::Dynamic, velocity.length() > 1.0);
            if *label == PixelLabel::Static {
                continue;
            }
            dynamic += 1;
            let z = f64::from(capture.depth[k]);
            let (x, y) = ((k % capture.rgb.width) as f64 + 0.5, (k / capture.rgb.width) as f64 + 0.5);
            let local = DVec3::new((x - f.cx) / f.fx * z, (y - f.cy) / f.fy * z, z);
            let point = camera.world_from_camera.transform_point(local);
            let b = boxes.iter().find(|b| outside(b, point) < 0.03).unwrap();
            // The box carries the point from the frame before to the frame after.
            let held = b.world_from_box.inverse().transform_point(point);
            let at = |all: &[TrackedBox]| {
                all.iter().find(|other| other.track == b.track).unwrap().world_from_box.transform_point(held)
            };
            let moved = (at(&after) - at(&before)) / 0.02;
            assert!((moved - velocity).length() < 0.01, "{}: {moved} against {velocity}", b.track);
        }
    }
    assert!(dynamic > 200, "{dynamic} dynamic pixels");
}

#[test]
fn large_origins_change_numbers_and_nothing_else() {
    let far = Origin { position: [456_789.5, 5_432_100.25, 300.0], heading_deg: 40.0, time_s: 1.65e9 };
    let [near, far] = [exact(1), SceneConfig { origin: far, ..exact(1) }].map(|config| Scene::new(config).unwrap());
    assert!(near.capture(1, 0).rgb == far.capture(1, 0).rgb);
    assert!(near.scan(1).sweep == far.scan(1).sweep);
    let relative = |scene: &Scene| {
        let pose = scene.world_from_lidar(0).inverse() * scene.camera(2, 1).world_from_camera;
        (pose.translation(), pose.rotation().z_axis)
    };
    let [(at, looking), (far_at, far_looking)] = [relative(&near), relative(&far)];
    assert!((at - far_at).length() < 1e-6 && (looking - far_looking).length() < 1e-9);
    assert!((far.lidar_timestamp(2) - far.lidar_timestamp(0) - 0.2).abs() < 1e-6);
}

#[test]
fn exported_clips_are_read_back_and_full_directories_are_refused() {
    let out = tempfile::tempdir().unwrap();
    let dir = out.path().join("clips/one");
    let scene = Scene::new(exact(1)).unwrap();
    let options =
        Export { name: "one".to_owned(), images: ImageFormat::Jpeg(90), masks: true, depth: Some(DepthMaps::Metric) };
    let written = export::write(&scene, &dir, &options, &|| ()).unwrap();
    assert_eq!((written.frames, written.images), (3, 6));
    let read = ClipDir::open(&dir).unwrap();
    assert_eq!(read.clip().frames.len(), 3);
    assert_eq!(read.load_sweep(1).unwrap(), scene.scan(1).sweep);
    let image = read.load_image(1, 0, None).unwrap();
    assert_eq!(image.labels.unwrap(), scene.capture(1, 0).labels);
    let depth = read.load_depth(1, 0, None).unwrap().unwrap().inverse;
    assert!(depth.iter().zip(scene.capture(1, 0).depth).all(|(w, metres)| *w == 1.0 / metres));
    let truth = scene.capture(1, 0).rgb;
    let mean = truth.data.iter().zip(&image.rgb.data).map(|(a, b)| f64::from((a - b).abs())).sum::<f64>()
        / truth.data.len() as f64;
    assert!(mean < 0.02, "mean difference {mean}");
    assert_eq!(read.clip().frames[2].cameras[1].camera, scene.camera(2, 1));
    assert_eq!(read.clip().frames[2].boxes.as_deref().unwrap(), scene.boxes(2));
    let refused = export::write(&scene, &dir, &options, &|| ()).unwrap_err().to_string();
    assert!(refused.contains("one: expected a directory that does not exist or is empty"), "{refused}");
    assert_eq!(std::fs::read_dir(out.path().join("clips")).unwrap().count(), 1, "something was left beside the clip");
}
