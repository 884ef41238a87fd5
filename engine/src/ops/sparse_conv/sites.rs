//! Occupied voxels in lexicographic order.

use rayon::prelude::*;

use crate::error::{EngineError, Result};
use crate::parallel;

/// Bits of one coordinate in a key.
const COORDINATE_BITS: u32 = 18;
/// Bits of the batch index in a key.
const BATCH_BITS: u32 = 10;
/// Added to a coordinate so that it is not negative.
const BIAS: i64 = 1 << (COORDINATE_BITS - 1);
/// Coordinates keep this distance from the ends of their field, so that the offset of any kernel stays inside it.
const MARGIN: i64 = 8;
/// Coordinates of one piece of work.
const PIECE: usize = 4096;

/// Occupied voxels, sorted by (batch, x, y, z), without repeats.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sites {
    coords: Vec<[i32; 4]>,
    keys: Vec<u64>,
}

impl Sites {
    /// The distinct sites among coordinates in any order, and the site of every coordinate.
    ///
    /// # Shapes
    /// `coords` `[N]`; sites `[M]`, indices `[N]` in `0..M`.
    ///
    /// # Errors
    /// When a coordinate exceeds 18 bits (less a margin for kernels), a batch index 10 bits, or there are more coordinates than 32 bits count.
    pub fn unique(coords: &[[i32; 4]]) -> Result<(Self, Vec<u32>)> {
        check_count("voxel coordinates", coords.len())?;
        let keyed = |piece: usize| -> Result<Vec<(u64, u32)>> {
            let rows = piece * PIECE..coords.len().min((piece + 1) * PIECE);
            rows.map(|i| key_of(&coords[i], i).map(|key| (key, index32(i)))).collect()
        };
        let pieces = parallel::map(coords.len().div_ceil(PIECE), 1, &keyed);
        let mut order: Vec<(u64, u32)> = pieces.into_iter().collect::<Result<Vec<_>>>()?.concat();
        order.par_sort_unstable();
        let mut sites = Self { coords: Vec::new(), keys: Vec::new() };
        let mut site_of = vec![0_u32; coords.len()];
        for (key, i) in order {
            if sites.keys.last() != Some(&key) {
                sites.keys.push(key);
                sites.coords.push(coords[i as usize]);
            }
            site_of[i as usize] = index32(sites.keys.len() - 1);
        }
        Ok((sites, site_of))
    }

    /// The sites of the grid that is coarser by 2, and the coarse site of every site.
    ///
    /// # Errors
    /// Never for sites that exist; the signature is that of [`Sites::unique`].
    pub fn halved(&self) -> Result<(Self, Vec<u32>)> {
        let coarse: Vec<[i32; 4]> = self.coords.iter().map(|&[b, x, y, z]| [b, x >> 1, y >> 1, z >> 1]).collect();
        Self::unique(&coarse)
    }

    /// Number of sites.
    pub fn len(&self) -> usize {
        self.coords.len()
    }

    /// Whether there is no site.
    pub fn is_empty(&self) -> bool {
        self.coords.is_empty()
    }

    /// `[M]` batch, x, y, z.
    pub fn coords(&self) -> &[[i32; 4]] {
        &self.coords
    }

    /// `[M]` ascending keys; see [`key_step`].
    pub(super) fn keys(&self) -> &[u64] {
        &self.keys
    }

    /// The row of a site.
    pub(super) fn find(&self, coord: &[i32; 4]) -> Option<usize> {
        self.keys.binary_search(&key_of(coord, 0).ok()?).ok()
    }
}

/// What a step of (dx, dy, dz) adds to a key.
#[expect(clippy::cast_sign_loss, reason = "keys add modulo 2^64")]
pub(super) const fn key_step(dx: i32, dy: i32, dz: i32) -> u64 {
    (((dx as i64) << (2 * COORDINATE_BITS)) + ((dy as i64) << COORDINATE_BITS) + dz as i64) as u64
}

#[expect(clippy::cast_sign_loss, reason = "checked to be non-negative")]
fn key_of(coord: &[i32; 4], row: usize) -> Result<u64> {
    let [batch, rest @ ..] = coord.map(i64::from);
    let biased = rest.map(|c| c + BIAS);
    let fits = (0..1 << BATCH_BITS).contains(&batch)
        && biased.iter().all(|c| (MARGIN..(1 << COORDINATE_BITS) - MARGIN).contains(c));
    if fits {
        let [x, y, z] = biased;
        return Ok(((((batch << COORDINATE_BITS | x) << COORDINATE_BITS) | y) << COORDINATE_BITS | z) as u64);
    }
    Err(EngineError::Setting {
        setting: "voxel coordinates",
        expected: format!("batch below {}, coordinates within +-{} voxels", 1 << BATCH_BITS, BIAS - MARGIN),
        found: format!("row {row} {coord:?}"),
    })
}

/// Fails when 32 bits do not count so many.
///
/// # Errors
/// [`EngineError::Setting`] for the frames: fewer of them have fewer points.
pub(super) fn check_count(what: &str, count: usize) -> Result<()> {
    if u32::try_from(count).is_ok() {
        return Ok(());
    }
    Err(EngineError::Setting {
        setting: "frames",
        expected: format!("fewer than 2^32 {what}"),
        found: count.to_string(),
    })
}

#[expect(clippy::cast_possible_truncation, reason = "counts are checked before they are told apart")]
pub(super) fn index32(value: usize) -> u32 {
    value as u32
}
