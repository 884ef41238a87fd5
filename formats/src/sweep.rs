//! `LiDAR` sweeps: little-endian f32 `x, y, z, intensity`, 16 bytes a return.

use std::path::Path;

use crate::{
    error::{FormatError, Result},
    read::{MAX_DATA_BYTES, file_size, read_file},
    returns,
    write::write_atomic,
};

/// Bytes of one return.
pub const RETURN_BYTES: usize = 16;
/// Largest coordinate of a return, metres: no sensor sees farther, and squares stay finite in f32.
pub const MAX_COORDINATE: f32 = 1e6;

/// The returns of one sweep, in file order. A sweep file holds positions and intensities; what else is known is in files beside it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sweep {
    /// `[N, 3]` positions in the `LiDAR` frame, metres.
    pub points: Vec<[f32; 3]>,
    /// `[N]` intensities, in the sensor's own scale.
    pub intensities: Vec<f32>,
    /// `[N]` when each was measured, seconds since the sweep's timestamp; `None` where nobody knows.
    pub times: Option<Vec<f32>>,
    /// `[N]` index of the sensor that measured each; `None` where there is one.
    pub sensors: Option<Vec<u8>>,
    /// `[N, 3]` where the sensor was when it measured each, metres, in the frame of `points`; `None` where that is the origin for all.
    pub origins: Option<Vec<[f32; 3]>>,
    /// Rows of the file that are no return: all their coordinates are NaN, as organised clouds have it where a beam met nothing.
    pub num_missing: usize,
}

/// The number of returns of a sweep file, from its size alone.
///
/// # Errors
/// A file that is missing, empty, or whose size is no multiple of [`RETURN_BYTES`].
pub fn count_returns(path: &Path) -> Result<usize> {
    let size = file_size(path, MAX_DATA_BYTES)?;
    let count = usize::try_from(size).unwrap_or(usize::MAX);
    check_size(path, count)?;
    Ok(count / RETURN_BYTES)
}

/// The sweep of a file, without rows that are no return.
///
/// # Errors
/// Those of [`count_returns`]; a row that is neither finite nor without any coordinate, or farther away than [`MAX_COORDINATE`], by its
/// index; no return at all.
pub fn read_sweep(path: &Path) -> Result<Sweep> {
    read_rows(path)?.without_missing(path)
}

/// The sweep of a file, rows that are no return among the others: for whom there are other files parallel to them.
///
/// # Errors
/// Those of [`read_sweep`] but for no return at all.
pub(crate) fn read_rows(path: &Path) -> Result<Sweep> {
    let bytes = read_file(path, MAX_DATA_BYTES)?;
    check_size(path, bytes.len())?;
    let count = bytes.len() / RETURN_BYTES;
    let mut sweep =
        Sweep { points: Vec::with_capacity(count), intensities: Vec::with_capacity(count), ..Sweep::default() };
    let (rows, _) = bytes.as_chunks::<RETURN_BYTES>();
    for (index, row) in rows.iter().enumerate() {
        let (values, _) = row.as_chunks::<4>();
        let [x, y, z, intensity] = [0, 1, 2, 3].map(|k| f32::from_le_bytes(values[k]));
        check_row(path, index, [x, y, z], intensity)?;
        sweep.points.push([x, y, z]);
        sweep.intensities.push(intensity);
    }
    Ok(sweep)
}

impl Sweep {
    /// The sweep of `[x, y, z, intensity]` rows that were read from `path`, those that are no return among them.
    ///
    /// # Errors
    /// No rows; one that is neither finite nor without any coordinate, or farther away than [`MAX_COORDINATE`], by its index.
    pub(crate) fn of_rows(path: &Path, rows: impl Iterator<Item = [f32; 4]>) -> Result<Self> {
        let mut sweep = Self::default();
        for (index, [x, y, z, intensity]) in rows.enumerate() {
            check_row(path, index, [x, y, z], intensity)?;
            sweep.points.push([x, y, z]);
            sweep.intensities.push(intensity);
        }
        if sweep.points.is_empty() {
            return Err(FormatError::invalid(path, "points", "at least one return", "none"));
        }
        Ok(sweep)
    }

