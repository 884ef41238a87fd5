//! Pruning by what a scene needs once it is refined.
//!
//! What looks worthless in a first prediction is often what a refinement makes a thin edge of. The scene is therefore refined a little before its
//! effects tell who stays.

use std::borrow::Cow;

use crate::densify::{Limit, Scope};
use crate::error::Result;
use crate::evidence::{num_rounds, survivors};
use crate::gaussians::GaussianSet;
use crate::network::model::Model;
use crate::refine::{LastStep, RefineSettings, refine};
use crate::views::{View, strided};

/// Learned steps before the effects are measured. Held-out PSNR of ten clips, the mean, of 70 % of the scene after 1 and 2: 25.84 and 25.87 dB, where all of it has 25.86; of
/// four of them after 0, 1 and 2: 25.88, 26.07 and 26.12 dB. The second step costs another sixth of a run's time.
const AHEAD: usize = 1;

/// How a scene is pruned by exact effects.
#[derive(Clone, Copy, Debug)]
pub struct Pruning {
    /// What it may take.
    pub scope: Scope,
    /// How many are left of that; `None`: what the views show better without goes.
    pub limit: Option<Limit>,
    /// The refinement of what is left.
    pub refine: RefineSettings,
}

impl Pruning {
    /// Learned steps before the effects are measured: none where none is to follow.
    const fn ahead(&self) -> usize {
        if self.refine.steps < AHEAD { self.refine.steps } else { AHEAD }
    }

    /// How often [`Pruning::prune`] tells that something is done.
    pub fn parts(&self, scene: &GaussianSet) -> usize {
        let rounds = num_rounds(if self.scope == Scope::All { scene.len() } else { scene.num_lidar }, self.limit);
        if rounds == 0 { 0 } else { self.ahead() + rounds }
    }

    /// Refines a scene by the learned steps that come before its effects are measured.
    ///
    /// # Errors
    /// Those of [`refine`].
    pub fn advance(
        &self,
        scene: &mut GaussianSet,
        views: &[&View],
        model: &Model,
        done: &mut dyn FnMut(),
    ) -> Result<()> {
        let settings = RefineSettings { steps: self.ahead(), last: LastStep::Kept, ..self.refine };
        refine(scene, views, model, settings, done).map(drop)
    }

    /// [Advances](Pruning::advance) a scene and returns the rows that stay, in its order: its [`survivors`]. A scene of which all stays is left as it is.
    ///
    /// # Errors
    /// Those of [`refine`].
    pub fn prune(
        &self,
        scene: &mut GaussianSet,
        views: &[&View],
        model: &Model,
        done: &mut dyn FnMut(),
    ) -> Result<Vec<usize>> {
        if self.parts(scene) == 0 {
            return Ok((0..scene.len()).collect());
        }
        self.advance(scene, views, model, done)?;
        let drawn = strided(views, self.refine.pixel_stride.of(views), 1);
        let views: Vec<&View> = drawn.iter().map(Cow::as_ref).collect();
        Ok(survivors(scene, &views, (self.scope, self.limit), self.refine.device, done))
    }
}
