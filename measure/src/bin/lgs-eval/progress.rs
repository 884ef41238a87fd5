//! How far a job is: a bar where somebody watches a terminal, else a line per snippet.

use lgs_cli::progress::Bar;
use lgs_formats::jobs::ItemEvent;

/// Tells standard error.
#[derive(Debug)]
pub(crate) struct Teller {
    bar: Bar,
}

impl Teller {
    /// A teller that has told nothing yet.
    pub(crate) fn new() -> Self {
        Self { bar: Bar::new("snippets", 0) }
    }

    /// Tells of an event.
    pub(crate) fn tell(&mut self, event: ItemEvent<'_>) {
        match event {
            ItemEvent::Start { todo, done } => {
                self.bar.set_len(todo as u64);
                self.say(&format!("{todo} snippets to do, {done} done before"));
            }
            ItemEvent::Done(item) => self.step(item, "done"),
            ItemEvent::Failed(failed) => self.step(&failed.item, &format!("failed: {}", failed.reason)),
        }
    }

    fn step(&self, item: &str, what: &str) {
        self.bar.inc(1);
        self.bar.message(item.to_owned());
        let [tried, todo] = self.bar.position();
        let passed = self.bar.elapsed().as_secs_f64();
        let left = passed / tried.max(1) as f64 * todo.saturating_sub(tried) as f64;
        self.say(&format!("{tried}/{todo} {item}: {what}; {passed:.0} s passed, about {left:.0} s left"));
    }

    /// Prints a line where there is no bar.
    fn say(&self, line: &str) {
        if self.bar.is_hidden() {
            self.bar.line(line);
        }
    }
}