    /// The sweep without its rows that are no return, which are counted; `path` is what errors name.
    ///
    /// # Errors
    /// No return at all.
    pub(crate) fn without_missing(self, path: &Path) -> Result<Self> {
        let measured: Vec<bool> = self.points.iter().map(|&point| !is_missing(point)).collect();
        let num_measured = measured.iter().filter(|&&measured| measured).count();
        if num_measured == 0 {
            return Err(FormatError::invalid(path, "points", "at least one return", "rows without any coordinate"));
        }
        let Self { points, intensities, times, sensors, origins, num_missing } = self;
        let num_missing = num_missing + measured.len() - num_measured;
        Ok(Self {
            points: kept(points, &measured),
            intensities: kept(intensities, &measured),
            times: times.map(|times| kept(times, &measured)),
            sensors: sensors.map(|sensors| kept(sensors, &measured)),
            origins: origins.map(|origins| kept(origins, &measured)),
            num_missing,
        })
    }

    /// The sweep with the times of its returns, seconds since its timestamp; `path` is what errors name.
    ///
    /// # Errors
    /// A time that is not finite or beyond [`returns::MAX_RETURN_TIME`], by its index.
    #[expect(clippy::cast_possible_truncation, reason = "seconds within a sweep, kept as f32 by the format")]
    pub(crate) fn with_times(self, path: &Path, times: impl Iterator<Item = f64>) -> Result<Self> {
        let times = returns::check_times(path, times.map(|time| time as f32).collect())?;
        Ok(Self { times: Some(times), ..self })
    }
}

/// Writes the positions and intensities that [`read_sweep`] gives back, bit for bit.
///
/// # Errors
/// A sweep that could not be read back, and a path that cannot be written to.
pub fn write_sweep(path: &Path, sweep: &Sweep) -> Result<()> {
    let (count, found) = (sweep.points.len(), sweep.intensities.len());
    if count != found {
        return Err(FormatError::invalid(path, "intensities", format!("{count} as points"), found.to_string()));
    }
    let mut bytes = Vec::with_capacity(count * RETURN_BYTES);
    for (index, (&[x, y, z], &intensity)) in sweep.points.iter().zip(&sweep.intensities).enumerate() {
        check_return(path, index, [x, y, z], intensity)?;
        for value in [x, y, z, intensity] {
            bytes.extend_from_slice(&value.to_le_bytes());
        }
    }
    check_size(path, bytes.len())?;
    write_atomic(path, &bytes)
}

/// Fails unless a file of `size` bytes holds whole returns and at least one.
fn check_size(path: &Path, size: usize) -> Result<()> {
    if size == 0 {
        return Err(FormatError::invalid(path, "file size", "at least one return of 16 bytes", "no points (0 bytes)"));
    }
    let rest = size % RETURN_BYTES;
    if rest != 0 {
        let found = format!("{size} bytes, {rest} too many (truncated?)");
        return Err(FormatError::invalid(path, "file size", "a multiple of 16 bytes (x, y, z, intensity)", found));
    }
    Ok(())
}

/// Those of `all` that are wanted.
fn kept<T>(all: Vec<T>, wanted: &[bool]) -> Vec<T> {
    all.into_iter().zip(wanted).filter_map(|(one, &wanted)| wanted.then_some(one)).collect()
}

/// Whether a row says that a beam met nothing.
fn is_missing(point: [f32; 3]) -> bool {
    point.iter().all(|v| v.is_nan())
}

/// Fails unless the row is no return, or one that a sensor can have measured.
fn check_row(path: &Path, index: usize, point: [f32; 3], intensity: f32) -> Result<()> {
    if is_missing(point) { Ok(()) } else { check_return(path, index, point, intensity) }
}

