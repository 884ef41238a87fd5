//! A component of the second form as the data set's owners write it, where it is: the poses of a drive.

use std::fs;
use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use lgs_formats::importers;
use lgs_formats::pose::Pose;
use lgs_tests::compare::{absolute, close};
use lgs_tests::{Needed, Outcome, case_if, places};
use libtest_mimic::{Failed, Trial};

use super::drive::fixture;
use super::table::table_of;

/// Its rows, and what pyarrow reads of it: the first and the last timestamp (microseconds), the first and the last pose, the sum of all places.
const NUM_ROWS: usize = 199;
const TIMES: [i64; 2] = [1_552_440_195_362_591, 1_552_440_215_162_553];
const FIRST: [[f64; 4]; 3] = [
    [0.699_058_830_738_067_6, 0.715_033_411_979_675_3, 0.006_630_366_668_105_125, 860.594_787_597_656_2],
    [-0.715_057_551_860_809_3, 0.698_982_596_397_399_9, 0.010_772_178_880_870_342, 15_568.674_804_687_5],
    [0.003_067_956_771_701_574_3, -0.012_271_480_634_808_54, 0.999_920_010_566_711_4, -651.440_979_003_906_2],
];
const LAST: [[f64; 4]; 3] = [
    [0.705_132_842_063_903_8, 0.708_946_466_445_922_9, 0.013_512_448_407_709_599, 866.036_621_093_75],
    [-0.709_064_841_270_446_8, 0.705_097_556_114_196_8, 0.008_029_734_715_819_359, 15_563.538_085_937_5],
    [-0.003_834_942_821_413_278_6, -0.015_243_232_250_213_623, 0.999_876_439_571_380_6, -651.468_994_140_625],
];
const SUM: [f64; 3] = [172_222.659_240_722_66, 3_097_254.746_093_75, -129_641.385_253_906_25];
/// Seconds from a frame's timestamp to the moment of its pose, where no image says it: half a turn.
const HALF_A_TURN: f64 = 0.05;

pub(super) fn cases() -> Vec<Trial> {
    let name = "vehicle_pose_10023947602400723454_1120_000_1140_000.parquet";
    let file: PathBuf = places::shared().join("foreign/waymo").join(name);
    let needed = Needed::path(&file, "the real foreign folders");
    vec![case_if(&needed, "importers::waymo::the_real_component", move || real_component(&file))]
}

/// The drive has a sweep of the fixture's `LiDAR` for each pose; nothing is read of the sweeps.
fn real_component(file: &Path) -> Outcome {
    let place = tempfile::tempdir()?;
    let put = |component: &str, content: &[u8]| {
        let folder = place.path().join(component);
        fs::create_dir_all(&folder)?;
        fs::write(folder.join("drive.parquet"), content)
    };
    let content = fs::read(file)?;
    let times = timestamps(&content)?;
    put("vehicle_pose", &content)?;
    put("lidar_calibration", &fs::read(fixture("waymo_v2/lidar_calibration/drive.parquet"))?)?;
    put("lidar", &table_of(&[("key.frame_timestamp_micros", &times), ("key.laser_name", &[1; NUM_ROWS])])?)?;
    let dir = importers::open(place.path())?;
    let frames = &dir.clip().frames;
    let moments: Vec<f64> = frames.iter().map(|frame| frame.lidar.timestamp).collect();
    let wanted: Vec<f64> = times.iter().map(|&time| seconds(time) + HALF_A_TURN).collect();
    close("moments", &moments, &wanted, absolute(1e-6))?;
    if frames.len() != NUM_ROWS || !moments.is_sorted_by(|a, b| a < b) {
        return Err(format!("{} frames, moments {moments:?}", frames.len()).into());
    }
    // The clip's LiDAR has the vehicle's axes, and stands where the fixture's calibration says.
    let vehicle_from_lidar = Pose::new(DMat3::IDENTITY, DVec3::new(1.0, 0.0, 1.75));
    let poses: Vec<Pose> =
        frames.iter().map(|frame| frame.lidar.world_from_lidar * vehicle_from_lidar.inverse()).collect();
    for (index, pose) in poses.iter().enumerate() {
        let residual = pose.rotation().transpose() * pose.rotation() - DMat3::IDENTITY;
        let turns = [pose.rotation().determinant()];
        // Single precision is all that the file has.
        close(&format!("pose {index}: R^T R - I"), &residual.to_cols_array(), &[0.0; 9], absolute(2e-7))?;
        close(&format!("pose {index}: det R"), &turns, &[1.0], absolute(2e-7))?;
    }
    for (what, pose, want) in [("first pose", &poses[0], FIRST), ("last pose", &poses[NUM_ROWS - 1], LAST)] {
        close(what, pose.rows()[..3].as_flattened(), want.as_flattened(), absolute(1e-9))?;
    }
    let sum: DVec3 = poses.iter().map(Pose::translation).sum();
    close("sum of the places", &sum.to_array(), &SUM, absolute(1e-6))
}

/// The timestamps of the component's rows, straight from its bytes: its dictionary holds them in the order of the rows, plain.
fn timestamps(content: &[u8]) -> Result<Vec<i64>, Failed> {
    let [first, last] = TIMES;
    let start = content.windows(8).position(|window| window == first.to_le_bytes()).ok_or("no first timestamp")?;
    let numbers = content[start..].as_chunks().0.iter().map(|bytes| i64::from_le_bytes(*bytes));
    let times: Vec<i64> = numbers.take(NUM_ROWS).collect();
    if times.len() == NUM_ROWS && times.is_sorted_by(|a, b| a < b) && times.last() == Some(&last) {
        Ok(times)
    } else {
        Err(format!("timestamps {times:?}").into())
    }
}

#[expect(clippy::cast_precision_loss, reason = "microseconds since 1970 are below 2^53")]
fn seconds(microseconds: i64) -> f64 {
    microseconds as f64 / 1e6
}
