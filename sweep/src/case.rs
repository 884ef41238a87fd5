//! A clip under measurement: what a reconstruction reads of it, and, once that is done, what only the figures read.

use std::time::Instant;

use lgs_engine::{
    error::Result as EngineResult,
    evaluate::{ViewFigures, lpips::Lpips},
    gaussians::{GaussianSet, motion::Motion, physical::to_physical},
    photometry::CommonColours,
    pipeline::{Drawing, Figures, Inputs, RenderedView, Silent, Watch, evaluate_views},
    report::{RoleMeans, ViewRecord},
    views::{ClipFrame, Role, SelectedFrames, Selection, View, load_views},
};
use lgs_formats::clip_dir::ClipDir;
use lgs_train::ablate::{choice::Choice, record::Means};
use serde::{Deserialize, Serialize};

use super::{crop::Crop, error::Result};

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
pub struct Case<'a> {
    dir: &'a ClipDir,
    selection: Selection,
    frames: SelectedFrames,
    frame: ClipFrame,
    motion: Motion,
}

/// What was found out about a scene.
#[derive(Debug)]
pub struct Verdict {
    /// Mean figures over the held-out views.
    pub figures: Means,
    /// A part of the first held-out view as it was drawn.
    pub crop: Option<Crop>,
}

impl<'a> Case<'a> {
    /// The clip as `choice` says.
    ///
    /// # Errors
    /// A choice that does not fit the clip.
    pub fn new(dir: &'a ClipDir, choice: &Choice) -> Result<Self> {
        let clip = dir.clip();
        let num_frames = clip.frames.len().min(choice.num_frames.unwrap_or(usize::MAX));
        let chosen: Vec<usize> = (0..num_frames).collect();
        let hold_out = choice.hold_out.indices(num_frames, Some(&chosen))?;
        let cameras = choice.cameras.clone();
        let selection = Selection { cameras, frames: Some(chosen), hold_out, image_size: choice.image_size };
        let frames = selection.frames(clip)?;
        // Says what is wrong with the cameras, before any work.
        selection.num_images(clip, Role::Input)?;
        let frame = ClipFrame::of(clip, frames.input.first().copied().unwrap_or(0));
        Ok(Self { dir, selection, frames, frame, motion: choice.motion })
    }

    fn load(&self, role: Role) -> Result<Vec<View>> {
        Ok(load_views(self.dir, &self.selection, role, &self.frame, &|| ())?)
    }

    /// What a reconstruction reads, and the seconds that loading took.
    ///
    /// # Errors
    /// Whatever is wrong with an image.
    pub fn inputs(&self) -> Result<(Inputs<'a>, f64)> {
        let start = Instant::now();
        let inputs = Inputs::new(self.dir, &self.frames, self.frame, self.load(Role::Input)?)?;
        let inputs = inputs.with_motion(self.motion).with_common_colours(None);
        Ok((inputs, start.elapsed().as_secs_f64()))
    }

    /// How much there is to do.
    ///
    /// # Errors
    /// A selection that does not fit the clip.
    pub fn work(&self, inputs: &Inputs<'_>) -> Result<Work> {
        let pixels = |view: &View| view.pinhole.width * view.pinhole.height;
        Ok(Work {
            input_views: inputs.views().len(),
            input_pixels: inputs.views().iter().map(pixels).sum(),
            held_out_views: self.selection.num_images(self.dir.clip(), Role::HeldOut)?,
            input_frames: self.frames.input.len(),
        })
    }

    /// What each of `scenes` is worth on the held-out views, which are read here, when the scenes are final.
    ///
    /// # Errors
    /// Whatever is wrong with an image; a scene that draws a value that is not finite.
    pub fn judge(
        &self,
        colours: &CommonColours,
        scenes: &[&GaussianSet],
        lpips: Option<&Lpips>,
    ) -> Result<Vec<Verdict>> {
        let mut held_out = self.load(Role::HeldOut)?;
        colours.apply(&mut held_out);
        let views: Vec<&View> = held_out.iter().collect();
        let truth = Figures::OfTruth { clip: self.dir.clip(), frame: &self.frame, lpips };
        let judge = |scene: &&GaussianSet| -> Result<Verdict> {
            let keep = |drawn: RenderedView<'_>| -> EngineResult<(ViewRecord, Option<Crop>)> {
                let RenderedView { view, rendered, figures, .. } = drawn;
                let View { frame, camera, role, .. } = view;
                let figures: ViewFigures = figures.cloned().unwrap_or_default();
                let shown = views.first().is_some_and(|first| std::ptr::eq(*first, view));
                let crop = shown.then(|| Crop::of(&rendered.rgb, &view.image));
                Ok((ViewRecord { frame: *frame, camera: camera.clone(), role: *role, figures }, crop))
            };
            let drawing = Drawing { scene: &to_physical(scene), scores: None };
            let all = evaluate_views(drawing, &views, truth, &mut Watch::new(&Silent), &keep)?;
            let (records, crops): (Vec<_>, Vec<_>) = all.into_iter().unzip();
            let figures = RoleMeans::of(&records).held_out.into();
            Ok(Verdict { figures, crop: crops.into_iter().flatten().next() })
        };
        scenes.iter().map(judge).collect()
    }

    /// The truth behind [`Verdict::crop`]; `None` where nothing is held out.
    ///
    /// # Errors
    /// Whatever is wrong with an image.
    pub fn truth(&self) -> Result<Option<Crop>> {
        Ok(self.load(Role::HeldOut)?.first().map(|view| Crop::of(&view.image.data, &view.image)))
    }
}
