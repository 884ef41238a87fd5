//! What a model is worth on held-out views of clips that training does not read, by the exact path of inference.

use std::path::Path;

use lgs_engine::{
    densify::{Scores, apply, decide},
    evaluate::psnr::psnr,
    gaussians::{GaussianSet, background::Mode, physical::to_physical},
    network::model::FoldedModel,
    pipeline::{Flags, HoldOut, Inputs, Silent, Watch, check_memory, reconstruct},
    predict::{backbone, predict, query, scores},
    refine::refine,
    render::render,
    views::{ClipFrame, Role, Selection, View, load_views},
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
    inputs: Vec<View>,
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
        check_memory(&dir, &selection, Flags { images: "--validation-size", returns: "--validation" })?;
        let frames = selection.frames(dir.clip())?;
        let frame = ClipFrame::of(dir.clip(), frames.input.first().copied().unwrap_or(0));
        let load = |role| load_views(&dir, &selection, role, &frame, &|| ());
        let (inputs, held_out) = (load(Role::Input)?, load(Role::HeldOut)?);
        let inputs = Inputs::new(&dir, &frames, frame, inputs)?;
        let start = reconstruct(&inputs, Mode::Auto, None, &mut Watch::new(&Silent))?.scene;
        let identity = format!("{} ({})", dir.clip().name, dir.clip().source);
        Ok(Self { identity, start, inputs: inputs.into_views(), held_out })
    }

    /// The score of a model, its policy's decisions applied where there are any.
    ///
    /// # Errors
    /// When a position leaves the voxel grid.
    pub fn score(&self, model: &FoldedModel, refine_steps: usize, update: Option<SetUpdate>) -> Result<Score> {
        let mut set = self.start.clone();
        let start = self.psnr(&set);
        let mut features = backbone(&set, model)?;
        query(&mut features, &set, model)?;
        predict(&mut set, &mut features, model)?;
        if let Some((thresholds, limit)) = update
            && let Some([prune, add]) = scores(&mut features, &set, model)?
        {
            set = apply(&set, &decide(&Scores { prune, add }, thresholds, limit)?, 0)?;
        }
        let mut after = vec![self.psnr(&set)];
        let views: Vec<&View> = self.inputs.iter().collect();
        for _ in 0..refine_steps {
            refine(&mut set, &views, model, 1, || ())?;
            after.push(self.psnr(&set));
        }
        Ok(Score { start, after })
    }

    fn psnr(&self, set: &GaussianSet) -> f64 {
        let splats = to_physical(set);
        let of = |view: &View| {
            let drawn: Vec<f32> =
                render(&splats, &view.pinhole, [0.0; 3]).rgb.iter().map(|v| v.clamp(0.0, 1.0)).collect();
            psnr(&drawn, &view.image.data)
        };
        self.held_out.iter().map(of).sum::<f64>() / self.held_out.len().max(1) as f64
    }
}

/// The mean of the scores of clips.
///
/// # Errors
/// As [`ValidationClip::score`].
pub fn mean_score(
    clips: &[ValidationClip],
    model: &FoldedModel,
    refine_steps: usize,
    update: Option<SetUpdate>,
) -> Result<Score> {
    let score = |clip: &ValidationClip| clip.score(model, refine_steps, update);
    let scores: Vec<Score> = clips.iter().map(score).collect::<Result<_>>()?;
    let mean = |of: &dyn Fn(&Score) -> f64| scores.iter().map(of).sum::<f64>() / scores.len().max(1) as f64;
    Ok(Score { start: mean(&|s| s.start), after: (0..=refine_steps).map(|k| mean(&|s| s.after[k])).collect() })
}
