//! Places and moments far out, near by, equal, reversed; clips of one thing only.

use std::time::Instant;

use lgs_engine::gaussians::motion::registered;
use lgs_engine::gaussians::physical::to_physical;
use lgs_engine::gaussians::{MEAN, initial};
use lgs_engine::ops::knn::nearest_other_time;
use lgs_engine::points::{PointCloud, spacing};
use lgs_engine::predict::{QuerySkipped, backbone, query};
use lgs_engine::render::render;
use lgs_formats::clip_dir::ClipDir;
use lgs_formats::image::ImageSize;
use lgs_tests::weights::{Heads, SMALL, Weights};
use lgs_tests::{Outcome, clips};

use super::tiny::{MadeFrame, Reconstructed, finite_image, reconstructed, reconstructed_of, wall, walls};
use super::{Extreme, ensure, failed};

pub(super) const CASES: &[Extreme] = &[
    Extreme::new(
        "moved_by_1e6_m",
        "the shipped clip, every pose moved by 10^6 m",
        "the same Gaussians in the clip frame (1e-4 m), the same images (1e-4): poses meet in f64 before anything is f32",
        || moved([1e6, -1e6, 1e3], 0.0, 1e-4),
    ),
    Extreme::new(
        "moved_by_1e7_m",
        "the shipped clip, every pose moved by 10^7 m",
        "as for 10^6 m, images within 2e-4: f64 still resolves 2e-9 m there, but a pixel may lie on a threshold",
        || moved([1e7, -1e7, 1e4], 0.0, 2e-4),
    ),
    Extreme::new(
        "epoch_seconds",
        "the shipped clip at 1.7e9 s",
        "the same places, times within 1e-6 s (f64 resolves 2.4e-7 s there), images within 1e-3: waits for an image are compared to a tenth of a millisecond, velocities divide by rounded times",
        || moved([0.0; 3], 1.7e9, 1e-3),
    ),
    Extreme::new(
        "epoch_nanoseconds",
        "timestamps of 1.7e18, an epoch in nanoseconds where the format has seconds",
        "an error that names the field and asks for seconds: a silent loss of the clock would be worse",
        nanoseconds,
    ),
    Extreme::new(
        "points_at_a_tenth_of_a_millimetre",
        "returns 1e-4 m apart, 1e-4 m to 1 m away",
        "a finite scene and finite images",
        near_points,
    ),
    Extreme::new(
        "points_at_100_km",
        "returns 1e5 m away beside those of a wall",
        "left out, being no surface; finite images; the wall is drawn",
        far_points,
    ),
    Extreme::new(
        "points_at_100_km_for_a_network",
        "a Gaussian 1e5 m away in a scene for a network whose grid ends at 26 km",
        "an error that names the row and the bounds of the grid, not a wrapped voxel",
        far_points_for_a_network,
    ),
    Extreme::new(
        "point_on_the_camera_centre",
        "a return at the camera's own centre",
        "no colour, so no Gaussian; the rest is as without it",
        on_the_centre,
    ),
    Extreme::new(
        "points_behind_the_camera",
        "returns behind the only camera",
        "no Gaussian of the LiDAR branch, a finite background",
        behind,
    ),
    Extreme::new(
        "equal_timestamps",
        "two frames of one moment",
        "a finite scene; the query has nobody to ask and says so",
        equal_times,
    ),
    Extreme::new(
        "reversed_timestamps",
        "frames whose clock runs backwards",
        "a finite scene with negative times",
        || times(&[3.0, 2.0, 1.0]),
    ),
    Extreme::new("duplicated_timestamps", "four frames of two moments", "a finite scene", || {
        times(&[0.0, 0.1, 0.0, 0.1])
    }),
    Extreme::new(
        "one_point",
        "a clip of one return",
        "a scene of that return, at the smallest scale, and its background",
        one_point,
    ),
    Extreme::new("one_frame", "a clip of one frame", "a finite scene", || times(&[12.5])),
    Extreme::new(
        "one_camera",
        "a clip of two frames and one camera",
        "a finite scene and an image of each frame",
        one_camera,
    ),
    Extreme::new("one_pixel", "images of 1 x 1 pixels", "a finite scene and images of one pixel", one_pixel),
    Extreme::new(
        "a_million_coincident_points",
        "10^6 returns on one spot, of two moments",
        "neighbours by index, smallest scales, no velocity, a finite image, all within two minutes on a busy machine: ties may not cost more than other points",
        coincident,
    ),
];

