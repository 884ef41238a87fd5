use flate2::read::GzDecoder;

use super::*;
use crate::cloud::SH_DC;

/// The bytes of a header.
const HEADER: usize = 16;

/// A quaternion x, y, z, w applied to a vector.
fn apply([x, y, z, w]: [f32; 4], v: [f32; 3]) -> [f32; 3] {
    glam::Quat::from_xyzw(x, y, z, w).mul_vec3(v.into()).into()
}

#[test]
fn the_turn_of_rotations_is_that_of_positions() {
    for v in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.3, -2.0, 5.0]] {
        let (got, want) = (apply(rotation([1.0, 0.0, 0.0, 0.0]), v), turned(v));
        assert!((0..3).all(|k| (got[k] - want[k]).abs() < 1e-5), "{got:?}, want {want:?}");
    }
    // a quarter about the vertical turns forward to the left, which is minus right
    let quarter = [0.5_f32.sqrt(), 0.0, 0.0, 0.5_f32.sqrt()];
    let got = apply(rotation(quarter), [1.0, 0.0, 0.0]);
    assert!((got[0] + 1.0).abs() < 1e-5, "{got:?}");
}

/// The values of 24-bit numbers with 12 bits behind the point.
fn positions(bytes: &[u8]) -> Vec<f32> {
    let value = |&[a, b, c]: &[u8; 3]| (i32::from_le_bytes([0, a, b, c]) >> 8) as f32 / 4096.0;
    bytes.as_chunks().0.iter().map(value).collect()
}

/// The rotation x, y, z, w of four bytes, by the rule of the format: what is missing makes the length 1.
fn unpacked_rotation(bytes: [u8; 4]) -> [f32; 4] {
    let bits = u32::from_le_bytes(bytes);
    let largest = (bits >> 30) as usize;
    let mut rotation = [0.0_f32; 4];
    for (k, i) in (0..4).filter(|&i| i != largest).enumerate() {
        let part = bits >> (20 - 10 * k);
        let magnitude = (part & 0x1ff) as f32 / 511.0 / 2.0_f32.sqrt();
        rotation[i] = if part >> 9 & 1 == 1 { -magnitude } else { magnitude };
    }
    rotation[largest] = (1.0 - rotation.iter().map(|v| v * v).sum::<f32>()).sqrt();
    rotation
}

#[test]
fn the_file_holds_the_splats_within_its_steps() {
    let cloud = SplatCloud {
        means: vec![[1.0, 2.0, 3.0], [5000.0, 0.0, 0.0], [-20.5, 0.25, 1999.0]],
        log_scales: vec![[-1.03, -2.0, -3.3]; 3],
        quats: vec![[0.9, 0.1, -0.2, 0.3]; 3],
        logit_opacities: vec![0.5; 3],
        sh_dc: vec![[0.4, -1.0, 1.2]; 3],
        velocities: vec![[0.0; 3]; 3],
        times: vec![0.0; 3],
        frames: None,
        extra: Vec::new(),
    };
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("scene.spz");
    assert_eq!(write_spz(&path, &cloud).unwrap(), Written { kept: 2, too_far: 1 });
    let mut bytes = Vec::new();
    GzDecoder::new(std::fs::File::open(&path).unwrap()).read_to_end(&mut bytes).unwrap();
    assert_eq!(bytes.len(), HEADER + 2 * 20);
    let near = |got: &[f32], want: &[f32], step: f32| {
        assert_eq!(got.len(), want.len());
        assert!(got.iter().zip(want).all(|(g, w)| (g - w).abs() <= step), "{got:?}, want {want:?}");
    };
    let column = |start: usize, len: usize| &bytes[HEADER + start..HEADER + start + len];
    let shares = |bytes: &[u8]| bytes.iter().map(|&b| f32::from(b) / 255.0).collect::<Vec<_>>();
    near(&positions(column(0, 18)), &[-2.0, 3.0, -1.0, -0.25, 1999.0, 20.5], 1.3e-4);
    near(&shares(column(18, 2)), &[1.0 / (1.0 + (-0.5_f32).exp()); 2], 1.0 / 510.0 + 1e-6);
    let colours: Vec<f32> = shares(column(20, 3)).iter().map(|v| (v - 0.5) / 0.15 * SH_DC).collect();
    near(&colours, &cloud.sh_dc[0].map(|v| v * SH_DC), 1.0 / 255.0);
    let scales: Vec<f32> = column(26, 3).iter().map(|&b| f32::from(b) / 16.0 - 10.0).collect();
    near(&scales, &cloud.log_scales[0], 1.0 / 32.0);
    let length = cloud.quats[0].iter().map(|v| v * v).sum::<f32>().sqrt();
    let want = rotation(cloud.quats[0].map(|v| v / length));
    let got = unpacked_rotation(column(32, 8).as_chunks().0[1]);
    let cosine: f32 = got.iter().zip(want).map(|(g, w)| g * w).sum();
    assert!(cosine.abs() > 1.0 - 1e-5, "{got:?}, want {want:?}");
}
