//! Against the slow twin, and at the edges.

use std::num::NonZeroUsize;

use crate::error::Result;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use proptest::prelude::*;

use super::{
    NO_NEIGHBOUR, Neighbours, nearest_of, nearest_other_time, nearest_other_time_of, reference, squared_distance,
};

/// Of every point.
fn nearest(points: &[[f32; 3]], k: usize) -> Result<Neighbours> {
    nearest_of(points, &(0..).take(points.len()).collect::<Vec<u32>>(), k)
}

fn assert_equal(points: &[[f32; 3]], groups: &[u32], k: usize) {
    let got = nearest_other_time(points, groups, k).unwrap();
    let want = reference::nearest_of_other_groups(points, groups, k);
    for (i, (got, want)) in got.indices.chunks(k).zip(want.chunks(k)).enumerate() {
        assert_eq!(got, want, "point {i} of {}, k {k}", points.len());
    }
    assert_eq!(got.indices.len(), want.len());
}

proptest! {
    #[test]
    fn equals_the_twin(
        points in prop::collection::vec(([-40i16..40, -40i16..40, -4i16..4], 0u32..3), 0..300),
        scale in prop::sample::select(vec![1e-30_f32, 0.37, 1e25]),
        k in 1usize..12,
    ) {
        // Integer positions: many coincident points and equal distances.
        let positions: Vec<[f32; 3]> = points.iter().map(|(p, _)| p.map(|c| f32::from(c) * scale)).collect();
        let groups: Vec<u32> = points.iter().map(|(_, g)| *g).collect();
        assert_equal(&positions, &groups, k);
        let own: Vec<u32> = (0..).take(positions.len()).collect();
        prop_assert_eq!(
            nearest(&positions, k).unwrap().indices,
            reference::nearest_of_other_groups(&positions, &own, k)
        );
        // A part of the points, in another order and one of them twice.
        let mut some: Vec<u32> = own.iter().rev().step_by(3).copied().collect();
        some.extend(some.first().copied());
        let rows = |all: &[u32]| some.iter().flat_map(|&i| all[i as usize * k..][..k].to_vec()).collect::<Vec<u32>>();
        prop_assert_eq!(nearest_of(&positions, &some, k).unwrap().indices, rows(&nearest(&positions, k).unwrap().indices));
        prop_assert_eq!(
            nearest_other_time_of(&positions, &groups, &some, k).unwrap().indices,
            rows(&nearest_other_time(&positions, &groups, k).unwrap().indices)
        );
    }
}

#[test]
fn none_one_and_fewer_than_k() {
    assert!(nearest(&[], 8).unwrap().indices.is_empty());
    assert_eq!(nearest(&[[1.0; 3]], 2).unwrap().indices, [NO_NEIGHBOUR; 2]);
    assert_eq!(nearest_other_time(&[[1.0; 3]; 5], &[3; 5], 1).unwrap().indices, [NO_NEIGHBOUR; 5]);
    let three = nearest(&[[0.0; 3], [2.0, 0.0, 0.0], [3.0, 0.0, 0.0]], 4).unwrap();
    assert_eq!(three.indices[4..8], [2, 0, NO_NEIGHBOUR, NO_NEIGHBOUR]);
    assert_eq!(three.of(1), [2, 0]);
    assert!(nearest(&[[1.0; 3]; 3], 0).unwrap().indices.is_empty());
}

#[test]
fn refuses_what_is_not_finite_and_wrong_lengths() {
    let error = nearest(&[[0.0; 3], [0.0, f32::NAN, 0.0]], 1).unwrap_err();
    assert!(error.to_string().contains("point 1, y"), "{error}");
    assert!(nearest_other_time(&[[0.0, 0.0, f32::INFINITY]], &[0], 1).is_err());
    assert!(nearest_other_time(&[[0.0; 3]; 2], &[0], 1).is_err());
    assert!(nearest_of(&[[0.0; 3]; 2], &[2], 1).unwrap_err().to_string().contains("below 2, found 2"));
    assert!(nearest_other_time_of(&[[0.0; 3]; 2], &[0], &[1], 1).is_err());
    assert!(nearest_of(&[], &[], 3).unwrap().indices.is_empty());
}

#[test]
fn distances_are_those_of_an_independent_tree() {
    let points: Vec<[f32; 3]> = (0..20_000_u32)
        .map(|i| [0.754_877_7_f32, 0.569_840_3, 0.219_51].map(|a| (i as f32 * a).fract() * 80.0))
        .collect();
    let tree = ImmutableKdTree::<f32, 3>::new_from_slice(&points).unwrap();
    let found = nearest(&points, 8).unwrap();
    for (i, point) in points.iter().enumerate() {
        let with_itself = tree.query(point).nearest_n::<SquaredEuclidean<f32>>(NonZeroUsize::new(9).unwrap()).execute();
        for (theirs, &ours) in with_itself[1..].iter().zip(found.of(i)) {
            let ours = squared_distance(point, &points[ours as usize]);
            let theirs = f64::from(theirs.distance);
            assert!((theirs - ours).abs() <= 1e-5 * ours, "point {i}: {ours}, theirs {theirs}");
        }
    }
}

#[test]
fn many_coincident_points_by_index() {
    let n: u32 = 50_000;
    let points = vec![[3.5, -1.0, 0.25]; n as usize];
    let mixed: Vec<u32> = (0..n).map(|i| i % 3).collect();
    let found = nearest_other_time(&points, &mixed, 4).unwrap();
    assert_eq!(found.of(0), [1, 2, 4, 5]);
    assert_eq!(found.of(49_999), [0, 2, 3, 5]);
    let blocks: Vec<u32> = (0..n).map(|i| i / 20_000).collect();
    let found = nearest_other_time(&points, &blocks, 3).unwrap();
    assert_eq!(found.of(7), [20_000, 20_001, 20_002]);
    assert_eq!(found.of(30_000), [0, 1, 2]);
    assert_eq!(nearest(&points, 3).unwrap().of(1), [0, 2, 3]);
}

#[test]
fn same_bits_on_any_number_of_threads() {
    let points: Vec<[f32; 3]> = (0..40_000_u32)
        .map(|i| [0.754_877_7_f32, 0.569_840_3, 0.219_51].map(|a| (i as f32 * a).fract() * 30.0))
        .collect();
    let groups: Vec<u32> = (0..40_000).map(|i| i % 5).collect();
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| nearest_other_time(&points, &groups, 8).unwrap())
    };
    assert_eq!(on(1), on(3));
}