/// Fails unless the return is one that a sensor can have measured.
pub(crate) fn check_return(path: &Path, index: usize, point: [f32; 3], intensity: f32) -> Result<()> {
    let in_range = |v: f32| v.abs() <= MAX_COORDINATE; // false for NaN
    if in_range(point[0]) && in_range(point[1]) && in_range(point[2]) && intensity.is_finite() {
        return Ok(());
    }
    let [x, y, z] = point;
    Err(FormatError::invalid(
        path,
        format!("point {index}"),
        format!("finite values, coordinates within {MAX_COORDINATE} m"),
        format!("x {x}, y {y}, z {z}, intensity {intensity}"),
    ))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn message_of(bytes: &[u8]) -> String {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("sweep.bin");
        std::fs::write(&path, bytes).unwrap();
        read_sweep(&path).unwrap_err().to_string()
    }

    #[test]
    fn no_points_and_half_a_point_are_refused() {
        assert!(message_of(&[]).contains("sweep.bin: file size: expected at least one return"));
        assert!(message_of(&[]).contains("no points"));
        assert!(message_of(&[0; 40]).contains("found 40 bytes, 8 too many"));
    }

    #[test]
    fn a_return_that_is_not_finite_is_named_by_its_index() {
        for (column, value) in [(0, f32::NAN), (1, f32::INFINITY), (2, f32::NEG_INFINITY), (3, f32::NAN), (0, 2e6)] {
            let mut bytes = vec![0_u8; 48];
            bytes[32 + 4 * column..36 + 4 * column].copy_from_slice(&value.to_le_bytes());
            let message = message_of(&bytes);
            assert!(message.contains("sweep.bin: point 2: expected finite values"), "{message}");
        }
    }

    #[test]
    fn rows_without_any_coordinate_are_no_returns() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("sweep.bin");
        let write = |rows: &[[f32; 4]]| {
            std::fs::write(&path, rows.iter().flatten().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>()).unwrap();
        };
        write(&[[f32::NAN; 4], [1.0, 2.0, 3.0, 4.0], [f32::NAN, f32::NAN, f32::NAN, 0.0]]);
        let found = read_sweep(&path).unwrap();
        assert_eq!((found.points, found.intensities, found.num_missing), (vec![[1.0, 2.0, 3.0]], vec![4.0], 2));
        let rows =
            Sweep { times: Some(vec![0.1, 0.2, 0.3]), sensors: Some(vec![0, 1, 2]), ..read_rows(&path).unwrap() };
        let rows = rows.without_missing(&path).unwrap();
        assert_eq!((rows.times, rows.sensors, rows.num_missing), (Some(vec![0.2]), Some(vec![1]), 2));
        write(&[[f32::NAN; 4]; 2]);
        assert!(read_sweep(&path).unwrap_err().to_string().contains("rows without any coordinate"));
    }

    #[test]
    fn a_sweep_that_could_not_be_read_back_is_not_written() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("sweep.bin");
        let bad = [
            Sweep::default(),
            Sweep { points: vec![[0.0; 3]], ..Sweep::default() },
            Sweep { points: vec![[0.0, f32::NAN, 0.0]], intensities: vec![0.0], ..Sweep::default() },
        ];
        for sweep in bad {
            assert!(write_sweep(&path, &sweep).is_err(), "{sweep:?}");
            assert!(!path.exists());
        }
    }

    proptest! {
        #[test]
        fn what_is_written_is_read_back(rows in prop::collection::vec(prop::array::uniform4(-1e6_f32..1e6), 1..50)) {
            let dir = tempfile::tempdir().unwrap();
            let path = dir.path().join("sweep.bin");
            let points = rows.iter().map(|r| [r[0], r[1], r[2]]).collect();
            let sweep = Sweep { points, intensities: rows.iter().map(|r| r[3]).collect(), ..Sweep::default() };
            write_sweep(&path, &sweep).unwrap();
            prop_assert_eq!(count_returns(&path).unwrap(), rows.len());
            prop_assert_eq!(read_sweep(&path).unwrap(), sweep);
        }
    }
}
