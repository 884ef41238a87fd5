//! What a reconstruction may read.

use std::sync::Arc;

use lgs_formats::{casts::to_f32, clip_dir::ClipDir};

use crate::{
    error::{EngineError, Result},
    gaussians::motion::{self, Motion, Movement, MovingBox},
    photometry::{self, CommonColours, Photometry},
    points::{self, PointCloud, Stamp, Timing, Turn},
    views::{ClipFrame, Role, SelectedFrames, View},
};

/// The views and sweeps of the input frames of a clip, and of no other frame.
#[derive(Debug)]
pub struct Inputs {
    dir: Arc<ClipDir>,
    frames: Vec<usize>,
    frame: ClipFrame,
    views: Vec<View>,
    motion: Motion,
    colours: CommonColours,
    aside: Vec<View>,
}

impl Inputs {
    /// The inputs of a reconstruction from `views`, all of which must be input views of input frames.
    ///
    /// # Errors
    /// [`EngineError::Leak`] for a view that is not.
    pub fn new(dir: Arc<ClipDir>, frames: &SelectedFrames, frame: ClipFrame, views: Vec<View>) -> Result<Self> {
        let allowed = |view: &View| view.role == Role::Input && frames.input.contains(&view.frame);
        match views.iter().find(|view| !allowed(view)) {
            Some(view) => Err(EngineError::Leak { frame: view.frame }),
            None => {
                let (frames, motion, aside) = (frames.input.clone(), Motion::default(), Vec::new());
                Ok(Self { dir, frames, frame, views, motion, colours: CommonColours::default(), aside })
            }
        }
    }

    /// The same with initial velocities as `motion` says.
    #[must_use]
    pub(crate) fn with_motion(self, motion: Motion) -> Self {
        Self { motion, ..self }
    }

    /// The same with cameras that agree on colours: grey ones beside colour ones step aside, and where colour ones disagree all images are of
    /// common colours, those of the camera `reference` or else of the first.
    #[must_use]
    pub(crate) fn with_common_colours(mut self, reference: Option<&str>) -> Self {
        self.aside = photometry::put_aside(&mut self.views);
        let mut grey: Vec<String> = self.aside.iter().map(|view| view.camera.clone()).collect();
        grey.sort_unstable();
        grey.dedup();
        self.colours = CommonColours { photometry: Photometry::estimate(&self.views, reference), grey };
        self.colours.apply(&mut self.views);
        self
    }

    /// How images are compared with a scene that these make.
    pub const fn colours(&self) -> &CommonColours {
        &self.colours
    }

    /// The views of grey cameras, from which nothing is taken.
    pub fn aside(&self) -> &[View] {
        &self.aside
    }

    /// Where the initial velocities come from.
    pub const fn motion(&self) -> Motion {
        self.motion
    }

    /// What moves among the returns of the cloud.
    ///
    /// # Errors
    /// [`EngineError::Setting`] where boxes are to tell and no input frame has any.
    pub(super) fn movement(&self, cloud: &PointCloud) -> Result<Movement> {
        match self.motion {
            Motion::None => Ok(Movement::none(cloud.len())),
            Motion::Registered => Ok(motion::registered(cloud, &self.views)),
            Motion::Boxes => {
                let boxes = self.boxes();
                if boxes.is_empty() {
                    let expected = "`boxes` of an input frame in clip.json for boxes".to_owned();
                    return Err(EngineError::Setting { setting: "motion", expected, found: "none".to_owned() });
                }
                Ok(motion::boxed(cloud, &boxes))
            }
        }
    }

    /// How the `LiDAR` turned while it measured the returns of the cloud, where its sweeps tell and the clip does not; these are then where
    /// they were measured.
    ///
    /// # Errors
    /// Those of [`points::tell_apart`].
    pub(super) fn tell_apart(&self, cloud: &mut PointCloud) -> Result<Option<Turn>> {
        points::tell_apart(cloud, self.dir.clip(), &self.frame)
    }

    /// What moves among the returns of the cloud, and when these were measured where the clip does not say and the outlines of what moves tell:
    /// the returns of the cloud then have such times, and what moves is found with these.
    ///
    /// # Errors
    /// Those of [`Self::movement`].
    pub(super) fn movement_and_times(&self, cloud: &mut PointCloud) -> Result<(Movement, Timing)> {
        let (mut movement, mut told) = (self.movement(cloud)?, Timing::default());
        if let Some(sweep_s) = points::sweep_seconds(cloud, self.dir.clip()) {
            let stamps = [Stamp::Beginning, Stamp::End];
            let delays = stamps.map(|stamp| to_f32(stamp.delay(sweep_s)));
            if let Some(best) = motion::best_delay(cloud, &movement, &self.views, &delays) {
                told.stamp = Some(stamps[best]);
                cloud.times.iter_mut().for_each(|time| *time += delays[best]);
                movement = self.movement(cloud)?;
            }
        }
        let Some(turns) = points::standing(cloud, self.dir.clip(), &self.frame) else { return Ok((movement, told)) };
        let times = turns.each_ref().map(|(_, times)| times.as_slice());
        if let Some(best) = motion::best_times(cloud, &movement, &self.views, &times) {
            let [first, second] = turns;
            let (turn, times) = if best == 0 { first } else { second };
            (told.turn, cloud.times) = (Some(turn), times);
            movement = self.movement(cloud)?;
        }
        Ok((movement, told))
    }

    /// The tracked boxes of the input frames.
    fn boxes(&self) -> Vec<MovingBox> {
        let frame_boxes = |&frame: &usize| {
            let record = &self.dir.clip().frames[frame];
            record.boxes.iter().flatten().map(move |tracked| MovingBox {
                frame: u32::try_from(frame).unwrap_or(u32::MAX),
                time: record.lidar.timestamp - self.frame.time_zero,
                track: tracked.track.clone(),
                size: tracked.size,
                clip_from_box: self.frame.clip_from_world * tracked.world_from_box,
            })
        };
        self.frames.iter().flat_map(frame_boxes).collect()
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
        let cloud = points::aggregate(&self.dir, &self.frames, &self.frame)?;
        let allowed = |frame: u32| self.frames.iter().any(|&input| u32::try_from(input) == Ok(frame));
        match cloud.frames.chunk_by(|a, b| a == b).map(|run| run[0]).find(|&frame| !allowed(frame)) {
            Some(frame) => Err(EngineError::Leak { frame: frame as usize }),
            None => Ok(cloud),
        }
    }
}
