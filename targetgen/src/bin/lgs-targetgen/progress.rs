//! How far a job is: a bar where somebody watches a terminal, else a line per clip.

use lgs_cli::progress::Bar;
use lgs_targetgen::job::Event;

/// Tells standard error.
#[derive(Debug)]
pub(crate) struct Teller {
    bar: Bar,
}

impl Teller {
    /// A teller that has told nothing yet.
    pub(crate) fn new() -> Self {
        Self { bar: Bar::new("targets", 0) }
    }

    /// Tells of an event.
    pub(crate) fn tell(&mut self, event: Event<'_>) {
        match event {
            Event::Start { todo, done } => {
                self.bar.set_len(todo as u64);
                self.say(&format!("{todo} clips to do, {done} done before"));
            }
            Event::Done { clip, primitives, .. } => self.step(clip, &format!("{primitives} primitives")),
            Event::Failed(failed) => self.step(&failed.item, &format!("failed: {}", failed.reason)),
            Event::Packing => self.say("packing"),
        }
    }

    fn step(&self, clip: &str, what: &str) {
        self.bar.inc(1);
        self.bar.message(clip.to_owned());
        let [tried, todo] = self.bar.position();
        let passed = self.bar.elapsed().as_secs_f64();
        let left = passed / tried.max(1) as f64 * todo.saturating_sub(tried) as f64;
        self.say(&format!("{tried}/{todo} {clip}: {what}; {passed:.0} s passed, about {left:.0} s left"));
    }

    /// Prints a line where there is no bar.
    fn say(&self, line: &str) {
        if self.bar.is_hidden() {
            self.bar.line(line);
        }
    }
}
