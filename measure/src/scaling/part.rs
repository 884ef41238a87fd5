//! The parts of a run whose growth is looked at.

use lgs_engine::pipeline::{PointStep, Stage};
use serde::{Deserialize, Serialize};

use super::{fit::KINDS, plan::Axis, work::Work};

/// A part of a run, in the order of the work.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Part {
    /// Images and sweeps are read.
    Load,
    /// Sweeps meet in one frame.
    Cloud,
    /// They are registered to each other.
    Motion,
    /// Points take their colours from the images.
    Paint,
    /// Distances between points.
    Spacing,
    /// Gaussians that are denser than the pixels become one.
    Merge,
    /// What stands behind the returns.
    Background,
    /// The network's features, residuals and velocities.
    Backbone,
    /// The exchange of features between timestamps.
    Query,
    /// The scores for pruning and adding.
    Policy,
    /// Pruning and adding.
    SetUpdate,
    /// The refinement as a whole.
    Refine,
    /// Its drawing, and the gradient of that.
    RefineRender,
    /// Its loss.
    RefineLoss,
    /// Its network.
    RefineNetwork,
    /// The finished scene's views are drawn.
    Render,
    /// Figures of the drawn views.
    Evaluate,
    /// All of it.
    Total,
}

impl Part {
    /// Every part, in the order of the work.
    pub const ALL: [Self; 18] = [
        Self::Load,
        Self::Cloud,
        Self::Motion,
        Self::Paint,
        Self::Spacing,
        Self::Merge,
        Self::Background,
        Self::Backbone,
        Self::Query,
        Self::Policy,
        Self::SetUpdate,
        Self::Refine,
        Self::RefineRender,
        Self::RefineLoss,
        Self::RefineNetwork,
        Self::Render,
        Self::Evaluate,
        Self::Total,
    ];

    /// Its name in files.
    pub const fn key(self) -> &'static str {
        match self {
            Self::Load => "load",
            Self::Cloud => "cloud",
            Self::Motion => "motion",
            Self::Paint => "paint",
            Self::Spacing => "spacing",
            Self::Merge => "merge",
            Self::Background => "background",
            Self::Backbone => "backbone",
            Self::Query => "query",
            Self::Policy => "policy",
            Self::SetUpdate => "set_update",
            Self::Refine => "refine",
            Self::RefineRender => "refine_render",
            Self::RefineLoss => "refine_loss",
            Self::RefineNetwork => "refine_network",
            Self::Render => "render",
            Self::Evaluate => "evaluate",
            Self::Total => "total",
        }
    }

    /// The part that a stage is, where it is one as a whole.
    pub const fn of(stage: Stage) -> Option<Self> {
        match stage {
            Stage::Load => Some(Self::Load),
            Stage::Points => None,
            Stage::Background => Some(Self::Background),
            Stage::Backbone => Some(Self::Backbone),
            Stage::Query => Some(Self::Query),
            Stage::Policy => Some(Self::Policy),
            Stage::SetUpdate => Some(Self::SetUpdate),
            Stage::Refine => Some(Self::Refine),
            Stage::Render => Some(Self::Render),
            Stage::Evaluate => Some(Self::Evaluate),
        }
    }

    /// The part that a step of [`Stage::Points`] is.
    pub const fn of_step(step: PointStep) -> Self {
        match step {
            PointStep::Cloud => Self::Cloud,
            PointStep::Motion => Self::Motion,
            PointStep::Colours => Self::Paint,
            PointStep::Spacing => Self::Spacing,
            PointStep::Merging => Self::Merge,
        }
    }

    /// What its work is made of, along an axis.
    pub const fn units(self, axis: Axis) -> &'static [&'static str] {
        match self {
            Self::Load => &["pixels", "returns × cameras"],
            Self::Cloud | Self::Motion | Self::Spacing => &["returns"],
            Self::Paint | Self::Merge => &["returns × views"],
            Self::Background => &["pixels", "Gaussians × views"],
            Self::Backbone => &["LiDAR Gaussians", "background Gaussians", "pairs of sites"],
            Self::Query => &["LiDAR Gaussians"],
            Self::Policy => &["LiDAR Gaussians", "sites"],
            Self::SetUpdate => &["LiDAR Gaussians", "background Gaussians"],
            Self::Refine => &["LiDAR Gaussians", "background Gaussians", "intersections of a view"],
            Self::RefineRender => &["Gaussians × views × drawings", "intersections × drawings"],
            Self::RefineLoss => &["pixels × drawings"],
            Self::RefineNetwork => {
                &["LiDAR Gaussians × steps", "background Gaussians × steps", "pairs of sites × steps"]
            }
            Self::Render => &["Gaussians × views", "intersections", "pixels"],
            Self::Evaluate => &["pixels"],
            Self::Total => match axis {
                Axis::Points => &["returns"],
                Axis::Pixels => &["pixels"],
            },
        }
    }

    /// How much there is of each of [`Part::units`]; 0 behind the last.
    pub fn work(self, work: &Work, axis: Axis) -> [usize; KINDS] {
        let pairs = work.pairs + work.background_pairs;
        let drawn = work.gaussians() * work.views;
        match self {
            Self::Load => [work.pixels, over(work.returns * work.views, work.frames), 0],
            Self::Cloud | Self::Motion | Self::Spacing => [work.returns, 0, 0],
            Self::Paint | Self::Merge => [work.returns * work.views, 0, 0],
            Self::Background => [work.pixels, drawn, 0],
            Self::Backbone => [work.lidar, work.background, pairs],
            Self::Query => [work.lidar, 0, 0],
            Self::Policy => [work.lidar, work.sites, 0],
            Self::SetUpdate => [work.lidar, work.background, 0],
            Self::Refine => [work.lidar, work.background, over(work.intersections, work.views)],
            Self::RefineRender => [drawn * work.drawings, work.intersections * work.drawings, 0],
            Self::RefineLoss => [work.pixels * work.drawings, 0, 0],
            Self::RefineNetwork => [work.lidar * work.steps, work.background * work.steps, pairs * work.steps],
            Self::Render => [drawn, work.intersections, work.pixels],
            Self::Evaluate => [work.pixels, 0, 0],
            Self::Total => match axis {
                Axis::Points => [work.returns, 0, 0],
                Axis::Pixels => [work.pixels, 0, 0],
            },
        }
    }
}

/// The quotient; 0 over nothing.
fn over(count: usize, by: usize) -> usize {
    count.checked_div(by).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_in_order_and_named_as_they_are_written() {
        assert!(Part::ALL.is_sorted());
        for part in Part::ALL {
            assert_eq!(serde_json::to_string(&part).unwrap(), format!("\"{}\"", part.key()));
        }
    }
}
