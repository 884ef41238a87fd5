//! One pass of one branch: from the state of its Gaussians to head outputs, and back from the gradient by them.

use candle_core::Tensor;
use lgs_engine::{
    gaussians::{Branch, GaussianSet},
    network::{
        model::Model,
        normalise::{INITIAL_INPUTS, initial_rows},
    },
    objective::Objective,
    ops::tensors::of_rows,
    predict::other_time_neighbours,
    refine::StepInputs,
};

use crate::error::Result;

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

impl Outcome {
    /// Number of outputs of a Gaussian.
    pub(crate) fn width(&self) -> Result<usize> {
        Ok(self.outputs.dim(1)?)
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
        let chosen: Vec<usize> = set.rows(branch).collect();
        if chosen.is_empty() {
            return Ok(None);
        }
        let (model, pass) = (self.model, self.model.initial_of(branch));
        let levels = model.levels(&model.voxels(set, &chosen, branch)?, branch)?;
        let rows = of_rows(initial_rows(set, &chosen), INITIAL_INPUTS)?;
        let mut features = pass.features(&rows, &levels, self.batch_statistics)?;
        if branch == Branch::Lidar
            && let (Some(query), Some(config)) = (&model.query, &model.config.query)
            && let Some(neighbours) = other_time_neighbours(set, config.neighbours)?
        {
            features = query.forward(features, &neighbours.indices.into(), config.neighbours)?;
        }
        Ok(Some(Outcome { outputs: pass.heads().forward(&features, &rows)?, features, chosen }))
    }

    /// A refinement step of the Gaussians of a branch that are `seen`; `None` when there is none.
    pub(crate) fn refine(&self, set: &GaussianSet, before: &Objective, branch: Branch) -> Result<Option<Outcome>> {
        let chosen: Vec<usize> = set.rows(branch).filter(|&i| before.seen[i]).collect();
        if chosen.is_empty() {
            return Ok(None);
        }
        let levels = self.model.levels(&self.model.voxels(set, &chosen, branch)?, branch)?;
        let inputs = StepInputs { set, objective: before, seen: &chosen, levels: &levels };
        let [features, outputs] = inputs.outputs(self.model, branch, self.batch_statistics)?;
        Ok(Some(Outcome { outputs, features, chosen }))
    }
}
