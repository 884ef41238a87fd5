//! Against the slow twin and its finite differences.

use std::sync::Arc;

use candle_core::{Device, Tensor, Var};

use super::{Layer, linear, reference};
use crate::ops::test_support::{assert_close, doubles, values};

fn check(rows: usize, inputs: usize, outputs: usize) {
    let [x, w, b, v] =
        [(rows * inputs, 1), (inputs * outputs, 2), (outputs, 3), (rows * outputs, 4)].map(|(n, seed)| values(n, seed));
    let var =
        |v: &[f32], shape: &[usize]| Var::from_tensor(&Tensor::from_slice(v, shape, &Device::Cpu).unwrap()).unwrap();
    let (tx, tw, tb) = (var(&x, &[rows, inputs]), var(&w, &[outputs, inputs]), var(&b, &[outputs]));
    let out = linear(&tx, &tw, &tb).unwrap();
    let what = format!("{rows} x {inputs} -> {outputs}");
    assert_close(&what, &out, &reference::linear(&doubles(&x), &doubles(&w), &doubles(&b)), 1e-5);
    let layer = Arc::new(Layer::new(&tw, &tb).unwrap());
    let list = |t: &Tensor| t.to_vec2::<f32>().unwrap();
    assert_eq!(list(&layer.forward(&tx).unwrap()), list(&out), "{what}: packed once");
    let onto = Tensor::from_slice(&v, (rows, outputs), &Device::Cpu).unwrap();
    let sum = (&onto + &out).unwrap();
    assert_eq!(list(&layer.add_to(onto, &tx).unwrap()), list(&sum), "{what}: added");
    let weights = Tensor::from_slice(&v, (rows, outputs), &Device::Cpu).unwrap();
    let grads = (out * weights).unwrap().sum_all().unwrap().backward().unwrap();
    // The loss is linear in each argument: its gradients are products themselves.
    let transposed = |m: &[f32], columns: usize| -> Vec<f64> {
        (0..columns).flat_map(|c| m.chunks_exact(columns).map(move |row| f64::from(row[c]))).collect()
    };
    let zeros = |n: usize| vec![0.0; n];
    if rows == 0 {
        assert!(grads.get(&tw).unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap().iter().all(|&g| g == 0.0));
        return;
    }
    assert_close(
        &what,
        grads.get(&tx).unwrap(),
        &reference::linear(&doubles(&v), &transposed(&w, inputs), &zeros(inputs)),
        1e-5,
    );
    let v_w = reference::linear(&transposed(&v, outputs), &transposed(&x, inputs), &zeros(inputs));
    assert_close(&what, grads.get(&tw).unwrap(), &v_w, 1e-5);
    let v_b: Vec<f64> = transposed(&v, outputs).chunks_exact(rows).map(|column| column.iter().sum()).collect();
    assert_close(&what, grads.get(&tb).unwrap(), &v_b, 1e-5);
}

#[test]
fn values_and_gradients_equal_the_twin() {
    for (rows, inputs, outputs) in [(1, 1, 1), (7, 5, 33), (300, 64, 96), (523, 24, 72), (513, 37, 64), (0, 4, 4)] {
        check(rows, inputs, outputs);
    }
}

#[test]
fn refuses_shapes_that_do_not_fit() {
    let t = |shape: (usize, usize)| Tensor::zeros(shape, candle_core::DType::F32, &Device::Cpu).unwrap();
    let bias = t((1, 4)).squeeze(0).unwrap();
    assert!(linear(&t((3, 5)), &t((4, 6)), &bias).is_err());
    assert!(linear(&t((3, 5)), &t((3, 5)), &bias).is_err());
    assert!(Arc::new(Layer::new(&t((4, 6)), &bias).unwrap()).forward(&t((3, 5))).is_err());
}
