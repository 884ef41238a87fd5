//! What is known of single returns beside their coordinates: files of a value for each return of a sweep.

use std::path::Path;

use crate::{
    error::{FormatError, Result},
    read::{MAX_DATA_BYTES, file_size, read_file},
    write::write_atomic,
};

/// Largest time between a return and the timestamp of its sweep, seconds.
pub const MAX_RETURN_TIME: f32 = 1.0;
/// Most sensors of a sweep: as many as a byte counts.
pub const MAX_SENSORS: usize = 256;
/// Bytes of a time.
pub(crate) const TIME_BYTES: usize = size_of::<f32>();

/// Fails unless a file has `bytes` bytes for each of the `count` returns of a sweep, by its size alone.
///
/// # Errors
/// A file that is missing or of another size.
pub(crate) fn check_size(path: &Path, bytes: usize, count: usize) -> Result<()> {
    let (size, expected) = (file_size(path, MAX_DATA_BYTES)?, bytes as u64 * count as u64);
    if size == expected {
        return Ok(());
    }
    let expected = format!("{expected} bytes ({bytes} for each of {count} returns)");
    Err(FormatError::invalid(path, "file size", expected, format!("{size} bytes")))
}

/// `[count]` times of returns, seconds since the timestamp of their sweep.
///
/// # Errors
/// A file that is missing or has another number of values, a time that is not finite or beyond [`MAX_RETURN_TIME`], by its index.
pub fn read_times(path: &Path, count: usize) -> Result<Vec<f32>> {
    check_size(path, TIME_BYTES, count)?;
    let times = read_file(path, MAX_DATA_BYTES)?.as_chunks().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect();
    check_times(path, times)
}

/// The times, when they are times of returns.
///
/// # Errors
/// A time that is not finite or beyond [`MAX_RETURN_TIME`], by its index.
pub(crate) fn check_times(path: &Path, times: Vec<f32>) -> Result<Vec<f32>> {
    let in_range = |time: f32| time.abs() <= MAX_RETURN_TIME; // false for NaN
    match times.iter().enumerate().find(|(_, time)| !in_range(**time)) {
        None => Ok(times),
        Some((index, found)) => {
            let expected = format!("seconds within {MAX_RETURN_TIME} of the sweep's timestamp");
            Err(FormatError::invalid(path, format!("time {index}"), expected, found.to_string()))
        }
    }
}

/// Writes the times that [`read_times`] gives back, bit for bit.
///
/// # Errors
/// A path that cannot be written to.
pub fn write_times(path: &Path, times: &[f32]) -> Result<()> {
    write_atomic(path, &times.iter().flat_map(|time| time.to_le_bytes()).collect::<Vec<u8>>())
}

/// `[count]` indices of sensors, of which there are `num_sensors`.
///
/// # Errors
/// A file that is missing or has another number of values, an index beyond the sensors, by its place.
pub fn read_sensors(path: &Path, count: usize, num_sensors: usize) -> Result<Vec<u8>> {
    check_size(path, 1, count)?;
    let indices = read_file(path, MAX_DATA_BYTES)?;
    match indices.iter().enumerate().find(|(_, index)| usize::from(**index) >= num_sensors) {
        None => Ok(indices),
        Some((place, found)) => {
            let expected = format!("an index below {num_sensors}, the number of sensors");
            Err(FormatError::invalid(path, format!("sensor of return {place}"), expected, found.to_string()))
        }
    }
}

/// Writes the indices that [`read_sensors`] gives back.
///
/// # Errors
/// A path that cannot be written to.
pub fn write_sensors(path: &Path, indices: &[u8]) -> Result<()> {
    write_atomic(path, indices)
}
