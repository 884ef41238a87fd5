//! A scene's views and their figures.

use lgs_formats::clip::Clip;
use rayon::prelude::*;

use super::{Stage, Watch};
use crate::{
    error::{EngineError, Result},
    evaluate::{ViewFigures, evaluate_view, lpips::Lpips, masks::dynamic_pixels},
    gaussians::physical::Splat,
    render::{Rendered, render},
    views::{ClipFrame, PinholeView, View},
};

/// Views that are in memory as rendered images at one time.
const BATCH: usize = 8;
/// Colour behind all Gaussians.
const BEHIND: [f32; 3] = [0.0; 3];

/// What the figures of a view are measured against.
#[derive(Clone, Copy, Debug)]
pub enum Figures<'a> {
    /// The view's own image and sweep.
    OfTruth {
        /// The clip, for its moving objects.
        clip: &'a Clip,
        /// Its frame.
        frame: &'a ClipFrame,
        /// The perceptual distance, when there is one.
        lpips: Option<&'a Lpips>,
    },
    /// Nothing: the cameras are drawn at this moment (seconds since time zero), of which there is no image.
    AtTime(f32),
}

/// A view as it was drawn, with its figures.
#[derive(Clone, Copy, Debug)]
pub struct RenderedView<'a> {
    /// The view.
    pub view: &'a View,
    /// As it was drawn.
    pub rendered: &'a Rendered,
    /// Its figures; `None` when there is no truth.
    pub figures: Option<&'a ViewFigures>,
}

/// What `keep` makes of each of `views`, drawn from `splats` and measured, in their order.
///
/// # Errors
/// Those of the figures and of `keep`.
pub fn evaluate_views<T: Send, E: From<EngineError> + Send>(
    splats: &[Splat],
    views: &[&View],
    figures: Figures<'_>,
    watch: &mut Watch<'_>,
    keep: &(dyn Fn(RenderedView<'_>) -> std::result::Result<T, E> + Sync),
) -> std::result::Result<Vec<T>, E> {
    let stages = [Stage::Render, Stage::Evaluate];
    stages.iter().for_each(|&stage| watch.progress.begin(stage, views.len()));
    let mut kept = Vec::with_capacity(views.len());
    for batch in views.chunks(BATCH) {
        let rendered: Vec<Rendered> = watch.time(Stage::Render, |progress| {
            let draw = |view: &&View| {
                let rendered = render(splats, &pinhole(view, figures), BEHIND);
                progress.step(Stage::Render);
                rendered
            };
            batch.iter().map(draw).collect()
        });
        let measured: Vec<Option<ViewFigures>> = watch.time(Stage::Evaluate, |progress| {
            let measure = |(view, rendered): (&&View, &Rendered)| {
                let measured = measure(view, rendered, figures);
                progress.step(Stage::Evaluate);
                measured
            };
            batch.par_iter().zip(&rendered).map(measure).collect::<Result<_>>()
        })?;
        let all = batch.par_iter().zip(&rendered).zip(&measured);
        let new =
            all.map(|((view, rendered), figures)| keep(RenderedView { view, rendered, figures: figures.as_ref() }));
        kept.extend(new.collect::<std::result::Result<Vec<T>, E>>()?);
    }
    stages.iter().for_each(|&stage| watch.progress.end(stage));
    Ok(kept)
}

fn pinhole(view: &View, figures: Figures<'_>) -> PinholeView {
    match figures {
        Figures::OfTruth { .. } => view.pinhole,
        Figures::AtTime(time) => PinholeView { time, ..view.pinhole },
    }
}

fn measure(view: &View, rendered: &Rendered, figures: Figures<'_>) -> Result<Option<ViewFigures>> {
    let Figures::OfTruth { clip, frame, lpips } = figures else { return Ok(None) };
    let dynamic = dynamic_pixels(clip, view, frame);
    evaluate_view(rendered, view, dynamic.as_deref(), lpips).map(Some)
}
