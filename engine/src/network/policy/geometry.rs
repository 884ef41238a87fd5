//! What the policy needs to know of a scene's voxels: maps, patches and parents of every stage. Constant for training.

use std::sync::Arc;

use super::config::PolicyConfig;
use crate::error::Result;
use crate::ops::attention::Patches;
use crate::ops::segment::Segments;
use crate::ops::serialization;
use crate::ops::sparse_conv::{KernelMap, Sites};
use crate::parallel;

/// The voxels of a scene as the policy sees them, finest stage first.
#[derive(Clone, Debug)]
pub struct Geometry {
    /// Map of the 5^3 convolution at the finest stage.
    pub(super) stem: Arc<KernelMap>,
    pub(super) stages: Vec<Stage>,
}

/// The voxels of one stage.
#[derive(Clone, Debug)]
pub(super) struct Stage {
    pub(super) num_sites: usize,
    /// Map of the 3^3 convolutions.
    pub(super) conv: Arc<KernelMap>,
    /// Patches along each curve that a block of the stage follows.
    pub(super) patches: Vec<Option<Arc<Patches>>>,
    /// The voxel of the next stage that each voxel lies in; `None` at the last.
    pub(super) parents: Option<Arc<Segments>>,
}

impl Stage {
    /// The patches along a curve of the config.
    pub(super) fn along(&self, curve: usize) -> candle_core::Result<&Arc<Patches>> {
        match self.patches.get(curve).and_then(Option::as_ref) {
            Some(patches) => Ok(patches),
            None => candle_core::bail!("policy: the geometry has no patches along curve {curve}"),
        }
    }

    /// The voxels of the next stage.
    pub(super) fn parents(&self) -> candle_core::Result<&Arc<Segments>> {
        match &self.parents {
            Some(parents) => Ok(parents),
            None => candle_core::bail!("policy: the geometry has no coarser stage"),
        }
    }
}

impl Geometry {
    /// Maps, patches and parents over occupied voxels.
    ///
    /// `maps` are 3^3 maps of the finest stages that exist already, such as those of the backbone; the others are made.
    ///
    /// # Errors
    /// When the voxels of a cloud span more than 2^16 along an axis.
    pub fn new(sites: &Sites, maps: &[Arc<KernelMap>], config: &PolicyConfig) -> Result<Self> {
        let plan = config.curve_plan();
        let origins = origins(sites, config.encoder.len());
        let depth = serialization::depth_of(&relative(sites, &origins, 0))?;
        let mut stages = Vec::with_capacity(config.encoder.len());
        let mut current = sites.clone();
        for (level, shift) in (0..config.encoder.len()).zip(0_u32..) {
            let coords = relative(&current, &origins, shift);
            let counts = counts(&current);
            let used = |curve| {
                plan.encoder[level].contains(&curve) || plan.decoder.get(level).is_some_and(|d| d.contains(&curve))
            };
            let patches = (0..config.curves.len()).map(|curve| {
                let make = || -> Result<Arc<Patches>> {
                    let codes = serialization::codes(&coords, config.curves[curve], depth.saturating_sub(shift))?;
                    Ok(Arc::new(Patches::new(serialization::order(&codes), &counts, config.patch)?))
                };
                used(curve).then(make).transpose()
            });
            let patches = patches.collect::<Result<Vec<Option<Arc<Patches>>>>>()?;
            let conv = match maps.get(level) {
                Some(map) if map.num_outputs() == current.len() => map.clone(),
                _ => Arc::new(KernelMap::submanifold(&current, 3)?),
            };
            let num_sites = current.len();
            let mut parents = None;
            if level + 1 < config.encoder.len() {
                let (coarse, parent_of) = current.halved()?;
                parents = Some(Arc::new(Segments::new(parent_of, coarse.len())?));
                current = coarse;
            }
            stages.push(Stage { num_sites, conv, patches, parents });
        }
        Ok(Self { stem: Arc::new(KernelMap::submanifold(sites, 5)?), stages })
    }

    /// Number of voxels of the finest stage.
    pub fn num_sites(&self) -> usize {
        self.stages.first().map_or(0, |stage| stage.num_sites)
    }
}

/// Lower corner of every cloud, by batch index; a multiple of the coarsest voxel, so that voxels merge as those of the backbone do.
fn origins(sites: &Sites, num_stages: usize) -> Vec<[i32; 3]> {
    let shift = num_stages.saturating_sub(1);
    let mut origins: Vec<[i32; 3]> = Vec::new();
    for &[batch, axes @ ..] in sites.coords() {
        let batch = usize::try_from(batch).unwrap_or(0);
        if origins.len() <= batch {
            origins.resize(batch + 1, [i32::MAX; 3]);
        }
        let origin = &mut origins[batch];
        *origin = [0, 1, 2].map(|axis| origin[axis].min(axes[axis]));
    }
    origins.iter().map(|origin| origin.map(|c| c >> shift << shift)).collect()
}

/// Coordinates of a stage's voxels from the origin of their cloud on.
fn relative(sites: &Sites, origins: &[[i32; 3]], shift: u32) -> Vec<[i32; 4]> {
    let coords = sites.coords();
    let relative_to = |i: usize| {
        let [batch, x, y, z] = coords[i];
        let [ox, oy, oz] = origins[usize::try_from(batch).unwrap_or(0)].map(|c| c >> shift);
        [batch, x - ox, y - oy, z - oz]
    };
    parallel::map(coords.len(), 1 << 14, &relative_to)
}

/// Number of voxels of every cloud.
fn counts(sites: &Sites) -> Vec<usize> {
    sites.coords().chunk_by(|a, b| a[0] == b[0]).map(<[[i32; 4]]>::len).collect()
}
