//! A scene as numbered plain PLY files, for players of 4D scenes.

use std::path::Path;

use crate::{
    casts::{rounded, to_f32, to_u32},
    cloud::SplatCloud,
    error::{FormatError, Result},
    ply::{Higher, write_plain_ply},
};

/// Largest number of files: a duration times a rate may ask for more than a disk holds.
const MAX_FILES: f64 = 100_000.0;

/// The number of files `00000.ply`, `00001.ply`, ... written into `directory`, which is made when it is missing: the scene at
/// the moments `span[0]`, `span[0] + 1 / rate`, ... up to `span[1]`, seconds; `rate` in files per second.
///
/// # Errors
/// A rate that is not positive or asks for more than 100,000 files; those of [`write_plain_ply`].
pub fn write_sequence(directory: &Path, cloud: &SplatCloud, span: [f32; 2], rate: f32) -> Result<u32> {
    let refused = |expected: String| FormatError::invalid(directory, "files per second", expected, rate.to_string());
    let count = num_files(span, rate).map_err(refused)?;
    std::fs::create_dir_all(directory).map_err(|e| FormatError::io(directory, "make", e))?;
    for index in 0..count {
        let moment = f64::from(span[0]) + f64::from(index) / f64::from(rate);
        write_plain_ply(&directory.join(format!("{index:05}.ply")), &cloud.at(to_f32(moment)), Higher::None)?;
    }
    Ok(count)
}

/// The number of files that [`write_sequence`] writes.
///
/// # Errors
/// What would be right, when the rate is not positive or asks for more than 100,000 files.
pub fn num_files(span: [f32; 2], rate: f32) -> std::result::Result<u32, String> {
    let length = f64::from(span[1]) - f64::from(span[0]);
    // a moment that rounding has put just behind the end still counts
    let steps = (length * f64::from(rate) + 1e-3).floor();
    if rate > 0.0 && (0.0..MAX_FILES).contains(&steps) {
        return Ok(to_u32(rounded(steps)) + 1);
    }
    Err(format!("a positive rate that makes at most {MAX_FILES} files of {length:.3} s"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ply::read_ply;

    fn one_that_moves() -> SplatCloud {
        SplatCloud {
            means: vec![[1.0, 2.0, 3.0]],
            log_scales: vec![[-1.0; 3]],
            quats: vec![[1.0, 0.0, 0.0, 0.0]],
            logit_opacities: vec![0.5],
            sh_dc: vec![[0.1; 3]],
            velocities: vec![[10.0, 0.0, -1.0]],
            times: vec![0.1],
            frames: None,
            extra: vec![("p_add".to_owned(), vec![0.5])],
        }
    }

    #[test]
    fn every_file_is_the_scene_at_its_moment() {
        let place = tempfile::tempdir().unwrap();
        let directory = place.path().join("sequence");
        assert_eq!(write_sequence(&directory, &one_that_moves(), [0.0, 0.2], 10.0).unwrap(), 3);
        for (index, x) in [0.0, 1.0, 2.0].into_iter().enumerate() {
            let cloud = read_ply(&directory.join(format!("{index:05}.ply"))).unwrap();
            assert!((cloud.means[0][0] - x).abs() < 1e-5, "{index}: {:?}", cloud.means);
            assert_eq!((cloud.velocities[0], cloud.extra.len()), ([0.0; 3], 0));
        }
        assert_eq!(std::fs::read_dir(&directory).unwrap().count(), 3);
    }

    #[test]
    fn rates_that_make_no_sense_are_refused() {
        for rate in [0.0, -1.0, f32::NAN, 1e9] {
            let error = write_sequence(Path::new("nowhere"), &one_that_moves(), [0.0, 1.0], rate).unwrap_err();
            assert!(error.to_string().contains("files per second"), "{error}");
        }
        assert!(!Path::new("nowhere").exists());
    }
}
