//! Exact nearest neighbours of the points of a set.
//!
//! What is near a place `kiddo` finds ([`Space`]). Neighbours of the points themselves, ties by index, a tree of our own finds: it skips
//! what is of one timestamp, and asks for all points of a leaf together. Among other timestamps it is three times as fast as a tree of `kiddo`
//! (`cargo bench -p lgs-tests --bench network -- other_times`). Host only: indices have no gradient.

mod batch;
mod cpu;
pub mod reference;
mod space;
mod tree;

pub(crate) use space::nearest_in_space;
pub use space::{Near, Space};

use crate::error::{EngineError, Result};

/// Stands where there is no further neighbour; `index_select` of candle returns a zero row for it.
pub const NO_NEIGHBOUR: u32 = u32::MAX;

/// The neighbours of `N` points.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Neighbours {
    /// Number of places per point, K.
    pub k: usize,
    /// `[N, K]` nearest first; [`NO_NEIGHBOUR`] fills the places that nothing fills.
    pub indices: Vec<u32>,
}

impl Neighbours {
    /// The neighbours of one point, nearest first, without the places that nothing fills.
    pub fn of(&self, point: usize) -> &[u32] {
        let places = &self.indices[point * self.k..(point + 1) * self.k];
        &places[..places.iter().position(|&j| j == NO_NEIGHBOUR).unwrap_or(self.k)]
    }
}

/// The `k` nearest points at other timestamps of every point.
///
/// # Shapes
/// `points` `[N, 3]` f32, any unit; `time_index` `[N]`, equal for points of one frame; result `[N, k]`.
///
/// # Formula
/// The first `k` indices `j` with `time_index[j] != time_index[i]` in ascending order of (`squared_distance(i, j)`, `j`).
///
/// # Source
/// Cross-Time Point Query of Learning Gaussian Structure.
///
/// # Errors
/// When a coordinate is not finite, the lengths differ, or there are 2^32 - 1 points or more.
pub fn nearest_other_time(points: &[[f32; 3]], time_index: &[u32], k: usize) -> Result<Neighbours> {
    check(points, time_index)?;
    Ok(Neighbours { k, indices: cpu::search(points, time_index, k) })
}

/// The `k` nearest other points of the points `queries` alone.
///
/// # Shapes
/// `points` `[N, 3]` f32, any unit; `queries` `[M]` indices below N; result `[M, k]`.
///
/// # Formula
/// Row m holds the first `k` indices `j != i` for `i = queries[m]` in ascending order of (`squared_distance(i, j)`, `j`): exact, ties by
/// index at every place.
///
/// # Errors
/// When a coordinate is not finite, there are 2^32 - 1 points or more, or a query lies beyond them.
pub fn nearest_of(points: &[[f32; 3]], queries: &[u32], k: usize) -> Result<Neighbours> {
    // A point may not find its own group: every point is a group.
    nearest_other_time_of(points, &(0..count(points.len())?).collect::<Vec<u32>>(), queries, k)
}

/// The `k` nearest points at other timestamps of the points `queries` alone.
///
/// # Shapes
/// `points` `[N, 3]` f32, any unit; `time_index` `[N]`; `queries` `[M]` indices below N; result `[M, k]`.
///
/// # Formula
/// Row m is row `queries[m]` of [`nearest_other_time`].
///
/// # Errors
/// Those of [`nearest_other_time`], and a query beyond the points.
pub fn nearest_other_time_of(points: &[[f32; 3]], time_index: &[u32], queries: &[u32], k: usize) -> Result<Neighbours> {
    check(points, time_index)?;
    if let Some(query) = queries.iter().find(|&&query| query as usize >= points.len()) {
        let message = format!("queries: expected indices below {}, found {query}", points.len());
        return Err(candle_core::Error::Msg(message).into());
    }
    Ok(Neighbours { k, indices: cpu::search_of(points, time_index, queries, k) })
}

/// Squared distance in f64 of f32 coordinates, summed in the order x, y, z.
#[inline(always)]
pub(crate) fn squared_distance(a: &[f32; 3], b: &[f32; 3]) -> f64 {
    let [x, y, z] = [0, 1, 2].map(|c| f64::from(a[c]) - f64::from(b[c]));
    (x * x + y * y) + z * z
}

/// Fails unless there are as many finite points as groups, and few enough of them.
fn check(points: &[[f32; 3]], groups: &[u32]) -> Result<()> {
    if groups.len() != points.len() {
        let (n, found) = (points.len(), groups.len());
        return Err(candle_core::Error::Msg(format!("time_index: expected {n} values, found {found}")).into());
    }
    check_points(points)
}

/// Fails when a point is not finite, or there are too many.
fn check_points(points: &[[f32; 3]]) -> Result<()> {
    count(points.len())?;
    for (i, point) in points.iter().enumerate() {
        if let Some(axis) = (0..3).find(|&axis| !point[axis].is_finite()) {
            let what = format!("point {i}, {}", ["x", "y", "z"][axis]);
            return Err(EngineError::NonFinite { what, found: point[axis] });
        }
    }
    Ok(())
}

fn count(points: usize) -> Result<u32> {
    match u32::try_from(points) {
        Ok(n) if n < NO_NEIGHBOUR => Ok(n),
        _ => Err(candle_core::Error::Msg(format!("points: expected fewer than 2^32 - 1, found {points}")).into()),
    }
}

#[cfg(test)]
mod tests;
