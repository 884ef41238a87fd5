//! Against the slow twin, and what makes a curve a curve.

use proptest::prelude::*;

use super::{Curve, DEPTH_MAX, codes, depth_of, order, reference};

const CURVES: [Curve; 4] = [Curve::Z, Curve::ZTransposed, Curve::Hilbert, Curve::HilbertTransposed];

fn twin(&[batch, x, y, z]: &[i32; 4], curve: Curve, depth: u32) -> u64 {
    let [batch, x, y, z] = [batch, x, y, z].map(|c| u32::try_from(c).unwrap());
    let along = match curve {
        Curve::Z => reference::morton([x, y, z], depth),
        Curve::ZTransposed => reference::morton([y, x, z], depth),
        Curve::Hilbert => reference::hilbert([x, y, z], depth),
        Curve::HilbertTransposed => reference::hilbert([y, x, z], depth),
    };
    u64::from(batch) << (3 * depth) | along
}

proptest! {
    #[test]
    fn equals_the_twin(
        rows in prop::collection::vec((0i32..5, [0i32..65536, 0i32..65536, 0i32..65536]), 0..50),
        bits in 0u32..=DEPTH_MAX,
    ) {
        let coords: Vec<[i32; 4]> = rows.iter().map(|(b, p)| [*b, p[0], p[1], p[2]].map(|c| c % (1 << bits).max(5))).collect();
        let depth = depth_of(&coords).unwrap();
        for curve in CURVES {
            let got = codes(&coords, curve, depth).unwrap();
            let want: Vec<u64> = coords.iter().map(|c| twin(c, curve, depth)).collect();
            prop_assert_eq!(&got, &want);
            // The coarser grid's codes are the codes without their last three bits.
            if depth > 0 {
                let halved: Vec<[i32; 4]> = coords.iter().map(|&[b, x, y, z]| [b, x >> 1, y >> 1, z >> 1]).collect();
                let shifted: Vec<u64> = got.iter().map(|c| c >> 3).collect();
                prop_assert_eq!(codes(&halved, curve, depth - 1).unwrap(), shifted);
            }
        }
    }
}

#[test]
fn hilbert_steps_to_a_face_neighbour_and_visits_all() {
    let coords: Vec<[i32; 4]> = (0..512).map(|i| [0, i >> 6, i >> 3 & 7, i & 7]).collect();
    for curve in CURVES {
        let codes = codes(&coords, curve, 3).unwrap();
        let path = order(&codes);
        let mut sorted = codes.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, (0..512).collect::<Vec<u64>>());
        if matches!(curve, Curve::Hilbert | Curve::HilbertTransposed) {
            for pair in path.rows.windows(2) {
                let [a, b] = [pair[0], pair[1]].map(|row| coords[row as usize]);
                let step: i32 = a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum();
                assert_eq!(step, 1, "{curve:?}: {a:?} to {b:?}");
            }
        }
    }
}

#[test]
fn orders_keep_ties_and_invert() {
    let path = order(&[5, 2, 5, 0, 2]);
    assert_eq!(path.rows, [3, 1, 4, 0, 2]);
    assert_eq!(path.positions, [3, 1, 4, 0, 2]);
    for (position, &row) in path.rows.iter().enumerate() {
        assert_eq!(path.positions[row as usize] as usize, position);
    }
    assert!(order(&[]).rows.is_empty());
}

#[test]
fn refuses_what_does_not_fit() {
    assert_eq!(depth_of(&[]).unwrap(), 0);
    assert_eq!(depth_of(&[[9, 0, 0, 0]]).unwrap(), 0);
    assert_eq!(depth_of(&[[0, 3, 0, 8]]).unwrap(), 4);
    assert!(codes(&[[0, 15, 15, 15], [0, 0, 16, 0]], Curve::Hilbert, 4).unwrap_err().to_string().contains("row 1"));
    assert!(codes(&[[0, -1, 0, 0]], Curve::Z, 4).is_err());
    assert!(codes(&[[-1, 0, 0, 0]], Curve::Z, 4).is_err());
    assert!(codes(&[[1 << 15, 0, 0, 0]], Curve::Z, DEPTH_MAX).is_err());
    assert!(codes(&[[(1 << 15) - 1, 0, 0, 0]], Curve::Z, DEPTH_MAX).is_ok());
    assert!(codes(&[], Curve::Z, DEPTH_MAX + 1).is_err());
    assert!(depth_of(&[[0, 0, 1 << 16, 0]]).unwrap_err().to_string().contains("row 0"));
    assert!(depth_of(&[[0, 0, 0, 0], [0, 0, -3, 0]]).unwrap_err().to_string().contains("row 1"));
}
