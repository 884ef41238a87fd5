//! The property set of Spacetime Gaussians, which players of 4D scenes read.

use std::path::Path;

use crate::{
    cloud::SplatCloud,
    error::{FormatError, Result},
    ply::{check_lengths, encode},
    write::write_atomic,
};

const NAMES: [&str; 32] = [
    "x",
    "y",
    "z",
    "trbf_center",
    "trbf_scale",
    "nx",
    "ny",
    "nz",
    "motion_0",
    "motion_1",
    "motion_2",
    "motion_3",
    "motion_4",
    "motion_5",
    "motion_6",
    "motion_7",
    "motion_8",
    "f_dc_0",
    "f_dc_1",
    "f_dc_2",
    "opacity",
    "scale_0",
    "scale_1",
    "scale_2",
    "rot_0",
    "rot_1",
    "rot_2",
    "rot_3",
    "omega_0",
    "omega_1",
    "omega_2",
    "omega_3",
];
/// Natural logarithm of the temporal width in spans: a splat is there all the time.
const TRBF_SCALE: f32 = 5.0;

/// Writes a PLY file with the properties of Spacetime Gaussians. Their clock runs from 0 at `span[0]` to 1 at `span[1]`
/// seconds, so velocities are metres per span.
///
/// # Formula
/// `s = (t - span[0]) / (span[1] - span[0])`, `position(s) = (x, y, z) + motion_0..2 (s - trbf_center)`, higher powers and
/// `omega` zero; `opacity(s) = sigmoid(opacity) exp(-((s - trbf_center) / exp(trbf_scale))^2)`, which is within 0.005 % of
/// constant.
///
/// # Source
/// Li et al., Spacetime Gaussian Feature Splatting, CVPR 2024: the "lite" model, whose colours are plain.
///
/// # Errors
/// A span that is empty or not finite; columns of different lengths, values that are not finite, a path that cannot be written to.
pub fn write_stg(path: &Path, cloud: &SplatCloud, span: [f32; 2]) -> Result<()> {
    check_lengths(path, cloud)?;
    let length = span[1] - span[0];
    if !(length > 0.0 && length.is_finite()) {
        let found = format!("{} to {} s", span[0], span[1]);
        return Err(FormatError::invalid(path, "span of time", "a beginning before its end", found));
    }
    let record = |i: usize| {
        let ([x, y, z], [w, qx, qy, qz]) = (cloud.means[i], cloud.quats[i]);
        let [vx, vy, vz] = cloud.velocities[i].map(|v| v * length);
        let ([r, g, b], [sx, sy, sz]) = (cloud.sh_dc[i], cloud.log_scales[i]);
        let head = [x, y, z, (cloud.times[i] - span[0]) / length, TRBF_SCALE, 0.0, 0.0, 0.0, vx, vy, vz];
        let tail = [r, g, b, cloud.logit_opacities[i], sx, sy, sz, w, qx, qy, qz];
        head.into_iter().chain([0.0; 6]).chain(tail).chain([0.0; 4])
    };
    write_atomic(path, &encode(path, &NAMES, cloud.len(), record)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ply::read_ply;

    #[test]
    fn the_clock_runs_from_0_to_1_and_velocities_with_it() {
        let cloud = SplatCloud {
            means: vec![[1.0, 2.0, 3.0]],
            log_scales: vec![[-1.0, -2.0, -3.0]],
            quats: vec![[1.0, 0.0, 0.0, 0.0]],
            logit_opacities: vec![0.5],
            sh_dc: vec![[0.1, 0.2, 0.3]],
            velocities: vec![[10.0, 0.0, -1.0]],
            times: vec![0.3],
            frames: None,
            extra: Vec::new(),
        };
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("stg.ply");
        write_stg(&path, &cloud, [0.1, 0.5]).unwrap();
        let read = read_ply(&path).unwrap();
        assert_eq!((&read.means, &read.quats, &read.sh_dc), (&cloud.means, &cloud.quats, &cloud.sh_dc));
        let column = |name: &str| read.extra.iter().find(|(other, _)| other == name).unwrap().1[0];
        for (name, want) in [
            ("trbf_center", 0.5),
            ("motion_0", 4.0),
            ("motion_1", 0.0),
            ("motion_2", -0.4),
            ("motion_3", 0.0),
            ("omega_3", 0.0),
        ] {
            assert!((column(name) - want).abs() < 1e-6, "{name}: {}", column(name));
        }
        assert!(write_stg(&path, &cloud, [0.5, 0.5]).is_err());
    }
}
