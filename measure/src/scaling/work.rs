//! How much there is to do on a clip, by what the stages count.

use lgs_engine::{
    gaussians::{Branch, GaussianSet, physical::to_physical},
    network::{levels::Levels, model::Model},
    render::render_for_gradient,
    views::View,
};
use serde::{Deserialize, Serialize};

use crate::error::Result;

/// How much there is to do.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Work {
    /// Returns of all sweeps.
    pub returns: usize,
    /// Moments.
    pub frames: usize,
    /// Views.
    pub views: usize,
    /// Pixels of all of them.
    pub pixels: usize,
    /// Gaussians of the `LiDAR` branch at the start: returns that a camera sees.
    pub lidar: usize,
    /// Gaussians of the background.
    pub background: usize,
    /// Voxels that the `LiDAR` branch fills; 0 without a network.
    pub sites: usize,
    /// Pairs of neighbouring voxels of the `LiDAR` branch, at all levels; 0 without a network.
    pub pairs: usize,
    /// The same of the background.
    pub background_pairs: usize,
    /// Pairs of a Gaussian and a tile that it can reach, in all views, at the start.
    pub intersections: usize,
    /// How often the refinement drew all views: for its steps, and for their lengths.
    pub drawings: usize,
    /// How often the refinement's network ran.
    pub steps: usize,
}

impl Work {
    /// Gaussians of both branches.
    pub const fn gaussians(&self) -> usize {
        self.lidar + self.background
    }

    /// What can be counted on the initial scene and its views; the rest is 0.
    ///
    /// # Errors
    /// When a position leaves the voxel grid.
    pub fn of(scene: &GaussianSet, views: &[View], model: Option<&Model>) -> Result<Self> {
        let mut work = Self {
            views: views.len(),
            pixels: views.iter().map(|view| view.pinhole.num_pixels()).sum(),
            lidar: scene.num_lidar,
            background: scene.num_background(),
            ..Self::default()
        };
        if let Some(model) = model {
            let pyramid = |branch: Branch| -> Result<Levels> {
                let chosen: Vec<usize> = scene.rows(branch).collect();
                Ok(model.levels(&model.voxels(scene, &chosen, branch)?, branch)?)
            };
            let levels = pyramid(Branch::Lidar)?;
            (work.sites, work.pairs) = (levels.sites.len(), pairs(&levels));
            work.background_pairs = pairs(&pyramid(Branch::Background)?);
        }
        let splats = to_physical(scene);
        let intersections = |view: &View| render_for_gradient(&splats, &view.pinhole, [0.0; 3]).num_intersections();
        work.intersections = views.iter().map(intersections).sum();
        Ok(work)
    }
}

fn pairs(levels: &Levels) -> usize {
    levels.levels.iter().map(|level| level.submanifold.num_pairs()).sum()
}
