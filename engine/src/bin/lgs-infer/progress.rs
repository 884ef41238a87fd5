//! Progress bars on standard error: one per running stage; none when nobody watches a terminal.

use std::{sync::Mutex, time::Duration};

use indicatif::{MultiProgress, ProgressBar, ProgressStyle};
use lgs_engine::pipeline::{Progress, Stage};

const TEMPLATE: &str = "{prefix:>10} [{bar:32}] {pos}/{len} {elapsed}";
const TICK: Duration = Duration::from_millis(100);

/// The bars of the stages that began.
#[derive(Debug)]
pub(crate) struct Bars {
    all: MultiProgress,
    running: Mutex<Vec<(Stage, ProgressBar)>>,
}

impl Bars {
    /// No bars yet. They are drawn on standard error where that is a terminal, and nowhere else.
    pub(crate) fn new() -> Self {
        Self { all: MultiProgress::new(), running: Mutex::new(Vec::new()) }
    }

    /// The bar of a stage, while the stage runs.
    fn of(&self, stage: Stage) -> Option<ProgressBar> {
        let running = self.running.lock().ok()?;
        running.iter().find(|(of, _)| *of == stage).map(|(_, bar)| bar.clone())
    }
}

impl Drop for Bars {
    /// Leaves the terminal as it was, also when a stage failed.
    fn drop(&mut self) {
        // a terminal that cannot be written to any more needs no clearing
        let _ = self.all.clear();
    }
}

impl Progress for Bars {
    fn begin(&self, stage: Stage, steps: usize) {
        let bar = self.all.add(ProgressBar::new(steps as u64));
        bar.set_style(ProgressStyle::with_template(TEMPLATE).unwrap_or_else(|_| ProgressStyle::default_bar()));
        bar.set_prefix(stage.key().replace('_', " "));
        bar.enable_steady_tick(TICK);
        if let Ok(mut running) = self.running.lock() {
            running.push((stage, bar));
        }
    }

    fn step(&self, stage: Stage) {
        if let Some(bar) = self.of(stage) {
            bar.inc(1);
        }
    }

    fn end(&self, stage: Stage) {
        if let Some(bar) = self.of(stage) {
            bar.finish_and_clear();
        }
        if let Ok(mut running) = self.running.lock() {
            running.retain(|(of, _)| *of != stage);
        }
    }
}
