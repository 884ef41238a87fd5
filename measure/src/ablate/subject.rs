//! A clip, ready to be reconstructed and measured: what the reconstruction reads, and apart from it what only the figures read.

use std::{num::NonZeroUsize, sync::Arc};

use lgs_engine::{
    evaluate::{ViewFigures, lpips::Lpips},
    gaussians::{GaussianSet, background::Mode},
    pipeline::{Reconstruction, Run, Session, Silent, Watch},
    recipe::Recipe,
    render::DeviceChoice,
    views::View,
};
use lgs_formats::clip_dir::ClipDir;

use crate::{clips::Choice, error::Result};

/// A clip, ready to be reconstructed and measured.
#[derive(Debug)]
pub struct Subject<'a> {
    session: Session,
    held_out: Vec<View>,
    lpips: Option<&'a Lpips>,
}

impl<'a> Subject<'a> {
    /// The opened clip of `choice`, its views loaded.
    ///
    /// # Errors
    /// Whatever is wrong with the clip, and a choice that does not fit it.
    pub fn load(dir: ClipDir, choice: &Choice, lpips: Option<&'a Lpips>) -> Result<Self> {
        let mut watch = Watch::new(&Silent);
        let opening = choice.opening(dir.clip())?;
        let session = Session::open(Arc::new(dir), opening, &mut watch)?;
        let held_out = session.held_out(&mut watch)?;
        Ok(Self { session, held_out, lpips })
    }

    /// The clip, opened.
    pub const fn session(&self) -> &Session {
        &self.session
    }

    /// The input views.
    pub fn views(&self) -> Vec<&View> {
        self.session.inputs().views().iter().collect()
    }

    /// The held-out views.
    pub fn held_out(&self) -> &[View] {
        &self.held_out
    }

    /// Numbers of input and of held-out views.
    pub fn num_views(&self) -> [usize; 2] {
        [self.session.inputs().views().len(), self.held_out.len()]
    }

    /// The initial Gaussians, as they are without a network.
    ///
    /// # Errors
    /// Whatever is wrong with a sweep.
    pub fn start(&self) -> Result<Reconstruction> {
        Ok(self.session.run(&Run::initial(Mode::Auto.into()), &mut Watch::new(&Silent))?)
    }

    /// So many passes of per-scene optimisation by the processor, with steps that look at `views_per_step` of the input views, or one.
    pub fn adam(&self, adam_passes: usize, views_per_step: Option<NonZeroUsize>, seed: u64) -> Run<'static> {
        let initial = Run::initial(Mode::Auto.into());
        let recipe = Recipe { adam_passes, refine_views: views_per_step, device: DeviceChoice::Cpu, ..initial.recipe };
        Run { recipe, seed, ..initial }
    }

    /// Mean figures of a scene over the held-out views.
    ///
    /// # Errors
    /// When the scene draws a value that is not finite.
    pub fn figures(&self, scene: &GaussianSet) -> Result<ViewFigures> {
        Ok(self.session.mean_figures(scene, &self.held_out, self.lpips)?)
    }
}
