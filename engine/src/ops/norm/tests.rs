//! Against the slow twins and finite differences of them.

use candle_core::{Device, Tensor, Var};

use super::{batch_norm, layer_norm, reference};
use crate::ops::test_support::{assert_close, assert_slope, doubles, values};

const EPS: f64 = 1e-3;

fn check(rows: usize, width: usize, batch: bool) {
    let [x, w, b, v] = [(rows * width, 1), (width, 2), (width, 3), (rows * width, 4)].map(|(n, seed)| values(n, seed));
    let var =
        |v: &[f32], shape: &[usize]| Var::from_tensor(&Tensor::from_slice(v, shape, &Device::Cpu).unwrap()).unwrap();
    let (tx, tw, tb) = (var(&x, &[rows, width]), var(&w, &[width]), var(&b, &[width]));
    let out = if batch { batch_norm(&tx, &tw, &tb, EPS).unwrap().0 } else { layer_norm(&tx, &tw, &tb, 1e-3).unwrap() };
    let twin = if batch { reference::batch_norm } else { reference::layer_norm };
    let (x, w, b, v) = (doubles(&x), doubles(&w), doubles(&b), doubles(&v));
    let what = format!("batch {batch}, {rows} x {width}");
    assert_close(&what, &out, &twin(&x, &w, &b, EPS), 2e-6);
    let weights: Vec<f32> = values(rows * width, 4);
    let weighted = (out * Tensor::from_slice(&weights, (rows, width), &Device::Cpu).unwrap()).unwrap();
    let grads = weighted.sum_all().unwrap().backward().unwrap();
    let loss = |out: Vec<f64>| out.iter().zip(&v).map(|(o, v)| o * v).sum::<f64>();
    assert_slope(&what, grads.get(&tx).unwrap(), &x, 1e-5, |x| loss(twin(x, &w, &b, EPS)));
    assert_slope(&what, grads.get(&tw).unwrap(), &w, 1e-5, |w| loss(twin(&x, w, &b, EPS)));
    assert_slope(&what, grads.get(&tb).unwrap(), &b, 1e-5, |b| loss(twin(&x, &w, b, EPS)));
}

#[test]
fn values_and_gradients_equal_the_twins() {
    for (rows, width) in [(1, 3), (9, 24), (5, 67)] {
        check(rows, width, false);
    }
    for (rows, width) in [(2, 1), (17, 9), (31, 5)] {
        check(rows, width, true);
    }
}

#[test]
fn batch_statistics_over_many_pieces() {
    let (rows, width) = (9_000, 3);
    let x: Vec<f32> = values(rows * width, 5).iter().map(|v| 1000.0 + v).collect();
    let tensor = Tensor::from_slice(&x, (rows, width), &Device::Cpu).unwrap();
    let one = Tensor::ones(width, candle_core::DType::F32, &Device::Cpu).unwrap();
    let (out, statistics) = batch_norm(&tensor, &one, &one.zeros_like().unwrap(), 1e-12).unwrap();
    let column: Vec<f64> = x.iter().step_by(width).map(|&v| f64::from(v)).collect();
    let mean = column.iter().sum::<f64>() / rows as f64;
    assert!((statistics.mean[0] - mean).abs() < 1e-9);
    let variance = out.sqr().unwrap().mean(0).unwrap().to_vec1::<f32>().unwrap();
    assert!(variance.iter().all(|v| (v - 1.0).abs() < 1e-3), "{variance:?}");
    assert_eq!(statistics.count, rows);
}

#[test]
fn none_and_shapes_that_do_not_fit() {
    let t = |shape: &[usize]| Tensor::zeros(shape, candle_core::DType::F32, &Device::Cpu).unwrap();
    assert_eq!(layer_norm(&t(&[0, 4]), &t(&[4]), &t(&[4]), 1e-5).unwrap().dims(), [0, 4]);
    assert!(layer_norm(&t(&[2, 4]), &t(&[3]), &t(&[4]), 1e-5).is_err());
    assert!(batch_norm(&t(&[2, 0]), &t(&[0]), &t(&[0]), EPS).is_err());
}
