//! Progress of the stages of a run.

use lgs_cli::progress::Bars;
use lgs_engine::pipeline::{Progress, Stage};

/// The bars of the stages that began.
#[derive(Debug, Default)]
pub(crate) struct StageBars(Bars<Stage>);

impl Progress for StageBars {
    fn begin(&self, stage: Stage, steps: usize) {
        self.0.begin(stage, stage.key().replace('_', " "), steps);
    }

    fn step(&self, stage: Stage) {
        self.0.step(&stage);
    }

    fn end(&self, stage: Stage) {
        self.0.end(&stage);
    }
}
