//! The branches of a scene, and what a model has for each.

use std::ops::Range;

use super::levels::{Levels, voxels_of};
use super::model::Model;
use super::pass::Pass;
use super::unet::UNetConfig;
use crate::error::Result;
use crate::gaussians::{GaussianSet, MEAN};

/// A branch of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Branch {
    /// Gaussians of the returns; they move.
    Lidar,
    /// Static Gaussians behind them.
    Background,
}

impl Branch {
    /// Both, in the order of a set.
    pub const ALL: [Self; 2] = [Self::Lidar, Self::Background];

    /// Indices of the branch in a set.
    pub fn range(self, set: &GaussianSet) -> Range<usize> {
        match self {
            Self::Lidar => 0..set.num_lidar,
            Self::Background => set.num_lidar..set.len(),
        }
    }

    /// Whether its Gaussians have velocities.
    pub const fn moves(self) -> bool {
        matches!(self, Self::Lidar)
    }
}

impl Model {
    /// The first prediction of a branch.
    pub const fn initial_of(&self, branch: Branch) -> &Pass {
        match branch {
            Branch::Lidar => &self.initial,
            Branch::Background => &self.background_initial,
        }
    }

    /// The refinement of a branch.
    pub const fn refine_of(&self, branch: Branch) -> &Pass {
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
        voxels_of(positions(set, chosen), self.grid(branch).0)
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

/// Positions of chosen Gaussians.
pub fn positions(set: &GaussianSet, chosen: &[usize]) -> impl Iterator<Item = [f32; 3]> {
    chosen.iter().map(|&i| [0, 1, 2].map(|k| set.attributes[i][MEAN.start + k]))
}
