//! What must not matter, on random clips: the order of the returns, where the world's origin is and how it is turned, when time begins.

use lgs_engine::gaussians::{GaussianSet, MEAN};
use lgs_formats::clip_dir::{ClipDir, write_clip};
use lgs_formats::pose::Pose;
use lgs_tests::Outcome;
use lgs_tests::random::Random;
use lgs_tests::scenes::rotation_of;
use proptest::prelude::{Strategy, any};
use proptest::test_runner::{Config, RngAlgorithm, TestCaseError, TestRng, TestRunner};

use super::tiny::{MadeFrame, Reconstructed, reconstructed, write};
use super::{Extreme, ensure, failed};

pub(super) const CASES: &[Extreme] = &[
    Extreme::new(
        "order_of_the_returns",
        "the returns of random sweeps in another order",
        "the same Gaussians in that order, the same images (1e-5)",
        || property(order_does_not_matter),
    ),
    Extreme::new(
        "rigid_motion_of_the_world",
        "every pose of random clips turned and moved",
        "the same Gaussians and images (1e-4): the clip frame is the first sensor's own",
        || property(motion_does_not_matter),
    ),
    Extreme::new("shift_of_time", "every moment of random clips moved by whole seconds", "the same bits", || {
        property(time_does_not_matter)
    }),
];

/// Clips that a property is tried on.
const CLIPS: u32 = 12;

fn property(holds: fn(u64) -> Outcome) -> Outcome {
    let config = Config { cases: CLIPS, failure_persistence: None, ..Config::default() };
    let mut runner = TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha));
    let seeds = any::<u64>().prop_map(|seed| seed >> 8);
    let outcome = runner
        .run(&seeds, |seed| holds(seed).map_err(|e| TestCaseError::fail(e.message().unwrap_or_default().to_owned())));
    outcome.map_err(failed)
}

/// Two frames of random returns ahead.
fn frames(seed: u64) -> Vec<MadeFrame> {
    let mut random = Random::new(seed);
    let mut point = |_: u32| {
        let x = random.uniform_single(3.0, 20.0);
        [x, x * random.uniform_single(-0.5, 0.5), x * random.uniform_single(-0.3, 0.3)]
    };
    [0.0, 0.125].map(|time| MadeFrame { time, points: (0..80).map(&mut point).collect() }).into()
}

fn largest(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

fn same_images(got: &Reconstructed, want: &Reconstructed, tolerance: f32) -> Outcome {
    let worst = got.images.iter().zip(&want.images).map(|(a, b)| largest(&a.rgb, &b.rgb)).fold(0.0, f32::max);
    ensure(worst <= tolerance, || format!("images differ by {worst:e}"))
}

/// The LiDAR rows by place and time, so that sets of another order can be compared.
fn sorted(set: &GaussianSet) -> Vec<Vec<u32>> {
    let row = |i: usize| set.attributes[i].iter().chain([&set.times[i]]).map(|v| v.to_bits()).collect();
    let mut rows: Vec<Vec<u32>> = (0..set.num_lidar).map(row).collect();
    rows.sort_unstable();
    rows
}

fn order_does_not_matter(seed: u64) -> Outcome {
    let (there, here) = (tempfile::tempdir()?, tempfile::tempdir()?);
    let mut made = frames(seed);
    write(there.path(), &made)?;
    let mut random = Random::new(seed ^ 1);
    for frame in &mut made {
        frame.points = random.order(frame.points.len()).into_iter().map(|i| frame.points[i]).collect();
    }
    write(here.path(), &made)?;
    let (want, got) = (reconstructed(there.path(), None)?, reconstructed(here.path(), None)?);
    ensure(sorted(&got.scene) == sorted(&want.scene), || "other Gaussians".to_owned())?;
    same_images(&got, &want, 1e-5)
}

fn motion_does_not_matter(seed: u64) -> Outcome {
    let place = tempfile::tempdir()?;
    write(place.path(), &frames(seed))?;
    let want = reconstructed(place.path(), None)?;
    let mut random = Random::new(seed ^ 2);
    let rotation = rotation_of(random.uniforms(-1.0, 1.0));
    let shift: [f64; 3] = random.uniforms(-1e5, 1e5);
    let row = |r: usize| [rotation[r][0], rotation[r][1], rotation[r][2], shift[r]];
    let motion = Pose::from_rows(&[row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]])?;
    let mut clip = ClipDir::open(place.path()).map_err(failed)?.clip().clone();
    for frame in &mut clip.frames {
        frame.lidar.world_from_lidar = motion * frame.lidar.world_from_lidar;
        for record in &mut frame.cameras {
            record.camera.world_from_camera = motion * record.camera.world_from_camera;
        }
    }
    write_clip(place.path(), &clip).map_err(failed)?;
    let got = reconstructed(place.path(), None)?;
    let means = |set: &GaussianSet| set.attributes.iter().flat_map(|row| row[MEAN].to_vec()).collect::<Vec<f32>>();
    ensure(got.scene.len() == want.scene.len(), || format!("{} of {}", got.scene.len(), want.scene.len()))?;
    let worst = largest(&means(&got.scene), &means(&want.scene));
    ensure(worst < 1e-4, || format!("means differ by {worst:e} m"))?;
    same_images(&got, &want, 1e-4)
}

fn time_does_not_matter(seed: u64) -> Outcome {
    let (there, here) = (tempfile::tempdir()?, tempfile::tempdir()?);
    let mut made = frames(seed);
    write(there.path(), &made)?;
    let seconds = (seed % 2_000_000_000) as f64 - 1e9;
    made.iter_mut().for_each(|frame| frame.time += seconds);
    write(here.path(), &made)?;
    let (want, got) = (reconstructed(there.path(), None)?, reconstructed(here.path(), None)?);
    ensure(got.scene == want.scene, || format!("another scene {seconds} s away"))?;
    same_images(&got, &want, 0.0)
}
