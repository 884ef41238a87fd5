//! What one step is computed from: input views, target views, the initial Gaussians.

use std::sync::Arc;

use lgs_engine::{
    gaussians::{Coarseness, GaussianSet, Start},
    pipeline::{MemorySettings, Opening, Run, Session, Silent, Watch, check_refinement},
    views::{ClipFrame, View},
};
use lgs_formats::pose::Pose;

use super::{
    augment::{Light, Window, add_noise, disturb, mirror},
    clips::{Draw, TrainingClip},
    nearby::keep_nearby,
    settings::Settings,
};
use crate::{
    error::Result,
    scenes::{maths::rotation_z, rng::Rng},
    velocity::TrueVelocities,
};

/// Share of the steps that start from disturbed Gaussians.
const DISTURBED: f64 = 0.1;
/// Share of the steps that start as coarse as usual.
const USUAL: f64 = 0.6;
/// Coarseness of the others.
const COARSENESS: [f64; 2] = [0.0, 2.0];
/// Largest distance by which the clip frame is moved, metres: voxels fall elsewhere.
const MOVED: f64 = 5.0;
/// What lowers the number of the views of a step, and of the sweeps behind them.
const VIEWS: MemorySettings = MemorySettings { images: "max-views", returns: "max-views" };
/// What lowers the number of the Gaussians of a step.
const CROP: MemorySettings = MemorySettings { images: "crop", returns: "crop" };

/// What one step is computed from.
#[derive(Debug)]
pub struct Sample {
    /// Which step.
    pub step: u64,
    /// The initial Gaussians.
    pub scene: GaussianSet,
    /// Views that the network's gradients and the loss come from.
    pub inputs: Vec<View>,
    /// Views of other frames, which the loss alone reads.
    pub targets: Vec<View>,
    /// True velocities of the initial Gaussians, where boxes tell them and other timestamps can show them.
    pub(crate) velocities: Option<TrueVelocities>,
    /// Draws for what the step itself leaves to chance.
    pub(crate) rng: Rng,
}

/// The sample of a step: the same for a seed and a step, whatever came before.
///
/// # Errors
/// Whatever is wrong with the clip that was drawn, and more of it than there is memory for.
pub fn sample(clips: &[TrainingClip], settings: &Settings, step: u64) -> Result<Sample> {
    let mut rng = Rng::new(settings.seed, step);
    let clip = &clips[rng.index(clips.len())];
    let draw = clip.draw(&mut rng, settings.max_views)?;
    let (frame, mut watch) = (clip_frame(&draw, &mut rng)?, Watch::new(&Silent));
    let opening = Opening { clip_frame: Some(frame), memory: VIEWS, ..Opening::of(draw.selection().clone()) };
    let mut changed = None;
    let session = Session::open_changed(Arc::clone(draw.dir()), opening.as_stated(), &mut watch, |inputs| {
        let light = Light::draw(&mut rng);
        let window = inputs.first().map(|view| {
            let size = [view.pinhole.height, view.pinhole.width];
            Window::draw(&mut rng, size, settings.crop)
        });
        let change = move |view: &mut View| {
            if let Some(window) = window {
                *view = window.of(view);
            }
            light.apply(view);
        };
        inputs.iter_mut().for_each(change);
        if settings.noise > 0.0 {
            add_noise(inputs, settings.noise, &mut rng);
        }
        changed = Some(change);
    })?;
    let mut targets = session.held_out(&mut watch)?;
    if let Some(change) = changed {
        targets.iter_mut().for_each(change);
    }
    let frames = session.frames().clone();
    let begun = Start { coarseness: coarseness(&mut rng), ..Start::default() };
    let mut scene = session.run(&Run::initial(begun), &mut watch)?.scene;
    let mut inputs = session.into_views();
    let mut velocities = (settings.velocity > 0.0 && frames.input.len() > 1)
        .then(|| TrueVelocities::of(draw.dir().clip(), &frame, &frames.input, draw.allowed(), &scene))
        .flatten();
    keep_nearby(&mut scene, &mut velocities, &inputs.iter().chain(&targets).collect::<Vec<_>>());
    check_refinement([scene.num_lidar, scene.len() - scene.num_lidar], None, CROP)?;
    if rng.chance(DISTURBED) {
        disturb(&mut scene, &mut rng);
    }
    // Without a share nothing is drawn: runs from before there was one go on as they were.
    if settings.mirrored > 0.0 && rng.chance(settings.mirrored) {
        let num_inputs = inputs.len();
        inputs.append(&mut targets);
        mirror(&mut scene, &mut inputs);
        velocities.iter_mut().for_each(TrueVelocities::mirror);
        targets = inputs.split_off(num_inputs);
    }
    Ok(Sample { step, scene, inputs, targets, velocities, rng })
}

/// How coarse the initial Gaussians of a step are.
fn coarseness(rng: &mut Rng) -> Coarseness {
    let [least, most] = COARSENESS;
    let usual = rng.chance(USUAL);
    let other = Coarseness::new(rng.uniform(least, most));
    other.filter(|_| !usual).unwrap_or_default()
}

/// The clip frame of a draw, turned about its vertical axis and moved.
fn clip_frame(draw: &Draw<'_>, rng: &mut Rng) -> Result<ClipFrame> {
    let clip = draw.dir().clip();
    let first = draw.selection().frames(clip)?.input.first().copied().unwrap_or(0);
    let own = ClipFrame::of(clip, first);
    let turn = rotation_z(rng.uniform(0.0, std::f64::consts::TAU));
    let offset = [rng.uniform(-MOVED, MOVED), rng.uniform(-MOVED, MOVED), rng.uniform(-0.5, 0.5)];
    Ok(ClipFrame { clip_from_world: Pose::new(turn, offset.into()) * own.clip_from_world, ..own })
}
