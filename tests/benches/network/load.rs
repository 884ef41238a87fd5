//! What is measured: voxels of a driving-like street and made-up features.

use std::path::Path;
use std::sync::{Arc, LazyLock};

use lgs_engine::error::Result;
use lgs_engine::network::config::ModelConfig;
use lgs_engine::network::levels::voxels_of;
use lgs_engine::ops::sparse_conv::{KernelMap, Sites};
use lgs_engine::points::aggregate;
use lgs_engine::views::ClipFrame;
use lgs_formats::clip_dir::ClipDir;
use lgs_tests::places;
use lgs_tests::random::Random;

use crate::street::{Street, VOXEL_SIZE};

/// Sites of the measured convolutions.
pub(crate) const NUM_SITES: usize = 500_000;

/// Seed of the street.
pub(crate) const SEED: u64 = 5;

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
    Load { sites, map }
});

/// The sites and pairs that the figures stand for, a line for each cloud.
pub(crate) fn described() -> Result<String> {
    let mut text = String::new();
    let mut add = |name: &str, sites: &Sites| -> Result<()> {
        let pairs = KernelMap::submanifold(sites, 3)?.num_pairs() as f64 / sites.len().max(1) as f64;
        text += &format!("{name}: {} sites, {pairs:.2} pairs a site under 3^3\n", sites.len());
        Ok(())
    };
    add("street sites", &LOAD.sites)?;
    add("street points", &sites_of(&Street::new(SEED).points(NUM_SITES))?)?;
    if let Some(points) = kitti(NUM_SITES) {
        add("KITTI points", &sites_of(&points)?)?;
    }
    Ok(text)
}

/// The sites of points.
pub(crate) fn sites_of(points: &[[f32; 3]]) -> Result<Sites> {
    Ok(Sites::unique(&voxels_of(points.iter().copied(), VOXEL_SIZE)?)?.0)
}

/// The first `count` sites of the street.
pub(crate) fn sites(count: usize) -> Sites {
    Sites::unique(&Street::new(SEED).voxels(count).unwrap()).unwrap().0
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
