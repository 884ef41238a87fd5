//! Progress on standard error: bars where somebody watches a terminal, lines elsewhere.

use std::{
    io::Write,
    sync::Mutex,
    time::{Duration, Instant},
};

use indicatif::{MultiProgress, ProgressBar, ProgressStyle};

const BAR: &str = "{prefix} {wide_bar} {pos}/{len} {elapsed} passed, {eta} left {msg}";
const STAGE: &str = "{prefix:>10} [{bar:32}] {pos}/{len} {elapsed}";
const TICK: Duration = Duration::from_millis(100);

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar())
}

/// The bar of some work, taken off the terminal when it goes out of scope.
#[derive(Debug)]
pub struct Bar {
    bar: ProgressBar,
    started: Instant,
}

impl Bar {
    /// A bar of so many steps, drawn where standard error is a terminal.
    pub fn new(what: &str, steps: u64) -> Self {
        let bar = ProgressBar::new(steps).with_style(style(BAR));
        bar.set_prefix(what.to_owned());
        Self { bar, started: Instant::now() }
    }

    /// Whether nobody sees it: lines say then how far the work is.
    pub fn is_hidden(&self) -> bool {
        self.bar.is_hidden()
    }

    /// Sets the number of steps.
    pub fn set_len(&self, steps: u64) {
        self.bar.set_length(steps);
    }

    /// Sets the number of steps that are done.
    pub fn set_position(&self, done: u64) {
        self.bar.set_position(done);
    }

    /// Adds to the number of steps that are done.
    pub fn inc(&self, steps: u64) {
        self.bar.inc(steps);
    }

    /// Steps that are done, and all of them.
    pub fn position(&self) -> [u64; 2] {
        [self.bar.position(), self.bar.length().unwrap_or(0)]
    }

    /// Since the bar was made.
    pub fn elapsed(&self) -> Duration {
        self.started.elapsed()
    }

    /// Until the end, if what is left is like what was done.
    pub fn eta(&self) -> Duration {
        self.bar.eta()
    }

    /// What stands behind the bar.
    pub fn message(&self, text: String) {
        self.bar.set_message(text);
    }

    /// Prints a line that stays, also where there is no bar.
    pub fn line(&self, text: &str) {
        if self.bar.is_hidden() {
            // Nobody reads what cannot be written.
            let _ = writeln!(std::io::stderr(), "{text}");
        } else {
            self.bar.println(text);
        }
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// Bars of stages that run at the same time or one after another; none when nobody watches a terminal.
#[derive(Debug)]
pub struct Bars<K> {
    all: MultiProgress,
    running: Mutex<Vec<(K, ProgressBar)>>,
}

impl<K: PartialEq> Default for Bars<K> {
    /// No bars.
    fn default() -> Self {
        Self { all: MultiProgress::new(), running: Mutex::new(Vec::new()) }
    }
}

impl<K: PartialEq> Bars<K> {
    /// Draws the bar of a stage that begins.
    pub fn begin(&self, stage: K, name: String, steps: usize) {
        let bar = self.all.add(ProgressBar::new(steps as u64));
        bar.set_style(style(STAGE));
        bar.set_prefix(name);
        bar.enable_steady_tick(TICK);
        if let Ok(mut running) = self.running.lock() {
            running.push((stage, bar));
        }
    }

    /// Moves the bar of a running stage by a step.
    pub fn step(&self, stage: &K) {
        if let Some(bar) = self.find(stage) {
            bar.inc(1);
        }
    }

    /// Takes the bar of a stage away.
    pub fn end(&self, stage: &K) {
        if let Some(bar) = self.find(stage) {
            bar.finish_and_clear();
        }
        if let Ok(mut running) = self.running.lock() {
            running.retain(|(other, _)| other != stage);
        }
    }

    fn find(&self, stage: &K) -> Option<ProgressBar> {
        let running = self.running.lock().ok()?;
        running.iter().find(|(other, _)| other == stage).map(|(_, bar)| bar.clone())
    }
}

impl<K> Drop for Bars<K> {
    /// Leaves the terminal as it was, also when a stage failed.
    fn drop(&mut self) {
        // A terminal that cannot be written to any more needs no clearing.
        let _ = self.all.clear();
    }
}
