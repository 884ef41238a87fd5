//! U-Net, policy and query of `full` with seeded weights.

use std::sync::LazyLock;

use std::sync::Arc;

use candle_core::{DType, Tensor};
use candle_nn::VarBuilder;
use divan::Bencher;
use divan::counter::ItemsCount;
use lgs_engine::network::config::ModelConfig;
use lgs_engine::network::levels::{Levels, voxels_of};
use lgs_engine::network::policy::{EXTRA_INPUTS, Geometry, Policy, StageConfig};
use lgs_engine::network::query::Query;
use lgs_engine::network::unet::UNet;
use lgs_engine::network::weights::RandomWeights;
use lgs_engine::ops::DEVICE;
use lgs_engine::ops::knn::nearest_other_time;
use lgs_engine::ops::sparse_conv::{KernelMap, Sites};
use lgs_engine::ops::tensors::of_rows;

use crate::load::{SEED, full, kitti, sites, sites_of, values};
use crate::search::{NUM_POINTS, timed_points};
use crate::street::{Street, VOXEL_SIZE};

const UNET_INPUTS: usize = 15;

static CONFIG: LazyLock<ModelConfig> = LazyLock::new(full);

fn unet() -> UNet {
    UNet::new(UNET_INPUTS, &CONFIG.unet, &weights()).and_then(|unet| unet.fold()).unwrap()
}

fn policy() -> Policy {
    let config = CONFIG.policy.as_ref().unwrap();
    Policy::new(policy_inputs(), config, &weights()).and_then(|policy| policy.fold()).unwrap()
}

fn policy_inputs() -> usize {
    CONFIG.unet.width() + EXTRA_INPUTS
}

fn weights() -> VarBuilder<'static> {
    VarBuilder::from_backend(Box::new(RandomWeights { seed: 1 }), DType::F32, DEVICE)
}

fn features(rows: usize, width: usize) -> Tensor {
    of_rows(values(rows * width, 1), width).unwrap()
}

/// Multiplications and additions of the U-Net on a pyramid.
fn operations_of_unet(levels: &Levels) -> usize {
    let config = &CONFIG.unet;
    let map = |level: usize| levels.levels[level].submanifold.num_pairs();
    let sites = |level: usize| levels.levels[level].num_sites;
    let blocks = |level: usize, cin: usize, cout: usize| {
        let shortcut = if cin == cout { 0 } else { sites(level) * cin * cout };
        map(level) * (cin * cout + 3 * cout * cout) + shortcut
    };
    let mut sum = map(0) * (UNET_INPUTS * config.stem + config.stem * config.stem);
    let mut width = config.stem;
    let mut skips = vec![width];
    for (level, &channels) in config.encoder.iter().enumerate() {
        sum += sites(level) * width * width + blocks(level + 1, width, channels);
        width = channels;
        skips.push(width);
    }
    skips.pop();
    for (level, &channels) in (0..config.decoder.len()).rev().zip(&config.decoder) {
        let skip = skips.pop().unwrap();
        sum += sites(level) * width * channels + blocks(level, channels + skip, channels);
        width = channels;
    }
    2 * sum
}

/// Voxels, pyramid with its maps, U-Net.
fn whole_unet(bencher: Bencher, points: &[[f32; 3]]) {
    let unet = unet();
    let voxels = voxels_of(points.iter().copied(), VOXEL_SIZE).unwrap();
    let levels = Levels::new(&voxels, CONFIG.unet.num_levels()).unwrap();
    let features = features(levels.sites.len(), UNET_INPUTS);
    bencher.counter(ItemsCount::new(operations_of_unet(&levels))).bench_local(|| {
        let voxels = voxels_of(points.iter().copied(), VOXEL_SIZE).unwrap();
        let levels = Levels::new(&voxels, CONFIG.unet.num_levels()).unwrap();
        unet.forward(&features, &levels, false).unwrap()
    });
}

#[divan::bench(sample_count = 5, sample_size = 1)]
fn unet_of_street_points(bencher: Bencher) {
    whole_unet(bencher, &Street::new(SEED).points(NUM_POINTS));
}

#[divan::bench(sample_count = 5, sample_size = 1)]
fn unet_of_kitti_points(bencher: Bencher) {
    if let Some(points) = kitti(NUM_POINTS) {
        whole_unet(bencher, &points);
    }
}

