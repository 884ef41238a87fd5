//! What a reconstruction may read.

use lgs_formats::clip_dir::ClipDir;

use crate::{
    error::{EngineError, Result},
    gaussians::motion::Motion,
    points::{self, PointCloud},
    views::{ClipFrame, Role, SelectedFrames, View},
};

/// The views and sweeps of the input frames of a clip, and of no other frame.
#[derive(Debug)]
pub struct Inputs<'a> {
    dir: &'a ClipDir,
    frames: Vec<usize>,
    frame: ClipFrame,
    views: Vec<View>,
    motion: Motion,
}

impl<'a> Inputs<'a> {
    /// The inputs of a reconstruction from `views`, all of which must be input views of input frames.
    ///
    /// # Errors
    /// [`EngineError::Leak`] for a view that is not.
    pub fn new(dir: &'a ClipDir, frames: &SelectedFrames, frame: ClipFrame, views: Vec<View>) -> Result<Self> {
        let allowed = |view: &View| view.role == Role::Input && frames.input.contains(&view.frame);
        match views.iter().find(|view| !allowed(view)) {
            Some(view) => Err(EngineError::Leak { frame: view.frame }),
            None => Ok(Self { dir, frames: frames.input.clone(), frame, views, motion: Motion::default() }),
        }
    }

    /// The same with initial velocities as `motion` says.
    #[must_use]
    pub fn with_motion(self, motion: Motion) -> Self {
        Self { motion, ..self }
    }

    /// Where the initial velocities come from.
    pub const fn motion(&self) -> Motion {
        self.motion
    }

    /// Where the sensor was at the timestamp of each input sweep, metres, clip frame; [`PointCloud::origins`] has the place for each return.
    pub fn sensors(&self) -> Vec<[f32; 3]> {
        let sweep = |&frame: &usize| &self.dir.clip().frames[frame].lidar;
        let origins = self.frames.iter().map(|frame| self.frame.points(&sweep(frame).world_from_lidar, &[[0.0; 3]])[0]);
        origins.collect()
    }

    /// The input views.
    pub fn views(&self) -> &[View] {
        &self.views
    }

    /// The input views, for who needs nothing else of the inputs any more.
    pub fn into_views(self) -> Vec<View> {
        self.views
    }

    /// The sweeps of the input frames as one cloud.
    ///
    /// # Errors
    /// Whatever is wrong with a sweep's file; [`EngineError::Leak`] for a return of another frame.
    pub fn cloud(&self) -> Result<PointCloud> {
        let cloud = points::aggregate(self.dir, &self.frames, &self.frame)?;
        let allowed = |frame: u32| self.frames.iter().any(|&input| u32::try_from(input) == Ok(frame));
        match cloud.frames.chunk_by(|a, b| a == b).map(|run| run[0]).find(|&frame| !allowed(frame)) {
            Some(frame) => Err(EngineError::Leak { frame: frame as usize }),
            None => Ok(cloud),
        }
    }
}
