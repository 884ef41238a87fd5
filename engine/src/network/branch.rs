//! What a model has for each branch of a scene.

use super::levels::{Levels, voxels_of};
use super::model::Model;
use super::pass::Pass;
use super::unet::UNetConfig;
use crate::error::Result;
use crate::gaussians::{Branch, GaussianSet};

impl Model {
    /// The first prediction of a branch.
    pub const fn initial_of(&self, branch: Branch) -> &Pass {
        match branch {
            Branch::Lidar => &self.initial,
            Branch::Background => &self.background_initial,
        }
    }

    /// The refinement of a branch.
    pub(crate) const fn refine_of(&self, branch: Branch) -> &Pass {
        match branch {
            Branch::Lidar => &self.refine,
            Branch::Background => &self.background_refine,
        }
    }

    /// `[n]` voxels of chosen Gaussians of a branch.
    ///
    /// # Errors
    /// As [`voxels_of`].
    pub fn voxels(&self, set: &GaussianSet, chosen: &[usize], branch: Branch) -> Result<Vec<[i32; 4]>> {
        voxels_of(chosen.iter().map(|&i| set.mean(i)), self.grid(branch).0)
    }

    /// The pyramid over voxels of a branch.
    ///
    /// # Errors
    /// As [`Levels::new`].
    pub fn levels(&self, voxels: &[[i32; 4]], branch: Branch) -> Result<Levels> {
        Levels::new(voxels, self.grid(branch).1.num_levels())
    }

    const fn grid(&self, branch: Branch) -> (f64, &UNetConfig) {
        let config = &self.config;
        match branch {
            Branch::Lidar => (config.voxel_size, &config.unet),
            Branch::Background => (config.background_voxel_size, &config.background_unet),
        }
    }
}
