//! Against the slow twin and finite differences of it.

use std::sync::Arc;

use candle_core::{Device, Tensor, Var};

use super::{Patches, attention, reference};
use crate::ops::serialization::order;
use crate::ops::test_support::{assert_close, assert_slope, doubles, values};

fn patches(rows: usize, size: usize) -> Arc<Patches> {
    let codes: Vec<u64> = values(rows, 3).iter().map(|v| u64::from((v + 2.0).to_bits())).collect();
    Arc::new(Patches::new(order(&codes), &[rows], size).unwrap())
}

fn check(rows: usize, [channels, num_heads, size]: [usize; 3], slopes: bool) {
    let patches = patches(rows, size);
    let qkv: Vec<f32> = values(rows * 3 * channels, 1).iter().map(|v| 2.0 * v).collect();
    let v = values(rows * channels, 2);
    let var = Var::from_tensor(&Tensor::from_slice(&qkv, (rows, 3 * channels), &Device::Cpu).unwrap()).unwrap();
    let out = attention(&var, num_heads, &patches).unwrap();
    let twin = |qkv: &[f64]| reference::attention(qkv, num_heads, patches.rows(), size);
    let what = format!("{rows} rows, {channels} channels, {num_heads} heads, patches of {size}");
    assert_close(&what, &out, &twin(&doubles(&qkv)), 2e-6);
    if slopes {
        let weights = Tensor::from_slice(&v, (rows, channels), &Device::Cpu).unwrap();
        let grads = (out * weights).unwrap().sum_all().unwrap().backward().unwrap();
        assert_slope(&what, grads.get(&var).unwrap(), &doubles(&qkv), 1e-5, |qkv| {
            twin(qkv).iter().zip(&v).map(|(o, &v)| o * f64::from(v)).sum()
        });
    }
}

#[test]
fn values_equal_the_twin() {
    for (rows, sizes) in
        [(1, [4, 2, 8]), (300, [32, 2, 128]), (257, [24, 3, 128]), (128, [64, 1, 128]), (500, [96, 3, 100])]
    {
        check(rows, sizes, false);
    }
}

#[test]
fn gradients_equal_the_twin() {
    check(13, [6, 3, 5], true);
    check(9, [4, 1, 20], true);
    check(37, [2, 1, 35], true);
}

#[test]
fn large_scores_do_not_overflow() {
    let patches = patches(40, 16);
    let qkv: Vec<f32> = values(40 * 24, 1).iter().map(|v| 300.0 * v).collect();
    let out = attention(&Tensor::from_slice(&qkv, (40, 24), &Device::Cpu).unwrap(), 2, &patches).unwrap();
    assert_close("large scores", &out, &reference::attention(&doubles(&qkv), 2, patches.rows(), 16), 1e-3);
}

#[test]
fn refuses_shapes_that_do_not_fit() {
    let t = |shape: (usize, usize)| Tensor::zeros(shape, candle_core::DType::F32, &Device::Cpu).unwrap();
    assert!(attention(&t((40, 24)), 3, &patches(40, 16)).is_err());
    assert!(attention(&t((40, 24)), 2, &patches(39, 16)).is_err());
    assert!(attention(&t((40, 25)), 2, &patches(40, 16)).is_err());
    assert!(attention(&t((40, 24)), 0, &patches(40, 16)).is_err());
}