const SMALL_IMAGES: ImageSize = ImageSize { height: 40, width: 64 };

fn moved(metres: [f64; 3], seconds: f64, image_tolerance: f32) -> Outcome {
    let place = tempfile::tempdir()?;
    clips::copy(&clips::street(), place.path())?;
    let want = reconstructed(place.path(), Some(SMALL_IMAGES))?;
    clips::edit(place.path(), |description| clips::shift(description, seconds, metres))?;
    let got = reconstructed(place.path(), Some(SMALL_IMAGES))?;
    same(&got, &want, image_tolerance)
}

/// Same places within 1e-4 m, same times within 1e-6 s, and same images.
fn same(got: &Reconstructed, want: &Reconstructed, image_tolerance: f32) -> Outcome {
    let counts = |r: &Reconstructed| (r.scene.len(), r.scene.num_lidar);
    ensure(counts(got) == counts(want), || format!("{:?} Gaussians, want {:?}", counts(got), counts(want)))?;
    let far = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    let means = |r: &Reconstructed| r.scene.attributes.iter().flat_map(|row| row[MEAN].to_vec()).collect::<Vec<f32>>();
    let rows = far(&means(got), &means(want));
    let times = far(&got.scene.times, &want.scene.times);
    let images = got.images.iter().zip(&want.images).map(|(a, b)| far(&a.rgb, &b.rgb)).fold(0.0, f32::max);
    ensure(rows < 1e-4 && times < 1e-6 && images < image_tolerance, || {
        format!("means differ by {rows:e} m, times by {times:e}, images by {images:e}")
    })
}

fn nanoseconds() -> Outcome {
    let place = tempfile::tempdir()?;
    super::tiny::write(place.path(), &walls(&[0.0]))?;
    clips::edit(place.path(), |description| clips::shift(description, 1.7e18, [0.0; 3]))?;
    let message = ClipDir::open(place.path()).map(drop).map_err(|e| e.to_string()).err().unwrap_or_default();
    ensure(message.contains("lidar.timestamp: expected finite seconds"), || format!("it said {message:?}"))
}

fn near_points() -> Outcome {
    let points = (0..60_u16).map(f32::from).map(|k| [1e-4 * (1.0 + k * k * 3.0), 1e-4 * k, -1e-4 * k]).collect();
    let made = reconstructed_of(&[MadeFrame { time: 0.0, points }])?;
    ensure(made.scene.num_lidar > 0, || "no point got a colour".to_owned())
}

fn with_far_points() -> Vec<MadeFrame> {
    let mut points = wall();
    // Above the wall, which would cover them.
    points.extend([[1e5, 0.0, 3.5e4], [1e5, 1e3, 3.4e4], [-1e5, 0.0, 0.0]]);
    vec![MadeFrame { time: 0.0, points }]
}

fn far_points() -> Outcome {
    let made = reconstructed_of(&with_far_points())?;
    let is_far = |row: &&[f32; 14]| row[MEAN][0] > 9e4;
    let far = made.scene.attributes[..made.scene.num_lidar].iter().filter(is_far).count();
    let covered = made.images[0].alpha.iter().filter(|&&a| a > 0.1).count();
    ensure(far == 0 && made.scene.num_lidar > 0 && covered > 100, || {
        format!("{far} far Gaussians, {covered} covered pixels")
    })
}

fn far_points_for_a_network() -> Outcome {
    let model = Weights::seeded(SMALL, 1, Heads::ZERO)?.model()?;
    let mut made = reconstructed_of(&walls(&[0.0]))?;
    made.scene.attributes[0][MEAN][0] = 1e5;
    let said = backbone(&made.scene, &model).map(drop).map_err(|e| e.to_string()).err().unwrap_or_default();
    ensure(said.contains("voxel coordinates: expected") && said.contains("found row"), || format!("it said {said:?}"))
}

