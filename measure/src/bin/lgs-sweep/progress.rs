//! How far the work is, on standard error: a bar on a terminal, now and then a line elsewhere.

use std::{
    cell::{Cell, RefCell},
    time::{Duration, Instant},
};

use lgs_cli::progress::Bar;
use lgs_measure::sweep::job::Observer;

/// Between two lines where there is no terminal.
const PAUSE: Duration = Duration::from_secs(20);

/// Tells people.
#[derive(Debug)]
pub(crate) struct Teller {
    bar: Bar,
    clip: RefCell<String>,
    told: Cell<Instant>,
    /// Weight of what was done by this process.
    own: Cell<u64>,
}

impl Teller {
    pub(crate) fn new(total: u64) -> Self {
        let bar = Bar::new("sweep", total);
        Self { bar, clip: RefCell::default(), told: Cell::new(Instant::now()), own: Cell::new(0) }
    }

    /// Seconds that are left if what is left is like what was done.
    fn left(&self) -> Option<f64> {
        let [done, total] = self.bar.position();
        let own = self.own.get();
        (own > 0).then(|| self.bar.elapsed().as_secs_f64() / own as f64 * total.saturating_sub(done) as f64)
    }
}

impl Observer for Teller {
    fn begin(&self, clip: &str) {
        self.clip.replace(clip.to_owned());
    }

    fn did(&self, weight: u64, done_now: bool) {
        self.bar.inc(weight);
        if !done_now {
            return;
        }
        self.own.set(self.own.get() + weight);
        let left = self.left().map_or(String::new(), |seconds| format!(", {seconds:.0} s left"));
        let message = format!("{}{left}", self.clip.borrow());
        if self.bar.is_hidden() && self.told.get().elapsed() > PAUSE {
            self.told.set(Instant::now());
            let [done, total] = self.bar.position();
            self.bar.line(&format!("{} % {message}", 100 * done / total.max(1)));
        }
        self.bar.message(message);
    }

    fn note(&self, line: &str) {
        self.bar.line(line);
    }
}
