//! A clip, opened for a run: every program reads clips in this way.

use std::sync::Arc;

use lgs_formats::{clip::Clip, clip_dir::ClipDir};

use super::{
    Drawing, Figures, Inputs, MemorySettings, RenderedView, Silent, Stage, Watch, check_memory, evaluate_views,
};
use crate::{
    calibration::{Believed, Findings, Lenses, Mounts, Shutters, calibrated},
    error::{EngineError, Result},
    evaluate::{ViewFigures, lpips::Lpips},
    gaussians::{GaussianSet, motion::Motion, physical::to_physical},
    photometry::Colours,
    render::Device,
    views::{ClipFrame, Role, SelectedFrames, Selection, View, load_views},
};

/// How a clip is opened for a run.
#[derive(Clone, Debug, Default)]
pub struct Opening {
    /// Cameras, frames, image size.
    pub selection: Selection,
    /// Where initial velocities come from.
    pub motion: Motion,
    /// Which lens distortion images have.
    pub lenses: Lenses,
    /// Where cameras are mounted.
    pub mounts: Mounts,
    /// Which statements on the moments of images are believed.
    pub shutters: Shutters,
    /// Whether cameras are brought to common colours.
    pub colours: Colours,
    /// The camera to whose colours and mount the others are brought; `None` for the first, and for mounts the one against which the others are
    /// least off.
    pub reference_camera: Option<String>,
    /// The frame and time zero to work in; `None` for those of the first input frame.
    pub clip_frame: Option<ClipFrame>,
    /// Names of the settings that lower the need of memory.
    pub memory: MemorySettings,
}

impl Opening {
    /// A selection, everything else as usual.
    pub fn of(selection: Selection) -> Self {
        Self { selection, ..Self::default() }
    }

    /// The same, all that the clip says of its cameras believed, and images as they were taken.
    #[must_use]
    pub fn as_stated(self) -> Self {
        Self {
            lenses: Lenses::Stated,
            mounts: Mounts::Stated,
            shutters: Shutters::Stated,
            colours: Colours::AsTaken,
            ..self
        }
    }
}

/// A clip, opened for a run: its input views are loaded; those that are held out are read when they are asked for, which is after the scene is
/// final.
#[derive(Debug)]
pub struct Session {
    dir: Arc<ClipDir>,
    selection: Selection,
    frames: SelectedFrames,
    clip_frame: ClipFrame,
    findings: Findings,
    inputs: Inputs,
}

impl Session {
    /// The clip, opened; loading counts as [`Stage::Load`].
    ///
    /// # Errors
    /// A selection that does not fit the clip, more of it than there is memory for, a reference camera without input images, and whatever is
    /// wrong with a file.
    pub fn open(dir: Arc<ClipDir>, opening: Opening, watch: &mut Watch<'_>) -> Result<Self> {
        Self::open_changed(dir, opening, watch, |_| ())
    }

    /// As [`Session::open`], the input views changed before anything is made of them.
    ///
    /// # Errors
    /// Those of [`Session::open`].
    pub fn open_changed(
        dir: Arc<ClipDir>,
        opening: Opening,
        watch: &mut Watch<'_>,
        change: impl FnOnce(&mut Vec<View>),
    ) -> Result<Self> {
        let Opening { selection, motion, lenses, mounts, shutters, colours, reference_camera, clip_frame, memory } =
            opening;
        check_memory(&dir, &selection, memory)?;
        let frames = selection.frames(dir.clip())?;
        let num_images = selection.num_images(dir.clip(), Role::Input)?;
        let reference = reference_camera.as_deref();
        let believed = Believed { lenses, mounts, shutters, reference };
        let (changed, findings) = watch.time(Stage::Load, |_| calibrated(&dir, &selection, believed))?;
        let dir = changed.map_or(dir, Arc::new);
        let clip_frame =
            clip_frame.unwrap_or_else(|| ClipFrame::of(dir.clip(), frames.input.first().copied().unwrap_or(0)));
        let mut views = watch.stage(Stage::Load, num_images, |progress| {
            load_views(&dir, &selection, Role::Input, &clip_frame, &|| progress.step(Stage::Load))
        })?;
        change(&mut views);
        if let Some(name) = reference.filter(|&name| views.iter().all(|view| view.camera != name)) {
            return Err(EngineError::Setting {
                setting: "reference-camera",
                expected: "a camera with input images".to_owned(),
                found: name.to_owned(),
            });
        }
        let inputs = Inputs::new(Arc::clone(&dir), &frames, clip_frame, views)?.with_motion(motion);
        let inputs = match colours {
            Colours::Auto => watch.time(Stage::Load, |_| inputs.with_common_colours(reference)),
            Colours::AsTaken => inputs,
        };
        Ok(Self { dir, selection, frames, clip_frame, findings, inputs })
    }

    /// The clip, with the lenses and mounts that its images ask for.
    pub fn clip(&self) -> &Clip {
        self.dir.clip()
    }

    /// What was asked for.
    pub const fn selection(&self) -> &Selection {
        &self.selection
    }

    /// The frames by what they are for.
    pub const fn frames(&self) -> &SelectedFrames {
        &self.frames
    }

    /// The frame and the time zero of the reconstruction.
    pub const fn clip_frame(&self) -> &ClipFrame {
        &self.clip_frame
    }

    /// What is otherwise than the clip states.
    pub const fn findings(&self) -> &Findings {
        &self.findings
    }

    /// What the reconstruction reads.
    pub const fn inputs(&self) -> &Inputs {
        &self.inputs
    }

    /// The input views, for who needs nothing else of the clip any more.
    pub fn into_views(self) -> Vec<View> {
        self.inputs.into_views()
    }

    /// The held-out views, in the colours of the inputs, read now.
    ///
    /// # Errors
    /// Whatever is wrong with a file.
    pub fn held_out(&self, watch: &mut Watch<'_>) -> Result<Vec<View>> {
        let num_images = self.selection.num_images(self.dir.clip(), Role::HeldOut)?;
        let mut views = watch.stage(Stage::Load, num_images, |progress| {
            let step = || progress.step(Stage::Load);
            load_views(&self.dir, &self.selection, Role::HeldOut, &self.clip_frame, &step)
        })?;
        self.inputs.colours().apply(&mut views);
        Ok(views)
    }

    /// What the figures of its views are measured against.
    pub fn truth<'a>(&'a self, lpips: Option<&'a Lpips>) -> Figures<'a> {
        Figures::OfTruth { clip: self.dir.clip(), frame: &self.clip_frame, lpips }
    }

    /// Mean figures of a scene over views of the clip.
    ///
    /// # Errors
    /// Those of [`evaluate_views`].
    pub fn mean_figures(&self, scene: &GaussianSet, views: &[View], lpips: Option<&Lpips>) -> Result<ViewFigures> {
        let views: Vec<&View> = views.iter().collect();
        let drawing = Drawing { scene: &to_physical(scene), scores: None, device: Device::Cpu };
        let keep = |drawn: RenderedView<'_>| -> Result<ViewFigures> { Ok(drawn.figures.copied().unwrap_or_default()) };
        let all = evaluate_views(drawing, &views, self.truth(lpips), &mut Watch::new(&Silent), &keep)?;
        Ok(ViewFigures::mean(all.iter()))
    }
}
