//! One pass of one branch: from the state of its Gaussians to head outputs, and back from the gradient by them.

use candle_core::{Device, Tensor};
use lgs_engine::{
    gaussians::GaussianSet,
    network::{
        config::ModelConfig,
        guide::{refine_inputs, refine_rows},
        levels::{Levels, voxels_of},
        model::{BACKGROUND_INITIAL_INPUTS, Model},
        normalise::{INITIAL_INPUTS, initial_rows},
    },
    objective::Objective,
    predict::{other_time_neighbours, positions},
    refine::guide,
};

use crate::error::Result;

/// A branch of the scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Branch {
    /// One Gaussian per return; it moves.
    Lidar,
    /// Static Gaussians behind it.
    Background,
}

/// Both branches, in the order of the set.
pub(crate) const BRANCHES: [Branch; 2] = [Branch::Lidar, Branch::Background];

/// Head outputs of some Gaussians, with the way back.
#[derive(Debug)]
pub(crate) struct Outcome {
    /// Indices in the set.
    pub(crate) chosen: Vec<usize>,
    /// `[n, width]`, differentiable.
    pub(crate) outputs: Tensor,
    /// `[n, width of the U-Net]` what the heads read, after the query where there is one.
    pub(crate) features: Tensor,
}

/// The model, and how its normalisation takes statistics.
#[derive(Debug)]
pub(crate) struct Passes<'a> {
    pub(crate) model: &'a Model,
    pub(crate) config: &'a ModelConfig,
    pub(crate) batch_statistics: bool,
}

impl Branch {
    /// Indices of the branch in the set.
    pub(crate) fn range(self, set: &GaussianSet) -> std::ops::Range<usize> {
        match self {
            Self::Lidar => 0..set.num_lidar,
            Self::Background => set.num_lidar..set.len(),
        }
    }
}

impl Outcome {
    /// Number of outputs of a Gaussian.
    pub(crate) fn width(&self) -> Result<usize> {
        Ok(self.outputs.dim(1)?)
    }

    /// The outputs, `[n * width]`.
    pub(crate) fn values(&self) -> Result<Vec<f32>> {
        Ok(self.outputs.flatten_all()?.to_vec1()?)
    }

    /// A scalar whose gradient by the parameters is that of the loss whose gradient by the outputs is `v_outputs`.
    pub(crate) fn carry(&self, v_outputs: Vec<f32>) -> Result<Tensor> {
        let v_outputs = Tensor::from_vec(v_outputs, self.outputs.shape(), &Device::Cpu)?;
        Ok((&self.outputs * v_outputs)?.sum_all()?)
    }
}

impl Passes<'_> {
    /// The first prediction of a branch; `None` when it is empty.
    pub(crate) fn initial(&self, set: &GaussianSet, branch: Branch) -> Result<Option<Outcome>> {
        let chosen: Vec<usize> = branch.range(set).collect();
        if chosen.is_empty() {
            return Ok(None);
        }
        let (pass, cin) = match branch {
            Branch::Lidar => (&self.model.initial, INITIAL_INPUTS),
            Branch::Background => (&self.model.background_initial, BACKGROUND_INITIAL_INPUTS),
        };
        let levels = self.levels(set, &chosen, branch)?;
        let own = initial_rows(set, &chosen);
        let rows = voxel_rows(&levels, &own, cin)?;
        let mut features = pass.features(&rows, &levels, self.batch_statistics)?;
        if branch == Branch::Lidar
            && let (Some(query), Some(config)) = (&self.model.query, &self.config.query)
            && let Some(neighbours) = other_time_neighbours(set, config.neighbours)?
        {
            features = query.forward(&features, &neighbours.indices.into(), config.neighbours)?;
        }
        let own = Tensor::from_vec(own, (chosen.len(), cin), &Device::Cpu)?;
        Ok(Some(Outcome { outputs: pass.heads().forward(&features, &own)?, features, chosen }))
    }

    /// A refinement step of the Gaussians of a branch that are `seen`; `None` when there is none.
    pub(crate) fn refine(&self, set: &GaussianSet, before: &Objective, branch: Branch) -> Result<Option<Outcome>> {
        let chosen: Vec<usize> = branch.range(set).filter(|&i| before.seen[i]).collect();
        if chosen.is_empty() {
            return Ok(None);
        }
        let moving = branch == Branch::Lidar;
        let pass = if moving { &self.model.refine } else { &self.model.background_refine };
        let levels = self.levels(set, &chosen, branch)?;
        let rows = refine_rows(set, guide(before, self.config.guidance), &chosen, moving);
        let voxel_rows = voxel_rows(&levels, &rows.inputs, refine_inputs(self.config.guidance, moving))?;
        let by_point = |rows: Vec<f32>| {
            let width = rows.len() / chosen.len();
            Tensor::from_vec(rows, (chosen.len(), width), &Device::Cpu)
        };
        let features = if pass.heads().read_own() {
            pass.features(&voxel_rows, &levels, self.batch_statistics)?
        } else {
            pass.features_with_own(&voxel_rows, &by_point(rows.own)?, &levels, self.batch_statistics)?
        };
        let outputs = pass.heads().forward(&features, &by_point(rows.inputs)?)?;
        Ok(Some(Outcome { outputs, features, chosen }))
    }

    fn levels(&self, set: &GaussianSet, chosen: &[usize], branch: Branch) -> Result<Levels> {
        let (size, unet) = match branch {
            Branch::Lidar => (self.config.voxel_size, &self.config.unet),
            Branch::Background => (self.config.background_voxel_size, &self.config.background_unet),
        };
        Ok(Levels::new(&voxels_of(positions(set, chosen), size)?, unet.num_levels())?)
    }
}

fn voxel_rows(levels: &Levels, rows: &[f32], cin: usize) -> Result<Tensor> {
    Ok(Tensor::from_vec(levels.mean_of_points(rows, cin), (levels.sites.len(), cin), &Device::Cpu)?)
}
