//! SPZ, the small files of web viewers: one moment, quantised.

use std::path::Path;

use spz::{CoordinateSystem, GaussianSplat, PackOptions};

use crate::{
    cloud::SplatCloud,
    error::{FormatError, Result},
    ply::check_lengths,
    write::write_atomic,
};

/// Positions are 24-bit integers of 1/4096 m: what lies farther out cannot be written.
const REACH: f32 = 2047.0;
/// Turns the clip's axes (x forward, y left, z up) into those of SPZ (x right, y up, z back): a quaternion w, x, y, z.
const TURN: [f32; 4] = [0.5, -0.5, 0.5, 0.5];

/// What came into the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Written {
    /// Splats in the file.
    pub kept: usize,
    /// Splats farther than 2047 m from the origin, which the format cannot hold.
    pub too_far: usize,
}

/// What came into the file: the cloud as it stands at its means, upright in viewers whose y axis points up.
///
/// Positions are exact to 0.13 mm, log scales to 1/32, opacities and colours to 1/510, rotations to 0.1 degrees.
///
/// # Errors
/// Columns of different lengths, more than 2^31 splats, a path that cannot be written to.
pub fn write_spz(path: &Path, cloud: &SplatCloud) -> Result<Written> {
    check_lengths(path, cloud)?;
    let near = |i: &usize| cloud.means[*i].iter().all(|v| v.abs() <= REACH);
    let kept: Vec<usize> = (0..cloud.len()).filter(near).collect();
    let too_many = |error: std::num::TryFromIntError| {
        FormatError::invalid(path, "splats", "at most 2147483647", format!("{}: {error}", kept.len()))
    };
    let splat = GaussianSplat {
        num_points: i32::try_from(kept.len()).map_err(too_many)?,
        spherical_harmonics_degree: 0,
        antialiased: false,
        positions: kept.iter().flat_map(|&i| turned(cloud.means[i])).collect(),
        scales: kept.iter().flat_map(|&i| cloud.log_scales[i]).collect(),
        rotations: kept.iter().flat_map(|&i| rotation(cloud.quats[i])).collect(),
        alphas: kept.iter().map(|&i| cloud.logit_opacities[i]).collect(),
        colors: kept.iter().flat_map(|&i| cloud.sh_dc[i]).collect(),
        spherical_harmonics: Vec::new(),
    };
    let options = PackOptions::builder().from(CoordinateSystem::RUB).build();
    let bytes = splat.serialize_as_packed_bytes(&options);
    let bytes = bytes.map_err(|e| FormatError::invalid(path, "splats", "what SPZ can hold", format!("{e:#}")))?;
    write_atomic(path, &bytes)?;
    Ok(Written { kept: kept.len(), too_far: cloud.len() - kept.len() })
}

fn turned([x, y, z]: [f32; 3]) -> [f32; 3] {
    [-y, z, -x]
}

/// The rotation in SPZ's axes and order: x, y, z, w.
fn rotation([w, x, y, z]: [f32; 4]) -> [f32; 4] {
    let [a, b, c, d] = TURN;
    [
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
        a * w - b * x - c * y - d * z,
    ]
}

#[cfg(test)]
mod tests {
    use spz::UnpackOptions;

    use super::*;
    use crate::cloud::SH_DC;

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
        let options = UnpackOptions::builder().to_coord_system(CoordinateSystem::RUB).build();
        let read = GaussianSplat::load_packed_from_file(&path, &options).unwrap();
        let near = |got: &[f32], want: &[f32], step: f32| {
            assert!(got.iter().zip(want).all(|(g, w)| (g - w).abs() <= step), "{got:?}, want {want:?}");
        };
        near(&read.positions, &[-2.0, 3.0, -1.0, -0.25, 1999.0, 20.5], 1.3e-4);
        near(&read.scales[..3], &cloud.log_scales[0], 1.0 / 32.0);
        near(
            &read.colors[..3].iter().map(|v| v * SH_DC).collect::<Vec<_>>(),
            &cloud.sh_dc[0].map(|v| v * SH_DC),
            1.0 / 255.0,
        );
        near(&[1.0 / (1.0 + (-read.alphas[0]).exp())], &[1.0 / (1.0 + (-0.5_f32).exp())], 1.0 / 255.0);
    }
}
