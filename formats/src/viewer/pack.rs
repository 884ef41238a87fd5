//! A scene in the bytes that the page's `scene.js` reads.

use crate::cloud::{SH_DC, SplatCloud};

/// Natural logarithms of scales that are told apart: from 2e-9 m to 22 km.
const LOG_SCALES: [f32; 2] = [-20.0, 10.0];

/// The scene as little-endian columns, N splats one after the other in each:
/// ```text
/// u32          N
/// f32          M, the largest component of a velocity, metres per second
/// f32 [N, 3]   means, metres
/// f32 [N]      times, seconds
/// i16 [N, 3]   velocities; 32767 is M
/// u16 [N, 3]   log scales; 0 is -20, 65535 is 10
/// i16 [N, 4]   quaternions w, x, y, z of length one; 32767 is 1
/// u16 [N]      opacities; 65535 is 1
/// u8  [N, 3]   colours; 255 is 1
/// ```
pub fn pack(cloud: &SplatCloud) -> Vec<u8> {
    let count = u32::try_from(cloud.len()).unwrap_or(u32::MAX);
    let fastest = cloud.velocities.iter().flatten().fold(0.0_f32, |most, v| most.max(v.abs()));
    let mut bytes = Vec::with_capacity(8 + 41 * cloud.len());
    bytes.extend(count.to_le_bytes());
    bytes.extend(fastest.to_le_bytes());
    let numbers = cloud.means.iter().flatten().chain(&cloud.times);
    bytes.extend(numbers.flat_map(|v| v.to_le_bytes()));
    let per_step = if fastest > 0.0 { 32767.0 / fastest } else { 0.0 };
    bytes.extend(cloud.velocities.iter().flatten().flat_map(|v| signed(v * per_step).to_le_bytes()));
    let [low, high] = LOG_SCALES;
    let steps = |v: f32| unsigned((v - low) / (high - low) * 65535.0).to_le_bytes();
    bytes.extend(cloud.log_scales.iter().flatten().flat_map(|&v| steps(v)));
    for quat in &cloud.quats {
        let length = quat.iter().map(|v| v * v).sum::<f32>().sqrt().max(f32::MIN_POSITIVE);
        bytes.extend(quat.iter().flat_map(|v| signed(v / length * 32767.0).to_le_bytes()));
    }
    let opacity = |logit: &f32| unsigned(65535.0 / (1.0 + (-logit).exp())).to_le_bytes();
    bytes.extend(cloud.logit_opacities.iter().flat_map(opacity));
    bytes.extend(cloud.sh_dc.iter().flatten().map(|v| byte((0.5 + SH_DC * v) * 255.0)));
    bytes
}

#[expect(clippy::cast_possible_truncation, reason = "clamped to the range; what is no number becomes 0")]
fn signed(value: f32) -> i16 {
    value.round().clamp(-32767.0, 32767.0) as i16
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "clamped to the range; what is no number becomes 0"
)]
fn unsigned(value: f32) -> u16 {
    value.round().clamp(0.0, 65535.0) as u16
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "clamped to the range; what is no number becomes 0"
)]
fn byte(value: f32) -> u8 {
    value.round().clamp(0.0, 255.0) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_stand_where_they_are_said_to_stand() {
        let cloud = SplatCloud {
            means: vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]],
            log_scales: vec![[-20.0, 10.0, -5.0]; 2],
            quats: vec![[2.0, 0.0, 0.0, 0.0], [0.0, -3.0, 0.0, 0.0]],
            logit_opacities: vec![0.0, 50.0],
            sh_dc: vec![[0.0; 3], [0.5 / SH_DC, -0.5 / SH_DC, 9.0]],
            velocities: vec![[0.0; 3], [-4.0, 2.0, 0.0]],
            times: vec![0.0, 0.1],
            frames: None,
            extra: Vec::new(),
        };
        let bytes = pack(&cloud);
        assert_eq!(bytes.len(), 8 + 41 * 2);
        let f32_at = |at: usize| f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        let i16_at = |at: usize| i16::from_le_bytes(bytes[at..at + 2].try_into().unwrap());
        let u16_at = |at: usize| u16::from_le_bytes(bytes[at..at + 2].try_into().unwrap());
        assert_eq!((u32::from_le_bytes(bytes[..4].try_into().unwrap()), f32_at(4)), (2, 4.0));
        assert_eq!([f32_at(8), f32_at(28), f32_at(32), f32_at(36)], [1.0, 6.0, 0.0, 0.1]);
        assert_eq!([i16_at(46), i16_at(48), i16_at(50)], [-32767, 16384, 0]);
        assert_eq!([u16_at(52), u16_at(54), u16_at(56)], [0, 65535, 32768]);
        assert_eq!([i16_at(64), i16_at(74)], [32767, -32767]);
        assert_eq!([u16_at(80), u16_at(82)], [32768, 65535]);
        assert_eq!(bytes[84..], [128, 128, 128, 255, 0, 255]);
    }
}
