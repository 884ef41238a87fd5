//! What is measured: voxels of a driving-like street and made-up features.

use std::io::Write as _;
use std::path::Path;
use std::sync::{Arc, LazyLock};

use lgs_engine::error::Result;
use lgs_engine::network::config::ModelConfig;
use lgs_engine::ops::sparse_conv::{KernelMap, Sites};
use lgs_engine::points::aggregate;
use lgs_engine::views::ClipFrame;
use lgs_formats::clip_dir::ClipDir;
use lgs_tests::places;
use lgs_tests::random::Random;

use crate::street::Street;

/// Sites of the measured convolutions.
pub(crate) const NUM_SITES: usize = 500_000;

/// Sites of a street and the map of their 3^3 submanifold convolution.
#[derive(Debug)]
pub(crate) struct Load {
    /// The occupied voxels.
    pub(crate) sites: Sites,
    /// The map.
    pub(crate) map: Arc<KernelMap>,
}

/// [`NUM_SITES`] sites.
pub(crate) static LOAD: LazyLock<Load> = LazyLock::new(|| {
    let sites = sites(NUM_SITES);
    let map = Arc::new(KernelMap::submanifold(&sites, 3).unwrap());
    note(&map);
    Load { sites, map }
});

/// Tells the sites and pairs that a figure stands for.
pub(crate) fn note(map: &KernelMap) {
    let (sites, pairs) = (map.num_outputs(), map.num_pairs());
    let line = format!("{sites} sites, {:.2} pairs a site under 3^3", pairs as f64 / sites.max(1) as f64);
    // A note that cannot be written changes no figure.
    let _ = writeln!(std::io::stderr(), "{line}");
}

/// The first `count` sites of the street.
pub(crate) fn sites(count: usize) -> Sites {
    Sites::unique(&Street::new(5).voxels(count).unwrap()).unwrap().0
}

/// Normal values.
pub(crate) fn values(count: usize, seed: u64) -> Vec<f32> {
    let mut random = Random::new(seed);
    (0..count).map(|_| random.normal_single()).collect()
}

/// The size of the paper.
pub(crate) fn full() -> ModelConfig {
    let path = places::repository().join("models/full.json");
    ModelConfig::read(&path).unwrap()
}

/// Returns of the shared KITTI clip, the first `count`; `None` where the clip is missing.
pub(crate) fn kitti(count: usize) -> Option<Vec<[f32; 3]>> {
    read(&places::shared().join("clips/kitti_sfnd"), count).ok()
}

fn read(path: &Path, count: usize) -> Result<Vec<[f32; 3]>> {
    let dir = ClipDir::open(path)?;
    let frames: Vec<usize> = (0..dir.clip().frames.len()).collect();
    let mut points = aggregate(&dir, &frames, &ClipFrame::of(dir.clip(), 0))?.positions;
    points.truncate(count);
    Ok(points)
}
