//! A clip, ready to be reconstructed and measured: what the reconstruction reads, and apart from it what only the figures read.

use lgs_engine::{
    evaluate::{ViewFigures, lpips::Lpips},
    gaussians::{GaussianSet, background::Mode, physical::to_physical},
    pipeline::{
        Drawing, Figures, Flags, Inputs, Reconstruction, RenderedView, Silent, Watch, check_memory, evaluate_views,
        reconstruct,
    },
    report::{RoleMeans, ViewRecord},
    views::{ClipFrame, Role, SelectedFrames, Selection, View, load_views},
};
use lgs_formats::{
    clip::Clip,
    clip_dir::{ClipDir, Needed},
    importers,
};

use super::choice::Choice;
use crate::error::Result;

/// Most frames of a clip whose files are looked for one by one.
const MAX_FRAMES: usize = 1_000_000;

/// A clip, ready to be reconstructed and measured.
#[derive(Debug)]
pub struct Subject<'a> {
    dir: &'a ClipDir,
    frames: SelectedFrames,
    frame: ClipFrame,
    inputs: Inputs<'a>,
    held_out: Vec<View>,
    lpips: Option<&'a Lpips>,
}

/// The clip of a choice.
///
/// # Errors
/// Whatever is wrong with it.
pub fn open(choice: &Choice) -> Result<ClipDir> {
    let frames = choice.num_frames.map(|count| (0..count.min(MAX_FRAMES)).collect());
    Ok(importers::open_part(&choice.dir, &Needed { frames, cameras: choice.cameras.clone() })?)
}

impl<'a> Subject<'a> {
    /// The opened clip of `choice`, its views loaded.
    ///
    /// # Errors
    /// Whatever is wrong with the clip, and a choice that does not fit it.
    pub fn load(dir: &'a ClipDir, choice: &Choice, lpips: Option<&'a Lpips>) -> Result<Self> {
        let clip = dir.clip();
        let num_frames = clip.frames.len().min(choice.num_frames.unwrap_or(usize::MAX));
        let chosen: Vec<usize> = (0..num_frames).collect();
        let hold_out = choice.hold_out.indices(num_frames, Some(&chosen))?;
        let cameras = choice.cameras.clone().or_else(|| choice.num_cameras.map(|count| first_cameras(clip, count)));
        let selection = Selection { cameras, frames: Some(chosen), hold_out, image_size: choice.image_size };
        check_memory(dir, &selection, Flags::default())?;
        let frames = selection.frames(clip)?;
        let frame = ClipFrame::of(clip, frames.input.first().copied().unwrap_or(0));
        let load = |role| load_views(dir, &selection, role, &frame, &|| ());
        let inputs = Inputs::new(dir, &frames, frame, load(Role::Input)?)?.with_motion(choice.motion);
        let inputs = inputs.with_common_colours(None);
        let mut held_out = load(Role::HeldOut)?;
        inputs.colours().apply(&mut held_out);
        Ok(Self { dir, frame, inputs, held_out, frames, lpips })
    }

    /// What the reconstruction reads.
    pub fn inputs(&self) -> &Inputs<'a> {
        &self.inputs
    }

    /// The input views.
    pub fn views(&self) -> Vec<&View> {
        self.inputs.views().iter().collect()
    }

    /// Numbers of input and of held-out views.
    pub fn num_views(&self) -> [usize; 2] {
        [self.inputs.views().len(), self.held_out.len()]
    }

    /// The clip.
    pub fn clip(&self) -> &'a Clip {
        self.dir.clip()
    }

    /// The frame and the time zero of its reconstruction.
    pub fn frame(&self) -> &ClipFrame {
        &self.frame
    }

    /// The frames by what they are for.
    pub fn frames(&self) -> &SelectedFrames {
        &self.frames
    }

    /// The initial Gaussians, as they are without a network.
    ///
    /// # Errors
    /// Whatever is wrong with a sweep.
    pub fn start(&self) -> Result<Reconstruction> {
        Ok(reconstruct(&self.inputs, Mode::Auto, None, &mut Watch::new(&Silent))?)
    }

    /// Mean figures of a scene over the held-out views.
    ///
    /// # Errors
    /// When the scene draws a value that is not finite.
    pub fn figures(&self, scene: &GaussianSet) -> Result<ViewFigures> {
        let splats = to_physical(scene);
        let truth = Figures::OfTruth { clip: self.dir.clip(), frame: &self.frame, lpips: self.lpips };
        let keep = |drawn: RenderedView<'_>| -> lgs_engine::error::Result<ViewRecord> {
            let RenderedView { view, figures, .. } = drawn;
            let View { frame, camera, role, .. } = view;
            let figures = figures.cloned().unwrap_or_default();
            Ok(ViewRecord { frame: *frame, camera: camera.clone(), role: *role, figures })
        };
        let views: Vec<&View> = self.held_out.iter().collect();
        let drawing = Drawing { scene: &splats, scores: None };
        let records = evaluate_views(drawing, &views, truth, &mut Watch::new(&Silent), &keep)?;
        Ok(RoleMeans::of(&records).held_out)
    }
}

fn first_cameras(clip: &Clip, count: usize) -> Vec<String> {
    let records = clip.frames.first().map(|frame| frame.cameras.as_slice()).unwrap_or_default();
    records.iter().take(count).map(|record| record.camera.name.clone()).collect()
}