fn on_the_centre() -> Outcome {
    let without = reconstructed_of(&walls(&[0.0]))?;
    let mut points = wall();
    points.push([0.0; 3]);
    let with = reconstructed_of(&[MadeFrame { time: 0.0, points }])?;
    ensure(with.scene.num_lidar == without.scene.num_lidar, || format!("{} Gaussians", with.scene.num_lidar))
}

fn behind() -> Outcome {
    let points = wall().into_iter().map(|[x, y, z]| [-x, y, z]).collect();
    let made = reconstructed_of(&[MadeFrame { time: 0.0, points }])?;
    ensure(made.scene.num_lidar == 0, || format!("{} Gaussians", made.scene.num_lidar))
}

fn equal_times() -> Outcome {
    let model = Weights::seeded(SMALL, 1, Heads::ZERO)?.model()?;
    let made = reconstructed_of(&walls(&[7.0, 7.0]))?;
    let mut features = backbone(&made.scene, &model).map_err(failed)?;
    let skipped = query(&mut features, &made.scene, &model).map_err(failed)?;
    ensure(skipped == Some(QuerySkipped::SingleTimestamp), || format!("{skipped:?}"))
}

fn times(times: &[f64]) -> Outcome {
    let made = reconstructed_of(&walls(times))?;
    let wanted = |time: &f32| times.iter().any(|t| (t - times[0] - f64::from(*time)).abs() < 1e-6);
    let lidar = &made.scene.times[..made.scene.num_lidar];
    ensure(!lidar.is_empty() && lidar.iter().all(wanted), || "another time, or no Gaussian".to_owned())
}

fn one_point() -> Outcome {
    let made = reconstructed_of(&[MadeFrame { time: 0.0, points: vec![[8.0, 0.0, 0.0]] }])?;
    let smallest = to_physical(&made.scene)[0].scale;
    ensure(made.scene.num_lidar == 1 && smallest.iter().all(|s| (s - 1e-4).abs() < 1e-9), || format!("{smallest:?}"))
}

fn one_camera() -> Outcome {
    let made = reconstructed_of(&walls(&[0.0, 0.1]))?;
    ensure(made.images.len() == 2, || format!("{} images", made.images.len()))
}

fn one_pixel() -> Outcome {
    let place = tempfile::tempdir()?;
    super::tiny::write(place.path(), &walls(&[0.0, 0.1]))?;
    let made = reconstructed(place.path(), Some(ImageSize { height: 1, width: 1 }))?;
    made.images.iter().try_for_each(finite_image)?;
    ensure(made.images.iter().all(|image| image.rgb.len() == 3), || "another size".to_owned())
}

fn coincident() -> Outcome {
    const COUNT: u32 = 1_000_000;
    let start = Instant::now();
    let cloud = PointCloud {
        positions: vec![[0.1, -0.1, 5.0]; COUNT as usize],
        times: (0..COUNT).map(|i| (i % 2) as f32 * 0.1).collect(),
        frames: (0..COUNT).map(|i| i % 2).collect(),
        origins: vec![[0.0; 3]; COUNT as usize],
        num_missing: 0,
    };
    let all: Vec<u32> = (0..COUNT).collect();
    let spacing = spacing(&cloud.positions, &all).map_err(failed)?;
    ensure(spacing.iter().all(|&s| s == 0.0), || "a distance between coincident points".to_owned())?;
    let mut in_turn = cloud.clone();
    in_turn.frames.sort_unstable();
    in_turn.times.sort_by(f32::total_cmp);
    let still = registered(&in_turn, &[]).velocities;
    ensure(still.iter().all(|v| *v == [0.0; 3]), || "a coincident point moves".to_owned())?;
    let set = initial(&cloud, &vec![Some([0.5; 3]); COUNT as usize], &spacing);
    let neighbours = nearest_other_time(&cloud.positions, &cloud.frames, 8).map_err(failed)?;
    ensure(neighbours.of(2) == [1, 3, 5, 7, 9, 11, 13, 15], || format!("neighbours {:?}", neighbours.of(2)))?;
    finite_image(&render(&to_physical(&set), &super::tiny::AHEAD, [0.0; 3]))?;
    let seconds = start.elapsed().as_secs_f64();
    ensure(seconds < 120.0, || format!("{seconds} s"))
}
