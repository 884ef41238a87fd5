//! Times of making targets beside the floor: the passes that the original branch and the two branches of three rounds need, each a
//! drawn view, its loss and the gradients of both, and nothing else.

use std::io::Write as _;
use std::path::Path;
use std::time::Instant;

use lgs_engine::gaussians::physical::to_physical;
use lgs_engine::loss::{LossWeights, image_loss};
use lgs_engine::render::{backward, render_for_gradient};
use lgs_formats::targets::{Signal, TargetsConfig};
use lgs_targetgen::generate::Seconds;
use lgs_targetgen::job::{TargetJob, find_clips, run};
use lgs_targetgen::scene::{PredictedScene, load_scene};
use lgs_tests::{clips, places};

/// Runs of everything, one after the other in turns; the fastest counts.
const RUNS: usize = 3;
const ROUNDS: u8 = 3;
const CAP_BYTES: u64 = 256_000_000;

type Failed = Box<dyn std::error::Error>;

fn main() -> Result<(), Failed> {
    lgs_engine::allocator::keep_pages();
    let mut out = std::io::stdout();
    writeln!(out, "Times to look at and to compare on one quiet machine; no absolute time decides anything.")?;
    let shared = places::shared().join("clips");
    let cameras = ["CAMERA_01", "CAMERA_05", "CAMERA_06"].map(str::to_owned).to_vec();
    measure(&mut out, &clips::street(), &config(None, None))?;
    for (name, cameras, size) in [("ddad_scene_02", Some(cameras), [304, 484]), ("kitti_sfnd", None, [188, 621])] {
        if shared.join(name).is_dir() {
            measure(&mut out, &shared.join(name), &config(cameras, Some(size)))?;
        }
    }
    Ok(())
}

fn config(cameras: Option<Vec<String>>, image_size: Option<[usize; 2]>) -> TargetsConfig {
    TargetsConfig { rounds: ROUNDS, cameras, image_size, ..TargetsConfig::default() }
}

fn measure(out: &mut dyn std::io::Write, clip: &Path, config: &TargetsConfig) -> Result<(), Failed> {
    let scene = load_scene(clip, config, None)?;
    let [mut response, mut footprint] =
        [Signal::Response, Signal::Footprint].map(|signal| Fastest::new(signal, config));
    let mut floor = f64::INFINITY;
    for _ in 0..RUNS {
        floor = floor.min(passes(&scene));
        response.run(clip)?;
        footprint.run(clip)?;
    }
    let num_passes = (1 + 2 * usize::from(ROUNDS)) * scene.views.len();
    writeln!(
        out,
        "{}: {} views, {} primitives of the LiDAR, {} of the background",
        clip.file_name().unwrap_or_default().display(),
        scene.views.len(),
        scene.set.num_lidar,
        scene.set.len() - scene.set.num_lidar
    )?;
    let per_pass = 1e3 * floor / num_passes as f64;
    writeln!(out, "  floor      {floor:6.2} s  {num_passes} passes, {per_pass:.1} ms each")?;
    for (name, fastest) in [("response", &response), ("footprint", &footprint)] {
        let total = fastest.seconds.total();
        let stages = fastest.seconds.by_stage().map(|(name, spent)| format!("{name} {:.0} %", 100.0 * spent / total));
        let per_pass = 1e3 * fastest.seconds.render / num_passes as f64;
        writeln!(
            out,
            "  {name:<10} {total:6.2} s  {:.2} of the floor, {:.0} clips an hour, {per_pass:.1} ms a pass; {}",
            total / floor,
            3600.0 / total,
            stages.join(", ")
        )?;
    }
    let without = |seconds: &Seconds| seconds.total() - seconds.scene;
    let (a, b) = (&footprint.seconds, &response.seconds);
    let (with, without) = (a.total() / b.total(), without(a) / without(b));
    writeln!(out, "  footprint / response {with:.2}, without the making of the scene {without:.2}")?;
    Ok(())
}

/// Seconds of the passes alone.
fn passes(scene: &PredictedScene) -> f64 {
    let splats = to_physical(&scene.set);
    let start = Instant::now();
    for view in &scene.views {
        for _ in 0..1 + 2 * ROUNDS {
            let state = render_for_gradient(&splats, &view.pinhole, [0.0; 3]);
            let (_, by_image) = image_loss(&state.images, view, &LossWeights::default());
            std::hint::black_box(backward(&splats, &view.pinhole, &state, &by_image));
        }
    }
    start.elapsed().as_secs_f64()
}

/// The fastest run of the whole job, from the clip to the manifest.
struct Fastest {
    config: TargetsConfig,
    seconds: Seconds,
}

impl Fastest {
    fn new(signal: Signal, config: &TargetsConfig) -> Self {
        let never = Seconds { scene: f64::INFINITY, ..Seconds::default() };
        Self { config: TargetsConfig { signal, ..config.clone() }, seconds: never }
    }

    fn run(&mut self, clip: &Path) -> Result<(), Failed> {
        let place = tempfile::tempdir()?;
        let clips = find_clips(&[clip.to_owned()])?;
        let out = place.path().join("out");
        let config = self.config.clone();
        let job =
            TargetJob { clips: &clips, part: None, out, config, model: None, shard_bytes: CAP_BYTES, resume: false };
        let outcome = run(&job, &mut |_| ())?;
        if outcome.done_now != 1 {
            return Err(format!("{:?}", outcome.manifest.failed).into());
        }
        if outcome.seconds.total() < self.seconds.total() {
            self.seconds = outcome.seconds;
        }
        Ok(())
    }
}
