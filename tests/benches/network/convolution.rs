//! Sparse convolution: the kernel map, both directions, the whole operation with its gradients, the slow twin.

use candle_core::{Device, Tensor, Var};
use divan::Bencher;
use divan::counter::ItemsCount;
use lgs_engine::ops::sparse_conv::{
    ConvWeights, Epilogue, KernelMap, PackedWeights, WeightShape, by_features, by_weights, convolve, convolve_into,
    reference,
};

use crate::load::{LOAD, sites, values};

/// Channels in and out.
const WIDTHS: [usize; 2] = [32, 96];
const NUM_OFFSETS: usize = 27;
const SITES_OF_TWIN: usize = 20_000;

fn operations(map: &KernelMap, channels: usize) -> ItemsCount {
    ItemsCount::new(2 * map.num_pairs() * channels * channels)
}

#[divan::bench(sample_count = 30, sample_size = 1)]
fn kernel_map(bencher: Bencher) {
    let load = &*LOAD;
    bencher.bench(|| KernelMap::submanifold(&load.sites, 3));
}

#[divan::bench(sample_count = 30, sample_size = 1)]
fn sorted_sites_and_kernel_map(bencher: Bencher) {
    let mut coords = LOAD.sites.coords().to_vec();
    coords.reverse();
    bencher.bench(|| lgs_engine::ops::sparse_conv::Sites::unique(&coords).map(|(s, _)| KernelMap::submanifold(&s, 3)));
}

#[divan::bench(args = WIDTHS, sample_count = 20, sample_size = 1)]
fn forward(bencher: Bencher, channels: usize) {
    let load = &*LOAD;
    let features = values(load.sites.len() * channels, 1);
    let packed = shape(channels).pack(&weight(channels));
    let weights = PackedWeights::new(shape(channels), &packed);
    let mut out = features.clone();
    bencher.counter(operations(&load.map, channels)).bench_local(|| {
        convolve_into(&features, &weights, &load.map, &Epilogue::default(), &mut out);
    });
}

#[divan::bench(args = WIDTHS, sample_count = 20, sample_size = 1)]
fn gradient_by_features(bencher: Bencher, channels: usize) {
    let load = &*LOAD;
    let v_out = values(load.sites.len() * channels, 1);
    let packed = shape(channels).pack(&weight(channels));
    let weights = PackedWeights::new(shape(channels), &packed);
    let mut v_features = v_out.clone();
    bencher.counter(operations(&load.map, channels)).bench_local(|| {
        by_features(&v_out, &weights, &load.map, &mut v_features);
    });
}

#[divan::bench(args = WIDTHS, sample_count = 20, sample_size = 1)]
fn gradient_by_weights(bencher: Bencher, channels: usize) {
    let load = &*LOAD;
    let features = values(load.sites.len() * channels, 1);
    let v_out = values(load.sites.len() * channels, 2);
    bencher
        .counter(operations(&load.map, channels))
        .bench_local(|| by_weights(&features, &v_out, &load.map, channels, channels));
}

/// Forward and both gradients as training calls them, with what candle does between.
#[divan::bench(args = WIDTHS, sample_count = 10, sample_size = 1)]
fn operation_and_gradients(bencher: Bencher, channels: usize) {
    let load = &*LOAD;
    let rows = load.sites.len();
    let var = |values: &[f32], shape: &[usize]| Var::from_slice(values, shape, &Device::Cpu).unwrap();
    let features = var(&values(rows * channels, 1), &[rows, channels]);
    let weight = var(&weight(channels), &[channels, 3, 3, 3, channels]);
    let v_out = Tensor::from_vec(values(rows * channels, 2), (rows, channels), &Device::Cpu).unwrap();
    bencher.counter(ItemsCount::new(6 * load.map.num_pairs() * channels * channels)).bench_local(|| {
        let weights = ConvWeights::without_bias(&weight).unwrap();
        let out = convolve(&features, &weights, None, &load.map, false).unwrap();
        (out * &v_out).unwrap().sum_all().unwrap().backward().unwrap()
    });
}

/// The twin on fewer sites: compare the rates.
#[divan::bench(args = [32], sample_count = 3, sample_size = 1)]
fn twin(bencher: Bencher, channels: usize) {
    let sites = sites(SITES_OF_TWIN);
    let map = KernelMap::submanifold(&sites, 3).unwrap();
    let double = |values: Vec<f32>| values.into_iter().map(f64::from).collect::<Vec<f64>>();
    let features = double(values(sites.len() * channels, 1));
    let weight = double(weight(channels));
    bencher
        .counter(operations(&map, channels))
        .bench_local(|| reference::convolve(sites.coords(), &features, sites.coords(), &weight, 3, 1));
}

fn shape(channels: usize) -> WeightShape {
    WeightShape { num_offsets: NUM_OFFSETS, cin: channels, cout: channels }
}

fn weight(channels: usize) -> Vec<f32> {
    let scale = 1.0 / ((NUM_OFFSETS * channels) as f32).sqrt();
    values(channels * NUM_OFFSETS * channels, 3).into_iter().map(|w| w * scale).collect()
}
