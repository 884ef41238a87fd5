//! One pass of one branch: from the state of its Gaussians to head outputs, and back from the gradient by them.

use candle_core::Tensor;
use lgs_engine::{
    gaussians::GaussianSet,
    network::{
        guide::{refine_inputs, refine_rows},
        levels::{Levels, voxels_of},
        model::{BACKGROUND_INITIAL_INPUTS, Model},
        normalise::{INITIAL_INPUTS, initial_rows},
    },
    objective::Objective,
    ops::tensors::of_rows,
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
        let v_outputs = of_rows(v_outputs, self.width()?)?;
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
        let rows = of_rows(initial_rows(set, &chosen), cin)?;
        let mut features = pass.features(&rows, &levels, self.batch_statistics)?;
        if branch == Branch::Lidar
            && let (Some(query), Some(config)) = (&self.model.query, &self.model.config.query)
            && let Some(neighbours) = other_time_neighbours(set, config.neighbours)?
        {
            features = query.forward(features, &neighbours.indices.into(), config.neighbours)?;
        }
        Ok(Some(Outcome { outputs: pass.heads().forward(&features, &rows)?, features, chosen }))
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
        let guidance = self.model.config.guidance;
        let rows = refine_rows(set, guide(before, guidance), &chosen, moving);
        let gradients = rows.point_inputs.len() / chosen.len();
        let inputs = of_rows(rows.inputs, refine_inputs(guidance, moving))?;
        let point_inputs = of_rows(rows.point_inputs, gradients)?;
        let features = pass.gated_features(&inputs, &point_inputs, &levels, self.batch_statistics)?;
        Ok(Some(Outcome { outputs: pass.heads().forward(&features, &inputs)?, features, chosen }))
    }

    fn levels(&self, set: &GaussianSet, chosen: &[usize], branch: Branch) -> Result<Levels> {
        let (size, unet) = match branch {
            Branch::Lidar => (self.model.config.voxel_size, &self.model.config.unet),
            Branch::Background => (self.model.config.background_voxel_size, &self.model.config.background_unet),
        };
        Ok(Levels::new(&voxels_of(positions(set, chosen), size)?, unet.num_levels())?)
    }
}
