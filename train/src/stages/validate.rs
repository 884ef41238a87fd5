//! What a model is worth on held-out views of clips that training does not read, by the exact path of inference.

use std::{path::Path, sync::Arc};

use lgs_engine::{
    densify::{Scores, apply, decide},
    gaussians::{GaussianSet, background::Mode},
    network::model::Model,
    pipeline::{HoldOut, MemorySettings, Opening, Run, Session, Silent, Watch},
    predict::{backbone, predict, query, scores},
    refine::refine,
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
        let mut features = backbone(&set, model)?;
        query(&mut features, &set, model)?;
        predict(&mut set, &features, model)?;
        if let Some((thresholds, limit)) = update
            && let Some([prune, add]) = scores(&features, &set, model)?
        {
            set = apply(&set, &decide(&Scores { prune, add }, thresholds, limit)?, 0)?;
        }
        let mut after = vec![self.psnr(&set)?];
        let views: Vec<&View> = self.session.inputs().views().iter().collect();
        for _ in 0..refine_steps {
            refine(&mut set, &views, model, 1, || ())?;
            after.push(self.psnr(&set)?);
        }
        Ok(Score { start, after })
    }

    fn psnr(&self, set: &GaussianSet) -> Result<f64> {
        Ok(self.session.mean_figures(set, &self.held_out, None)?.psnr.unwrap_or(0.0))
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
