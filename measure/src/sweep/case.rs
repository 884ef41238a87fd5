//! A clip under measurement: what a reconstruction reads of it, and, once that is done, what only the figures read.

use std::{sync::Arc, time::Instant};

use lgs_engine::{
    error::Result as EngineResult,
    evaluate::{ViewFigures, lpips::Lpips},
    gaussians::{GaussianSet, physical::to_physical},
    pipeline::{Drawing, Opening, RenderedView, Session, Silent, Watch, evaluate_views},
    render::Device,
    views::{Role, View},
};
use lgs_formats::{clip::Clip, clip_dir::ClipDir};
use serde::{Deserialize, Serialize};

use super::crop::Crop;
use crate::{clips::Choice, error::Result, means::Means};

/// How much there is to do on a clip, for whoever wants to tell its times in advance.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Work {
    /// Input views.
    pub input_views: usize,
    /// Pixels of all of them.
    pub input_pixels: usize,
    /// Held-out views.
    pub held_out_views: usize,
    /// Moments of input sweeps.
    pub input_frames: usize,
}

/// A clip, and how it is read.
#[derive(Debug)]
pub struct Case {
    dir: Arc<ClipDir>,
    opening: Opening,
}

/// What was found out about a scene.
#[derive(Debug)]
pub struct SceneFigures {
    /// Mean figures over the held-out views.
    pub figures: Means,
    /// A part of the first held-out view as it was drawn.
    pub crop: Option<Crop>,
}

impl Case {
    /// The clip as `choice` says.
    ///
    /// # Errors
    /// A choice that does not fit the clip.
    pub fn new(dir: ClipDir, choice: &Choice) -> Result<Self> {
        let opening = choice.opening(dir.clip())?;
        // Says what is wrong with the cameras, before any work.
        opening.selection.num_images(dir.clip(), Role::Input)?;
        Ok(Self { dir: Arc::new(dir), opening })
    }

    /// What the clip says.
    pub fn clip(&self) -> &Clip {
        self.dir.clip()
    }

    /// The clip, opened, and the seconds that it took.
    ///
    /// # Errors
    /// Whatever is wrong with an image.
    pub fn open(&self) -> Result<(Session, f64)> {
        let start = Instant::now();
        let session = Session::open(Arc::clone(&self.dir), self.opening.clone(), &mut Watch::new(&Silent))?;
        Ok((session, start.elapsed().as_secs_f64()))
    }
}

impl Work {
    /// How much there is to do on an opened clip.
    ///
    /// # Errors
    /// A selection that does not fit the clip.
    pub fn of(session: &Session) -> Result<Self> {
        let views = session.inputs().views();
        let pixels = |view: &View| view.pinhole.width * view.pinhole.height;
        Ok(Self {
            input_views: views.len(),
            input_pixels: views.iter().map(pixels).sum(),
            held_out_views: session.selection().num_images(session.clip(), Role::HeldOut)?,
            input_frames: session.frames().input.len(),
        })
    }
}

/// What each of `scenes` is worth on the held-out views, which are read here, when the scenes are final.
///
/// # Errors
/// Whatever is wrong with an image; a scene that draws a value that is not finite.
pub fn scene_figures(session: &Session, scenes: &[&GaussianSet], lpips: Option<&Lpips>) -> Result<Vec<SceneFigures>> {
    let held_out = session.held_out(&mut Watch::new(&Silent))?;
    let views: Vec<&View> = held_out.iter().collect();
    let scored = |scene: &&GaussianSet| -> Result<SceneFigures> {
        let keep = |drawn: RenderedView<'_>| -> EngineResult<(ViewFigures, Option<Crop>)> {
            let RenderedView { view, rendered, figures, .. } = drawn;
            let shown = views.first().is_some_and(|first| std::ptr::eq(*first, view));
            let crop = shown.then(|| Crop::of(&rendered.rgb, &view.image));
            Ok((figures.copied().unwrap_or_default(), crop))
        };
        let drawing = Drawing { scene: &to_physical(scene), scores: None, device: Device::Cpu };
        let all = evaluate_views(drawing, &views, session.truth(lpips), &mut Watch::new(&Silent), &keep)?;
        let (figures, crops): (Vec<_>, Vec<_>) = all.into_iter().unzip();
        Ok(SceneFigures { figures: ViewFigures::mean(figures.iter()).into(), crop: crops.into_iter().flatten().next() })
    };
    scenes.iter().map(scored).collect()
}

/// The truth behind [`SceneFigures::crop`]; `None` where nothing is held out.
///
/// # Errors
/// Whatever is wrong with an image.
pub fn truth(session: &Session) -> Result<Option<Crop>> {
    let held_out = session.held_out(&mut Watch::new(&Silent))?;
    Ok(held_out.first().map(|view| Crop::of(&view.image.data, &view.image)))
}