#[divan::bench(sample_count = 5, sample_size = 1)]
fn pyramid_of_street_points(bencher: Bencher) {
    let voxels = voxels_of(Street::new(SEED).points(NUM_POINTS).into_iter(), VOXEL_SIZE).unwrap();
    bencher.bench(|| Levels::new(&voxels, CONFIG.unet.num_levels()));
}

/// Multiplications and additions of the policy over sites.
fn operations_of_policy(sites: &Sites) -> usize {
    let config = CONFIG.policy.as_ref().unwrap();
    let mut sum = KernelMap::submanifold(sites, 5).unwrap().num_pairs() * policy_inputs() * config.encoder[0].channels;
    let mut stage_sites = sites.clone();
    for (s, stage) in config.encoder.iter().enumerate() {
        let pairs = KernelMap::submanifold(&stage_sites, 3).unwrap().num_pairs();
        let finer = stage_sites.len();
        let blocks = |stage: &StageConfig| {
            let dense = (4 + 2 * config.mlp_ratio) * stage.channels + 2 * config.patch;
            stage.blocks * (pairs * stage.channels + finer * dense) * stage.channels
        };
        sum += blocks(stage) + config.decoder.get(s).map_or(0, blocks);
        if let Some(next) = config.encoder.get(s + 1) {
            stage_sites = stage_sites.halved().unwrap().0;
            sum += finer * stage.channels * next.channels;
            let above = config.decoder.get(s + 1).unwrap_or(next).channels;
            let decoder = config.decoder[s];
            sum += (finer * stage.channels + stage_sites.len() * above) * decoder.channels;
        }
    }
    let hidden = config.decoder[0].channels + (config.head_blocks - 1) * config.head_width + 1;
    2 * (sum + 2 * sites.len() * hidden * config.head_width)
}

/// Geometry and both scores, given the map of the finest level that the backbone has made.
fn whole_policy(bencher: Bencher, sites: &Sites) {
    let policy = policy();
    let config = CONFIG.policy.as_ref().unwrap();
    let maps = [std::sync::Arc::new(KernelMap::submanifold(sites, 3).unwrap())];
    let features = features(sites.len(), policy_inputs());
    bencher.counter(ItemsCount::new(operations_of_policy(sites))).bench_local(|| {
        let geometry = Geometry::new(sites, &maps, config).unwrap();
        policy.scores(&features, &geometry, false).unwrap()
    });
}

#[divan::bench(args = [100_000, 500_000], sample_count = 5, sample_size = 1)]
fn policy_of_street_sites(bencher: Bencher, count: usize) {
    whole_policy(bencher, &sites(count));
}

#[divan::bench(args = [100_000, 500_000], sample_count = 5, sample_size = 1)]
fn policy_of_street_points(bencher: Bencher, count: usize) {
    whole_policy(bencher, &sites_of(&Street::new(SEED).points(count)).unwrap());
}

#[divan::bench(args = [100_000, 500_000], sample_count = 5, sample_size = 1)]
fn policy_of_kitti_points(bencher: Bencher, count: usize) {
    if let Some(points) = kitti(count) {
        whole_policy(bencher, &sites_of(&points).unwrap());
    }
}

#[divan::bench(args = [100_000, 500_000], sample_count = 5, sample_size = 1)]
fn policy_geometry_of_street_sites(bencher: Bencher, count: usize) {
    let sites = sites(count);
    let maps = [std::sync::Arc::new(KernelMap::submanifold(&sites, 3).unwrap())];
    bencher.bench_local(|| Geometry::new(&sites, &maps, CONFIG.policy.as_ref().unwrap()));
}

/// Search among the other timestamps, mean of what was found, projection.
#[divan::bench(sample_count = 10, sample_size = 1)]
fn query_of_street_points(bencher: Bencher) {
    let k = CONFIG.query.as_ref().map_or(0, |query| query.neighbours);
    let width = CONFIG.unet.width();
    let query = Query::new(width, &weights()).and_then(|query| query.fold()).unwrap();
    let (points, times) = timed_points();
    let features = features(points.len(), width);
    bencher.bench_local(|| {
        let neighbours = nearest_other_time(&points, &times, k).unwrap();
        // In place: the projection starts at zero, so the features stay.
        query.forward(features.clone(), &Arc::new(neighbours.indices), k).unwrap()
    });
}
