//! What a clip says of single returns: times, several sensors, the motion within a sweep.

use super::*;
use crate::{
    clip::{Compensation, ReturnsRecord, SensorsRecord},
    returns::{write_sensors, write_times},
};

const TIMES: [f32; 5] = [-0.05, -0.02, 0.0, 0.03, 0.05];
/// Where two sensors sit on the LiDAR's frame.
const MOUNTS: [f64; 2] = [0.0, 2.0];

/// A car that drives 20 m/s along the x axis of its first sweep and turns to the left.
fn drive(time: f64) -> Pose {
    Pose::new(DMat3::from_rotation_z(0.5 * time), DVec3::new(20.0 * time, 0.0, 1.0))
}

/// Five things that stand.
fn standing(index: usize) -> DVec3 {
    DVec3::new(10.0 + index as f64, 3.0 - 2.0 * index as f64, 0.5)
}

#[expect(clippy::cast_possible_truncation, reason = "rounding to single precision is the purpose")]
fn narrow(point: DVec3) -> [f32; 3] {
    point.to_array().map(|value| value as f32)
}

/// The fixture with the car's poses and with times, and everything as `compensation` says.
fn swept(compensation: Compensation) -> Fixture {
    let mut fixture = Fixture::new();
    for (index, frame) in fixture.clip.frames.iter_mut().enumerate() {
        let start = 0.1 * index as f64;
        frame.lidar.world_from_lidar = drive(start);
        let point = |k: usize| {
            let moment = match compensation {
                Compensation::To(to) => start + to,
                Compensation::None => start + f64::from(TIMES[k]),
            };
            narrow(drive(moment).inverse().transform_point(standing(k)))
        };
        let sweep = Sweep { points: (0..5).map(point).collect(), intensities: vec![0.5; 5], ..Sweep::default() };
        let named = |ending: &str| PathBuf::from(format!("{index}.{ending}"));
        let poses = MOUNTS.map(|x| Pose::new(DMat3::from_rotation_z(1.0), DVec3::new(x, 0.0, 0.0)));
        frame.lidar.returns = ReturnsRecord {
            times: Some(named("times")),
            compensation,
            sensors: Some(SensorsRecord { file: named("sensors"), lidar_from_sensor: poses.to_vec() }),
        };
        let root = fixture.dir.path();
        write_sweep(&root.join(&frame.lidar.file), &sweep).unwrap();
        write_times(&root.join(named("times")), &TIMES).unwrap();
        write_sensors(&root.join(named("sensors")), &[0, 1, 0, 1, 0]).unwrap();
    }
    write_clip(fixture.dir.path(), &fixture.clip).unwrap();
    fixture
}

#[test]
fn returns_are_where_they_are_from_the_place_at_the_timestamp() {
    for compensation in [Compensation::None, Compensation::To(0.0), Compensation::To(-0.05), Compensation::To(0.05)] {
        let fixture = swept(compensation);
        let dir = ClipDir::open(fixture.dir.path()).unwrap();
        assert_eq!(dir.clip(), &fixture.clip);
        for index in 0..2 {
            let (sweep, start) = (dir.load_sweep(index).unwrap(), 0.1 * index as f64);
            assert_eq!(sweep.times.as_deref(), Some(&TIMES[..]));
            assert_eq!(sweep.sensors.as_deref(), Some(&[0, 1, 0, 1, 0][..]));
            let origins = sweep.origins.unwrap();
            for k in 0..5 {
                let found = drive(start).transform_point(DVec3::from(sweep.points[k].map(f64::from)));
                assert!(found.distance(standing(k)) < 1e-5, "{compensation:?} {index} {k}: {found}");
                // A sensor two metres ahead of the LiDAR, where the car is at that time.
                let sensor = DVec3::new(MOUNTS[k % 2], 0.0, 0.0);
                let want = drive(start + f64::from(TIMES[k])).transform_point(sensor);
                let found = drive(start).transform_point(DVec3::from(origins[k].map(f64::from)));
                assert!(found.distance(want) < 1e-5, "{compensation:?} {index} {k}: from {found}, want {want}");
            }
        }
    }
}

#[test]
fn without_the_keys_nothing_is_known_and_nothing_moves() {
    let fixture = Fixture::new();
    let text = std::fs::read_to_string(fixture.path(CLIP_FILE)).unwrap();
    assert!(!["\"times\"", "motion_compensated", "sensors"].iter().any(|key| text.contains(key)));
    let sweep = ClipDir::open(fixture.dir.path()).unwrap().load_sweep(0).unwrap();
    assert_eq!((sweep.times, sweep.sensors, sweep.origins), (None, None, None));
}

#[test]
fn a_lone_sweep_stands() {
    let mut fixture = swept(Compensation::None);
    fixture.clip.frames.truncate(1);
    write_clip(fixture.dir.path(), &fixture.clip).unwrap();
    let sweep = ClipDir::open(fixture.dir.path()).unwrap().load_sweep(0).unwrap();
    let want = |k: usize| narrow(drive(f64::from(TIMES[k])).inverse().transform_point(standing(k)));
    assert_eq!(sweep.points, (0..5).map(want).collect::<Vec<_>>());
}

