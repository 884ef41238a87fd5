//! The voxel pyramid of a scene: sites and kernel maps of every level, shared by all layers and by all passes.

use std::sync::Arc;

use crate::error::{EngineError, Result};
use crate::ops::segment::Segments;
use crate::ops::sparse_conv::{KernelMap, Sites};

/// One level of the pyramid.
#[derive(Clone, Debug)]
pub struct Level {
    /// Number of occupied voxels.
    pub num_sites: usize,
    /// Map of the 3^3 submanifold convolutions.
    pub submanifold: Arc<KernelMap>,
    /// Map of 1^3 convolutions.
    pub pointwise: Arc<KernelMap>,
    /// Maps to the next coarser level and back; `None` at the coarsest.
    pub halving: Option<[Arc<KernelMap>; 2]>,
}

/// Voxels of the points of a scene, at all levels.
#[derive(Clone, Debug)]
pub struct Levels {
    /// Occupied voxels of the finest level.
    pub sites: Sites,
    /// The site of every point.
    pub points: Arc<Segments>,
    /// Finest first.
    pub levels: Vec<Level>,
}

/// `[N]` voxel (batch 0, x, y, z) of every position.
///
/// # Shapes
/// `positions` `[N]` metres; `voxel_size` metres.
///
/// # Errors
/// When a position is not finite or lies too far out for the grid.
#[expect(clippy::cast_possible_truncation, reason = "the cast saturates and the grid refuses what is too far out")]
pub fn voxels_of(positions: impl Iterator<Item = [f32; 3]>, voxel_size: f64) -> Result<Vec<[i32; 4]>> {
    let voxel = |(i, p): (usize, [f32; 3])| {
        if let Some(found) = p.into_iter().find(|v| !v.is_finite()) {
            return Err(EngineError::NonFinite { what: format!("position of Gaussian {i}"), found });
        }
        let [x, y, z] = p.map(|v| (f64::from(v) / voxel_size).floor() as i32);
        Ok([0, x, y, z])
    };
    positions.enumerate().map(voxel).collect()
}

impl Levels {
    /// The pyramid with `num_levels` levels over the voxels of points.
    ///
    /// # Errors
    /// When a voxel lies outside the grid (2^18 voxels an axis).
    pub fn new(voxels: &[[i32; 4]], num_levels: usize) -> Result<Self> {
        let (sites, site_of) = Sites::unique(voxels)?;
        let points = Arc::new(Segments::new(site_of, sites.len())?);
        let mut levels = Vec::with_capacity(num_levels);
        let mut current = sites.clone();
        for level in 0..num_levels {
            let submanifold = Arc::new(KernelMap::submanifold(&current, 3)?);
            let pointwise = Arc::new(KernelMap::identity(current.len()));
            let num_sites = current.len();
            let mut halving = None;
            if level + 1 < num_levels {
                let halved = KernelMap::halving(&current)?;
                halving = Some([halved.down, halved.up]);
                current = halved.coarse;
            }
            levels.push(Level { num_sites, submanifold, pointwise, halving });
        }
        Ok(Self { sites, points, levels })
    }
}
