//! Dense products: what the machine gives at best.

use candle_core::{DType, Device, Tensor};
use divan::Bencher;
use divan::counter::ItemsCount;
use half::f16;
use half::slice::HalfFloatSliceExt;
use lgs_engine::ops::dense::{Packed, multiply_into};

use crate::load::values;

/// Rows, depth, columns: square, and as tall as the layers of a scene.
const SHAPES: [[usize; 3]; 3] = [[2048, 2048, 2048], [500_000, 96, 96], [500_000, 32, 32]];

/// `candle`'s product, which is that of the `gemm` crate.
#[divan::bench(consts = [0, 1, 2], sample_count = 15, sample_size = 1)]
fn gemm_crate<const SHAPE: usize>(bencher: Bencher) {
    let [rows, depth, columns] = SHAPES[SHAPE];
    let tensor = |a: usize, b: usize| Tensor::from_vec(values(a * b, 1), (a, b), &Device::Cpu).unwrap();
    let (left, right) = (tensor(rows, depth), tensor(depth, columns));
    bencher.counter(ItemsCount::new(2 * rows * depth * columns)).bench_local(|| left.matmul(&right));
}

/// The engine's product.
#[divan::bench(consts = [0, 1, 2], sample_count = 15, sample_size = 1)]
fn dense<const SHAPE: usize>(bencher: Bencher) {
    let [rows, depth, columns] = SHAPES[SHAPE];
    let left = values(rows * depth, 1);
    let right = Packed::of_checkpoint(&values(depth * columns, 2), depth, columns);
    let mut out = vec![0.0; rows * columns];
    bencher
        .counter(ItemsCount::new(2 * rows * depth * columns))
        .bench_local(|| multiply_into(&left, &right, &[], &mut out));
}

/// `candle`'s product of half-precision numbers.
#[divan::bench(consts = [0, 1, 2], sample_count = 15, sample_size = 1)]
fn gemm_crate_f16<const SHAPE: usize>(bencher: Bencher) {
    let [rows, depth, columns] = SHAPES[SHAPE];
    let tensor = |a: usize, b: usize| {
        let wide = Tensor::from_vec(values(a * b, 1), (a, b), &Device::Cpu).unwrap();
        wide.to_dtype(DType::F16).unwrap()
    };
    let (left, right) = (tensor(rows, depth), tensor(depth, columns));
    bencher.counter(ItemsCount::new(2 * rows * depth * columns)).bench_local(|| left.matmul(&right));
}

/// The engine's product of features that are stored in half precision: widened before, rounded after.
#[divan::bench(consts = [0, 1, 2], sample_count = 15, sample_size = 1)]
fn dense_of_stored_f16<const SHAPE: usize>(bencher: Bencher) {
    let [rows, depth, columns] = SHAPES[SHAPE];
    let mut stored = vec![f16::ZERO; rows * depth];
    stored.convert_from_f32_slice(&values(rows * depth, 1));
    let right = Packed::of_checkpoint(&values(depth * columns, 2), depth, columns);
    let (mut left, mut out) = (vec![0.0; rows * depth], vec![0.0; rows * columns]);
    let mut kept = vec![f16::ZERO; rows * columns];
    bencher.counter(ItemsCount::new(2 * rows * depth * columns)).bench_local(|| {
        stored.convert_to_f32_slice(&mut left);
        multiply_into(&left, &right, &[], &mut out);
        kept.convert_from_f32_slice(&out);
    });
}