#[test]
fn what_is_wrong_is_named() {
    let lidar = "/frames/1/lidar";
    let identity = json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]);
    let far = json!([[1, 0, 0, 101], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]);
    let sensors = |poses: Value| json!({ "file": "1.sensors", "lidar_from_sensor": poses });
    let cases = [
        ("times", json!("../1.times"), "frames[1].lidar.times: expected a relative path"),
        ("times", json!("2.times"), "frames[1].lidar.times: expected a file that exists, found `2.times`: No"),
        ("times", json!("1.bin"), "1.bin: file size: expected 20 bytes (4 for each of 5 returns), found 80 bytes"),
        ("times", Value::Null, "frames[1].lidar.motion_compensated: expected `times` beside false, found none"),
        ("motion_compensated", json!(true), "motion_compensated: expected false or {\"to\": seconds"),
        ("motion_compensated", json!("no"), "motion_compensated (line"),
        ("motion_compensated", json!({ "to": 0, "from": 0 }), "expected `false` or {\"to\": seconds since"),
        ("motion_compensated", json!({ "to": 2 }), "motion_compensated.to: expected seconds within 1, found 2"),
        ("sensors", sensors(json!([])), "sensors.lidar_from_sensor: expected 1 to 256 poses, found 0"),
        ("sensors", sensors(json!([identity, [[1]]])), "sensors.lidar_from_sensor[1]"),
        (
            "sensors",
            sensors(json!([far])),
            "lidar_from_sensor[0]: expected a sensor within 100 m of the LiDAR, found 101",
        ),
        ("sensors", json!({ "file": "1.sensors" }), "missing field `lidar_from_sensor`"),
    ];
    for (key, value, expected) in cases {
        let message = swept(Compensation::None).message_with(&format!("{lidar}/{key}"), Some(value));
        assert!(message.contains(expected), "{key}: {message}\nwant {expected}");
    }
}

#[test]
fn values_that_are_wrong_are_named_by_their_return() {
    let message = |damage: &dyn Fn(&Fixture)| {
        let fixture = swept(Compensation::None);
        damage(&fixture);
        let dir = ClipDir::open(fixture.dir.path()).unwrap();
        dir.load_sweep(1).unwrap_err().to_string()
    };
    for (found, text) in [(f32::NAN, "NaN"), (f32::INFINITY, "inf"), (-1.5, "-1.5")] {
        let message = message(&|f| write_times(&f.path("1.times"), &[0.0, 0.0, found, 0.0, 0.0]).unwrap());
        let want = format!("1.times: time 2: expected seconds within 1 of the sweep's timestamp, found {text}");
        assert!(message.ends_with(&want), "{message}");
    }
    let sensor = message(&|f| write_sensors(&f.path("1.sensors"), &[0, 0, 0, 2, 0]).unwrap());
    assert!(
        sensor.ends_with("1.sensors: sensor of return 3: expected an index below 2, the number of sensors, found 2")
    );
    // Two sweeps that are nearly of one moment, far apart: no motion of a car.
    let jump = message(&|f| {
        let mut clip = f.clip.clone();
        clip.frames[0].lidar.timestamp = clip.frames[1].lidar.timestamp - 1e-6;
        clip.frames[0].lidar.world_from_lidar = Pose::new(DMat3::IDENTITY, DVec3::new(1e8, 0.0, 0.0));
        clip.frames[0].cameras.clear();
        write_clip(f.dir.path(), &clip).unwrap();
    });
    assert!(jump.contains("1.bin: point 0: expected "), "{jump}");
}

#[test]
fn rows_that_are_no_return_are_left_out_of_what_is_parallel_to_them() {
    let fixture = swept(Compensation::None);
    let whole = ClipDir::open(fixture.dir.path()).unwrap().load_sweep(0).unwrap();
    let path = fixture.dir.path().join(&fixture.clip.frames[0].lidar.file);
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[16..32].copy_from_slice(&f32::NAN.to_le_bytes().repeat(4));
    std::fs::write(&path, &bytes).unwrap();
    let found = ClipDir::open(fixture.dir.path()).unwrap().load_sweep(0).unwrap();
    assert_eq!((found.num_missing, found.points.len()), (1, 4));
    assert_eq!(found.points[1..], whole.points[2..]);
    assert_eq!(found.times.unwrap()[1..], whole.times.unwrap()[2..]);
    assert_eq!(found.sensors.unwrap()[1..], whole.sensors.unwrap()[2..]);
    assert_eq!(found.origins.unwrap()[1..], whole.origins.unwrap()[2..]);
    // Half a row is damage, and named.
    bytes[20..24].copy_from_slice(&1.0_f32.to_le_bytes());
    std::fs::write(&path, &bytes).unwrap();
    let error = ClipDir::open(fixture.dir.path()).unwrap().load_sweep(0).unwrap_err().to_string();
    assert!(error.contains("point 1: expected finite values"), "{error}");
}
