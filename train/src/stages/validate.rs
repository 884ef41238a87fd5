//! What a model is worth on held-out views of clips that training does not read: what `lgs-infer` makes of them, but that no Gaussians are pruned
//! by exact effects. Training asks what network and policy do, and most of its scenes are not pruned either.

use std::{path::Path, sync::Arc};

use lgs_engine::{
    densify::Density,
    gaussians::{GaussianSet, background::Mode},
    network::model::Model,
    pipeline::{HoldOut, MemorySettings, NetworkSettings, Opening, Run, Session, Silent, Watch, run_network},
    recipe::Recipe,
    refine::refine_showing,
    render::DeviceChoice,
    views::{Selection, View},
};
use lgs_formats::{clip_dir::ClipDir, image::ImageSize};

use super::settings::SetUpdate;
use crate::error::Result;

/// A clip, ready to be reconstructed.
#[derive(Debug)]
pub struct ValidationClip {
    /// What tells it from others.
    pub identity: String,
    start: GaussianSet,
    session: Session,
    held_out: Vec<View>,
}

/// Mean PSNR over held-out views, decibels.
#[derive(Clone, Debug, PartialEq)]
pub struct Score {
    /// Of the initial Gaussians.
    pub start: f64,
    /// After the prediction, and after every refinement step.
    pub after: Vec<f64>,
}

impl ValidationClip {
    /// The clip in `dir`, its odd frames held out, at most its first `num_frames` frames.
    ///
    /// # Errors
    /// Whatever is wrong with the clip, and more of it than there is memory for.
    pub fn open(dir: &Path, num_frames: usize, image_size: Option<ImageSize>) -> Result<Self> {
        let dir = ClipDir::open(dir)?;
        let frames: Vec<usize> = (0..dir.clip().frames.len().min(num_frames)).collect();
        let hold_out = HoldOut::Odd.indices(dir.clip().frames.len(), Some(&frames))?;
        let selection = Selection { frames: Some(frames), hold_out, image_size, cameras: None };
        let memory = MemorySettings { images: "validation-size", returns: "validation" };
        let mut watch = Watch::new(&Silent);
        let session = Session::open(Arc::new(dir), Opening { memory, ..Opening::of(selection) }, &mut watch)?;
        let start = session.run(&Run::initial(Mode::Auto.into()), &mut watch)?.scene;
        let held_out = session.held_out(&mut watch)?;
        let identity = format!("{} ({})", session.clip().name, session.clip().source);
        Ok(Self { identity, start, session, held_out })
    }

    /// The score of a model, its policy's decisions applied where there are any.
    ///
    /// # Errors
    /// When a position leaves the voxel grid, or a scene draws a value that is not finite.
    pub fn score(&self, model: &Model, refine_steps: usize, update: Option<SetUpdate>) -> Result<Score> {
        let mut set = self.start.clone();
        let start = self.psnr(&set)?;
        let views: Vec<&View> = self.session.inputs().views().iter().collect();
        let settings = NetworkSettings::of(&predicted(model, update), model, 0, None);
        run_network(&mut set, &views, &settings, &mut Watch::new(&Silent))?;
        let (mut after, mut failed) = (vec![self.psnr(&set)?], None);
        refine_showing(&mut set, &views, model, refine_steps, |set| match self.psnr(set) {
            Ok(psnr) => after.push(psnr),
            Err(error) => failed = failed.take().or(Some(error)),
        })?;
        if let Some(error) = failed {
            return Err(error);
        }
        // A step that did not help ended the refinement: the scene stays as it is.
        after.resize(refine_steps + 1, after[after.len() - 1]);
        Ok(Score { start, after })
    }

    fn psnr(&self, set: &GaussianSet) -> Result<f64> {
        Ok(self.session.mean_figures(set, &self.held_out, None)?.psnr.unwrap_or(0.0))
    }
}

/// Prediction and, where there is one, the policy's update of the set; no refinement yet.
fn predicted(model: &Model, update: Option<SetUpdate>) -> Recipe {
    let still = Recipe { refine_steps: 0, device: DeviceChoice::Cpu, ..Recipe::default().with_density(Density::Off) };
    match update.filter(|_| model.policy.is_some()) {
        Some((thresholds, max_gaussians)) => Recipe { density: Density::Policy, thresholds, max_gaussians, ..still },
        None => still,
    }
}

/// The mean of the scores of clips.
///
/// # Errors
/// As [`ValidationClip::score`].
pub fn mean_score(
    clips: &[ValidationClip],
    model: &Model,
    refine_steps: usize,
    update: Option<SetUpdate>,
) -> Result<Score> {
    let score = |clip: &ValidationClip| clip.score(model, refine_steps, update);
    let scores: Vec<Score> = clips.iter().map(score).collect::<Result<_>>()?;
    let mean = |value: &dyn Fn(&Score) -> f64| scores.iter().map(value).sum::<f64>() / scores.len().max(1) as f64;
    Ok(Score { start: mean(&|s| s.start), after: (0..=refine_steps).map(|k| mean(&|s| s.after[k])).collect() })
}
