//! Small made-up problems.

use lgs_engine::gaussians::physical::logit;
use lgs_engine::gaussians::{GaussianSet, NUM_ATTRIBUTES};
use lgs_engine::loss::LossWeights;
use lgs_engine::views::{DepthSample, PinholeView, Role, View};
use lgs_formats::image::RgbImage;
use lgs_formats::targets::{Signal, TargetsConfig};
use lgs_targetgen::branches::Problem;
use lgs_tests::random::Random;

pub(crate) const WIDTH: usize = 64;
pub(crate) const HEIGHT: usize = 40;

/// A scene and its views.
pub(crate) struct Made {
    pub(crate) set: GaussianSet,
    pub(crate) views: Vec<View>,
}

impl Made {
    /// The problem under loss weights.
    pub(crate) fn problem(&self, weights: LossWeights) -> Problem<'_> {
        Problem { set: &self.set, views: &self.views, weights }
    }

    /// The problem under the weights of training.
    pub(crate) fn usual(&self) -> Problem<'_> {
        self.problem(LossWeights::default())
    }
}

/// The settings of the paper.
pub(crate) fn config(signal: Signal) -> TargetsConfig {
    TargetsConfig { signal, ..TargetsConfig::default() }
}

/// A camera at the origin that looks along z, shifted to the right by `x` metres.
pub(crate) fn camera(x: f32) -> PinholeView {
    PinholeView {
        width: WIDTH,
        height: HEIGHT,
        fx: 60.0,
        fy: 60.0,
        cx: 32.0,
        cy: 20.0,
        camera_from_clip: [[1.0, 0.0, 0.0, -x], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
        time: 0.0,
        shutter: None,
        pixel_side: 1.0,
    }
}

/// A view of an image.
pub(crate) fn view(pinhole: PinholeView, data: Vec<f32>, depth_samples: Vec<DepthSample>) -> View {
    let image = RgbImage { width: WIDTH, height: HEIGHT, data };
    View {
        frame: 0,
        camera: "c".to_owned(),
        role: Role::Input,
        pinhole,
        image,
        labels: None,
        response: None,
        depth_map: None,
        depth_samples,
    }
}

/// Raw attributes of a Gaussian.
pub(crate) fn row(
    mean: [f32; 3],
    quat: [f32; 4],
    scale: [f32; 3],
    opacity: f32,
    colour: [f32; 3],
) -> [f32; NUM_ATTRIBUTES] {
    let mut row = [0.0; NUM_ATTRIBUTES];
    row[..3].copy_from_slice(&mean);
    row[3..7].copy_from_slice(&quat);
    row[7..10].copy_from_slice(&scale.map(f32::ln));
    row[10] = logit(opacity);
    row[11..].copy_from_slice(&colour.map(logit));
    row
}

/// The set of rows, at rest, all of the time 0.
pub(crate) fn set_of(rows: Vec<[f32; NUM_ATTRIBUTES]>, num_lidar: usize) -> GaussianSet {
    let n = rows.len();
    GaussianSet { attributes: rows, times: vec![0.0; n], frames: vec![0; n], velocities: vec![[0.0; 3]; n], num_lidar }
}

/// `num_lidar` random Gaussians, a background of twenty, two views of random images with depth samples.
pub(crate) fn random(num_lidar: usize, seed: u64) -> Made {
    let mut random = Random::new(seed);
    let mut uniform = |low: f64, high: f64| random.uniform_single(low, high);
    let mut rows = Vec::new();
    for i in 0..num_lidar + 20 {
        let z = if i < num_lidar { uniform(3.0, 6.0) } else { uniform(8.0, 9.0) };
        let mean = [uniform(-0.5, 0.5) * z, uniform(-0.3, 0.3) * z, z];
        let quat = [1.0, uniform(-0.5, 0.5), uniform(-0.5, 0.5), uniform(-0.5, 0.5)];
        let scale = [uniform(0.05, 0.25), uniform(0.05, 0.25), uniform(0.05, 0.25)];
        let colour = [uniform(0.0, 1.0), uniform(0.0, 1.0), uniform(0.0, 1.0)];
        rows.push(row(mean, quat, scale, uniform(0.1, 0.9), colour));
    }
    let mut views = Vec::new();
    for x in [-0.1, 0.1] {
        let data = (0..3 * WIDTH * HEIGHT).map(|_| uniform(0.0, 1.0)).collect();
        let depth_samples = (0..60).map(|k| DepthSample { pixel: 37 * k, depth: uniform(3.0, 6.0) }).collect();
        views.push(view(camera(x), data, depth_samples));
    }
    Made { set: set_of(rows, num_lidar), views }
}
