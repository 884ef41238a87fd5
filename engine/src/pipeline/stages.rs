//! The stages of a run, what each of them took, and who is told while they run.

use std::time::Instant;

use crate::refine::RefineSeconds;

/// A stage of a run, in the order of the work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Images are read, undistorted, resized.
    Load,
    /// Sweeps become initial Gaussians with colours.
    Points,
    /// Gaussians behind them.
    Background,
    /// The network's features.
    Backbone,
    /// The exchange of features between timestamps.
    Query,
    /// The scores for pruning and adding.
    Policy,
    /// Pruning and adding.
    SetUpdate,
    /// The learned refinement.
    Refine,
    /// Views are drawn.
    Render,
    /// Figures of the drawn views.
    Evaluate,
}

impl Stage {
    /// Every stage, in the order of the work.
    pub const ALL: [Self; 10] = [
        Self::Load,
        Self::Points,
        Self::Background,
        Self::Backbone,
        Self::Query,
        Self::Policy,
        Self::SetUpdate,
        Self::Refine,
        Self::Render,
        Self::Evaluate,
    ];

    /// The stage's name in `metrics.json`.
    pub const fn key(self) -> &'static str {
        match self {
            Self::Load => "load",
            Self::Points => "points",
            Self::Background => "background",
            Self::Backbone => "backbone",
            Self::Query => "query",
            Self::Policy => "policy",
            Self::SetUpdate => "set_update",
            Self::Refine => "refine",
            Self::Render => "render",
            Self::Evaluate => "evaluate",
        }
    }
}

/// A step of [`Stage::Points`], in the order of the work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointStep {
    /// Sweeps meet in one frame; returns that are no surface are left out.
    Cloud,
    /// Sweeps are registered to each other: initial velocities.
    Motion,
    /// Points take their colours from the images.
    Colours,
    /// Distances between points; each becomes a Gaussian.
    Spacing,
    /// Gaussians that are denser than the pixels become one.
    Merging,
}

impl PointStep {
    /// Every step, in the order of the work.
    pub const ALL: [Self; 5] = [Self::Cloud, Self::Motion, Self::Colours, Self::Spacing, Self::Merging];
}

/// Seconds that each stage took; 0 for a stage that did not run. In JSON `null` for what is not known.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StageTimes {
    stages: [f64; Stage::ALL.len()],
    /// Parts of [`Stage::Refine`]; `None`, and no keys, without a network.
    pub refine: Option<RefineSeconds>,
}

impl StageTimes {
    /// Seconds of one stage.
    pub const fn get(&self, stage: Stage) -> f64 {
        self.stages[stage as usize]
    }

    /// Counts the parts of a refinement, beside those of one before it.
    pub(crate) fn add_refine(&mut self, seconds: RefineSeconds) {
        let before = self.refine.unwrap_or_default();
        self.refine = Some(RefineSeconds {
            render: before.render + seconds.render,
            loss: before.loss + seconds.loss,
            loss_in_render: before.loss_in_render || seconds.loss_in_render,
            network: before.network + seconds.network,
            lengths: before.lengths + seconds.lengths,
        });
    }
}

impl serde::Serialize for StageTimes {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let stages = Stage::ALL.map(|stage| (stage.key(), Some(self.get(stage))));
        let parts = self.refine.map(|parts| {
            [
                ("refine_render", Some(parts.drawing())),
                ("refine_loss", parts.loss_alone()),
                ("refine_network", Some(parts.network)),
            ]
        });
        serializer.collect_map(stages.into_iter().chain(parts.into_iter().flatten()))
    }
}

/// Somebody who is told how far the stages are. A stage may begin more than once.
pub trait Progress: Sync {
    /// A stage begins that will take so many steps.
    fn begin(&self, stage: Stage, steps: usize);
    /// One step of a stage is done.
    fn step(&self, stage: Stage);
    /// A step of [`Stage::Points`] is done.
    fn point_step(&self, _: PointStep) {
        self.step(Stage::Points);
    }
    /// A stage is done.
    fn end(&self, stage: Stage);
}

/// Nobody is told.
#[derive(Clone, Copy, Debug)]
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _: Stage, _: usize) {}
    fn step(&self, _: Stage) {}
    fn end(&self, _: Stage) {}
}

/// Measures stages and passes on how far they are.
pub struct Watch<'a> {
    /// What was measured so far.
    pub times: StageTimes,
    /// Who is told.
    pub progress: &'a dyn Progress,
}

impl<'a> Watch<'a> {
    /// A watch that has measured nothing yet.
    pub fn new(progress: &'a dyn Progress) -> Self {
        Self { times: StageTimes::default(), progress }
    }

    /// The value of `work`, whose time is added to the stage's.
    pub fn time<T>(&mut self, stage: Stage, work: impl FnOnce(&'a dyn Progress) -> T) -> T {
        let start = Instant::now();
        let value = work(self.progress);
        self.times.stages[stage as usize] += start.elapsed().as_secs_f64();
        value
    }

    /// As [`Watch::time`], for a stage that runs as a whole: begun with its number of steps, and ended.
    pub fn stage<T>(&mut self, stage: Stage, steps: usize, work: impl FnOnce(&'a dyn Progress) -> T) -> T {
        self.progress.begin(stage, steps);
        let value = self.time(stage, work);
        self.progress.end(stage);
        value
    }
}

impl std::fmt::Debug for Watch<'_> {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Watch").field("times", &self.times).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::{Silent, Stage, Watch};
    use crate::refine::RefineSeconds;

    #[test]
    fn times_add_up_and_are_written_in_the_order_of_the_work() {
        let mut watch = Watch::new(&Silent);
        let value = watch.stage(Stage::Points, 1, |_| std::hint::black_box(7));
        let first = watch.times.get(Stage::Points);
        watch.time(Stage::Points, |_| std::thread::sleep(std::time::Duration::from_millis(5)));
        assert_eq!(value, 7);
        assert!(watch.times.get(Stage::Points) >= first + 0.005);
        assert_eq!(watch.times.get(Stage::Refine), 0.0);
        let json = serde_json::to_string(&watch.times).unwrap();
        let keys: Vec<usize> = Stage::ALL.map(|s| json.find(&format!("\"{}\":", s.key())).unwrap()).to_vec();
        assert!(keys.is_sorted(), "{json}");
    }

    #[test]
    fn a_loss_that_a_gpu_took_is_not_known() {
        let mut watch = Watch::new(&Silent);
        let seconds =
            |loss, loss_in_render| RefineSeconds { render: 1.0, loss, loss_in_render, ..RefineSeconds::default() };
        watch.times.add_refine(seconds(0.5, false));
        assert_eq!(serde_json::to_value(watch.times).unwrap()["refine_loss"], 0.5);
        watch.times.add_refine(seconds(0.0, true));
        let json = serde_json::to_value(watch.times).unwrap();
        assert!(json["refine_loss"].is_null() && json["refine_render"] == 2.0, "{json}");
    }
    #[test]
    fn drawing_for_the_lengths_of_steps_is_drawing() {
        let mut watch = Watch::new(&Silent);
        watch.times.add_refine(RefineSeconds { render: 1.0, lengths: 0.5, ..RefineSeconds::default() });
        assert_eq!(serde_json::to_value(watch.times).unwrap()["refine_render"], 1.5);
        assert_eq!(watch.times.refine.unwrap().drawing(), 1.5);
    }
}
