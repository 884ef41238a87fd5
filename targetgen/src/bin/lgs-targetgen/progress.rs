//! How far a job is: a bar with the time that is left where somebody watches a terminal, else a line per clip.

use std::io::{self, IsTerminal, Write};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use lgs_targetgen::job::Event;

const TEMPLATE: &str = "{msg:>24} [{bar:32}] {pos}/{len} {elapsed} passed, {eta} left";

/// Tells standard error.
#[derive(Debug)]
pub(crate) struct Teller {
    bar: Option<ProgressBar>,
    start: Instant,
    todo: usize,
    tried: usize,
}

impl Teller {
    /// A teller that has told nothing yet.
    pub(crate) fn new() -> Self {
        let bar = io::stderr().is_terminal().then(|| ProgressBar::new(0));
        if let Some(bar) = &bar {
            bar.set_style(ProgressStyle::with_template(TEMPLATE).unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar.enable_steady_tick(Duration::from_millis(200));
        }
        Self { bar, start: Instant::now(), todo: 0, tried: 0 }
    }

    /// Tells of an event.
    pub(crate) fn tell(&mut self, event: Event<'_>) {
        match event {
            Event::Start { todo, done } => {
                self.todo = todo;
                match &self.bar {
                    Some(bar) => bar.set_length(todo as u64),
                    None => say(&format!("{todo} clips to do, {done} done before")),
                }
            }
            Event::Done { clip, primitives, .. } => self.step(clip, &format!("{primitives} primitives")),
            Event::Failed(failed) => self.step(&failed.clip, &format!("failed: {}", failed.reason)),
            Event::Packing => match &self.bar {
                Some(bar) => bar.finish_and_clear(),
                None => say("packing"),
            },
        }
    }

    fn step(&mut self, clip: &str, what: &str) {
        self.tried += 1;
        match &self.bar {
            Some(bar) => {
                bar.set_message(clip.to_owned());
                bar.inc(1);
            }
            None => {
                let passed = self.start.elapsed().as_secs_f64();
                let left = passed / self.tried as f64 * (self.todo - self.tried.min(self.todo)) as f64;
                say(&format!(
                    "{}/{} {clip}: {what}; {passed:.0} s passed, about {left:.0} s left",
                    self.tried, self.todo
                ));
            }
        }
    }
}

/// A line on standard error; nobody there is no reason to stop.
fn say(line: &str) {
    let _ = writeln!(io::stderr(), "{line}");
}
