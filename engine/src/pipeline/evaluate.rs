//! A scene's views and their figures.

use std::borrow::Cow;

use lgs_formats::clip::Clip;

use super::{Stage, Watch};
use crate::{
    error::{EngineError, Result},
    evaluate::{ViewFigures, evaluate_view, lpips::Lpips, masks::dynamic_pixels},
    gaussians::physical::Splat,
    parallel,
    render::{Device, MemoryEstimate, Pass, Rendered},
    views::{ClipFrame, PinholeView, Role, View},
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
    /// No truth: the cameras are drawn at this moment (seconds since time zero), of which there is no image.
    AtTime(f32),
}

/// What is drawn.
#[derive(Clone, Copy, Debug)]
pub struct Drawing<'a> {
    /// The scene.
    pub scene: &'a [Splat],
    /// Scores for colours, drawn in input views; see [`DensityMap::splats`](crate::densify::DensityMap::splats).
    pub scores: Option<&'a [Splat]>,
    /// Where it is drawn.
    pub device: Device,
}

/// A view as it was drawn, with its figures.
#[derive(Clone, Copy, Debug)]
pub struct RenderedView<'a> {
    /// The view.
    pub view: &'a View,
    /// As it was drawn.
    pub rendered: &'a Rendered,
    /// The scores in this view; `None` when there are none, or it is held out.
    pub scores: Option<&'a Rendered>,
    /// Its figures; `None` when there is no truth.
    pub figures: Option<&'a ViewFigures>,
}

/// What `keep` makes of each of `views`, drawn and measured, in their order.
///
/// # Errors
/// Those of the figures and of `keep`; a view that cannot be drawn in the memory that is free.
pub fn evaluate_views<T: Send, E: From<EngineError> + Send>(
    drawing: Drawing<'_>,
    views: &[&View],
    figures: Figures<'_>,
    watch: &mut Watch<'_>,
    keep: &(dyn Fn(RenderedView<'_>) -> std::result::Result<T, E> + Sync),
) -> std::result::Result<Vec<T>, E> {
    let pinholes: Vec<PinholeView> = views.iter().map(|view| pinhole(view, figures)).collect();
    MemoryEstimate::of_splats(drawing.scene).check(&pinholes, Pass::Images)?;
    let stages = [Stage::Render, Stage::Evaluate];
    stages.iter().for_each(|&stage| watch.progress.begin(stage, views.len()));
    let mut kept = Vec::with_capacity(views.len());
    for batch in views.chunks(BATCH) {
        let taken: Vec<Cow<'_, View>> = batch.iter().map(|view| view.as_taken()).collect();
        let (rendered, scores): (Vec<Rendered>, Vec<Option<Rendered>>) = watch.time(Stage::Render, |progress| {
            let draw = |view: &&View| {
                let pinhole = pinhole(view, figures);
                let mut rendered = drawing.device.render(drawing.scene, &pinhole, BEHIND);
                if let Some(response) = view.response {
                    response.show(&mut rendered.rgb, &pinhole);
                }
                let scored = drawing.scores.filter(|_| view.role == Role::Input);
                let scores = scored.map(|splats| drawing.device.render(splats, &pinhole, BEHIND));
                progress.step(Stage::Render);
                (rendered, scores)
            };
            batch.iter().map(draw).unzip()
        });
        let measured: Vec<Option<ViewFigures>> = watch.time(Stage::Evaluate, |progress| {
            let measure = |i: usize| {
                let measured = measure(&taken[i], &rendered[i], figures);
                progress.step(Stage::Evaluate);
                measured
            };
            parallel::map(taken.len(), 1, &measure).into_iter().collect::<Result<_>>()
        })?;
        let new = parallel::map(taken.len(), 1, &|i| {
            let (scores, figures) = (scores[i].as_ref(), measured[i].as_ref());
            keep(RenderedView { view: &taken[i], rendered: &rendered[i], scores, figures })
        });
        kept.extend(new.into_iter().collect::<std::result::Result<Vec<T>, E>>()?);
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
