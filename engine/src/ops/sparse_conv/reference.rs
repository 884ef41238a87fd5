//! The slow twin: obvious, in f64, over a hash map; imports nothing from the fast path.

use std::collections::HashMap;

/// Sparse convolution by looking up every neighbour.
///
/// # Formula
/// `out[q] = sum_o W[o] in[stride q + o - origin]`, the sum over the offsets that hit an occupied voxel; `origin` is `kernel / 2` for an odd
/// kernel and 0 for an even one.
///
/// # Shapes
/// `coords` `[M]` and `out_coords` `[Q]` of batch, x, y, z; `features` `[M, cin]`; `weight` `[cout, kernel^3, cin]`; result `[Q, cout]`.
pub fn convolve(
    coords: &[[i32; 4]],
    features: &[f64],
    out_coords: &[[i32; 4]],
    weight: &[f64],
    kernel: usize,
    stride: i32,
) -> Vec<f64> {
    if coords.is_empty() {
        return Vec::new();
    }
    let cin = features.len() / coords.len();
    let cout = weight.len() / (kernel.pow(3) * cin);
    let row_of: HashMap<[i32; 4], usize> = coords.iter().enumerate().map(|(i, c)| (*c, i)).collect();
    let mut out = vec![0.0; out_coords.len() * cout];
    for (q, &[b, x, y, z]) in out_coords.iter().enumerate() {
        for (o, [dx, dy, dz]) in offsets(kernel).into_iter().enumerate() {
            if let Some(&i) = row_of.get(&[b, stride * x + dx, stride * y + dy, stride * z + dz]) {
                for c in 0..cout {
                    let w = &weight[(c * kernel.pow(3) + o) * cin..][..cin];
                    let f = &features[i * cin..][..cin];
                    out[q * cout + c] += w.iter().zip(f).map(|(w, f)| w * f).sum::<f64>();
                }
            }
        }
    }
    out
}

/// The transposed convolution with kernel 2 and stride 2, from coarse voxels back to the fine ones.
///
/// # Shapes
/// `coarse` `[Q]` with `features` `[Q, cin]`; `fine` `[M]`; `weight` `[cout, 8, cin]`; result `[M, cout]`.
pub fn convolve_transposed(coarse: &[[i32; 4]], features: &[f64], fine: &[[i32; 4]], weight: &[f64]) -> Vec<f64> {
    if coarse.is_empty() {
        return Vec::new();
    }
    let cin = features.len() / coarse.len();
    let cout = weight.len() / (8 * cin);
    let row_of: HashMap<[i32; 4], usize> = coarse.iter().enumerate().map(|(i, c)| (*c, i)).collect();
    let mut out = vec![0.0; fine.len() * cout];
    for (i, &[b, x, y, z]) in fine.iter().enumerate() {
        let parity = [x, y, z].map(|v| v.rem_euclid(2));
        if let Some(&q) = row_of.get(&[b, x.div_euclid(2), y.div_euclid(2), z.div_euclid(2)]) {
            for (o, _) in offsets(2).into_iter().enumerate().filter(|(_, offset)| *offset == parity) {
                for c in 0..cout {
                    let w = &weight[(c * 8 + o) * cin..][..cin];
                    let f = &features[q * cin..][..cin];
                    out[i * cout + c] = w.iter().zip(f).map(|(w, f)| w * f).sum();
                }
            }
        }
    }
    out
}

fn offsets(kernel: usize) -> Vec<[i32; 3]> {
    let k = i32::try_from(kernel).unwrap_or(1);
    let origin = if k % 2 == 1 { k / 2 } else { 0 };
    let range = || -origin..k - origin;
    range().flat_map(|x| range().flat_map(move |y| range().map(move |z| [x, y, z]))).collect()
}
