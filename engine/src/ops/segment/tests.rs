//! Against the slow twins and finite differences of them.

use std::sync::Arc;

use candle_core::{Device, Result, Tensor, Var};

use super::{Segments, add_gathered, gather, gather_gated, max_pool, mean_pool, reference};
use crate::ops::test_support::{assert_close, assert_slope, doubles, values};

type Op = fn(&Tensor, &Arc<Segments>) -> Result<Tensor>;
type Twin = fn(&[f64], &[u32], usize, usize) -> Vec<f64>;

#[test]
fn values_and_gradients_equal_the_twins() {
    let (num_segments, width) = (7, 3);
    // Segment 3 has no row.
    let segment_of: Vec<u32> =
        values(40, 9).iter().map(|v| if *v < -0.7 { 6 } else { u32::from(*v > -0.2) + u32::from(*v > 0.4) }).collect();
    let segments = Arc::new(Segments::new(segment_of.clone(), num_segments).unwrap());
    let cases: [(&str, Op, Twin, usize, usize); 3] = [
        ("max", max_pool, reference::max_pool, 40, 7),
        ("mean", mean_pool, reference::mean_pool, 40, 7),
        ("gather", gather, reference::gather, 7, 40),
    ];
    for (what, op, twin, rows, outputs) in cases {
        let x = values(rows * width, 1);
        let v = values(outputs * width, 2);
        let var = Var::from_tensor(&Tensor::from_slice(&x, (rows, width), &Device::Cpu).unwrap()).unwrap();
        let out = op(&var, &segments).unwrap();
        assert_close(what, &out, &twin(&doubles(&x), &segment_of, num_segments, width), 1e-6);
        let weights = Tensor::from_slice(&v, (outputs, width), &Device::Cpu).unwrap();
        let grads = (out * weights).unwrap().sum_all().unwrap().backward().unwrap();
        assert_slope(what, grads.get(&var).unwrap(), &doubles(&x), 1e-6, |x| {
            twin(x, &segment_of, num_segments, width).iter().zip(&v).map(|(o, &v)| o * f64::from(v)).sum()
        });
    }
}

/// Both ways of a sum, and the gated rows, against the operations that they are made of.
#[test]
fn gathered_rows_added_and_gated() {
    let segment_of: Vec<u32> = values(40, 9).iter().map(|v| u32::from(*v > -0.2) + u32::from(*v > 0.4)).collect();
    let segments = Arc::new(Segments::new(segment_of, 3).unwrap());
    let tensor = |rows: usize, width: usize, seed| {
        Tensor::from_vec(values(rows * width, seed), (rows, width), &Device::Cpu).unwrap()
    };
    let (x, rows, v) = (Var::from_tensor(&tensor(3, 7, 1)).unwrap(), tensor(40, 7, 2), tensor(40, 7, 3));
    let sum = (&rows + gather(&x, &segments).unwrap()).unwrap().to_vec2::<f32>().unwrap();
    for x in [x.as_tensor().clone(), x.as_detached_tensor()] {
        let got = add_gathered(rows.copy().unwrap(), &x, &segments).unwrap();
        assert_eq!(got.to_vec2::<f32>().unwrap(), sum);
    }
    assert!(add_gathered(rows.copy().unwrap(), &tensor(3, 6, 1), &segments).is_err());
    for num_inputs in [0, 2, 5] {
        let (inputs, used) = (tensor(40, num_inputs, 4), num_inputs.min(3));
        let gathered = gather(&x, &segments).unwrap();
        let part = |first: usize, width: usize| gathered.narrow(1, first, width).unwrap();
        let inputs_used = inputs.narrow(1, 0, used).unwrap();
        let (added, gated) = ((part(0, used) + &inputs_used).unwrap(), (part(used, used) * &inputs_used).unwrap());
        let want = Tensor::cat(&[added, gated, part(2 * used, 7 - 2 * used)], 1).unwrap();
        let got = gather_gated(&x, &inputs, &segments).unwrap();
        assert_eq!(got.to_vec2::<f32>().unwrap(), want.to_vec2::<f32>().unwrap());
        let gradient = |out: &Tensor| {
            let grads = (out * &v).unwrap().sum_all().unwrap().backward().unwrap();
            grads.get(&x).unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap()
        };
        assert_close("gradient", &Tensor::new(gradient(&got), &Device::Cpu).unwrap(), &doubles(&gradient(&want)), 1e-6);
        assert!(gather_gated(&x, &tensor(39, 2, 1), &segments).is_err());
    }
}

#[test]
fn equal_values_send_the_gradient_to_the_first() {
    let segments = Arc::new(Segments::new(vec![0, 1, 0, 0], 2).unwrap());
    let x = Var::from_slice(&[1.0_f32, 5.0, 2.0, 2.0], (4, 1), &Device::Cpu).unwrap();
    let grads = max_pool(&x, &segments).unwrap().sum_all().unwrap().backward().unwrap();
    assert_close("ties", grads.get(&x).unwrap(), &[0.0, 1.0, 1.0, 0.0], 0.0);
}

#[test]
fn no_number_is_not_lost_and_shapes_are_checked() {
    let segments = Arc::new(Segments::new(vec![0, 0, 0], 1).unwrap());
    for place in 0..3 {
        let mut x = [1.0_f32; 3];
        x[place] = f32::NAN;
        let out = max_pool(&Tensor::from_slice(&x, (3, 1), &Device::Cpu).unwrap(), &segments).unwrap();
        assert!(out.flatten_all().unwrap().to_vec1::<f32>().unwrap()[0].is_nan());
    }
    assert!(max_pool(&Tensor::zeros((2, 1), candle_core::DType::F32, &Device::Cpu).unwrap(), &segments).is_err());
    assert!(Segments::new(vec![0, 2], 2).is_err());
}
