//! How far the work is, on standard error: a bar on a terminal, now and then a line elsewhere.

use std::{
    cell::{Cell, RefCell},
    io::Write,
    time::{Duration, Instant},
};

use anyhow::Result;
use indicatif::{ProgressBar, ProgressStyle};
use lgs_sweep::job::Observer;

/// Between two lines where there is no terminal.
const PAUSE: Duration = Duration::from_secs(20);

/// Tells people.
#[derive(Debug)]
pub(crate) struct Teller {
    bar: ProgressBar,
    clip: RefCell<String>,
    started: Instant,
    told: Cell<Instant>,
    /// Weight of what was done by this process.
    own: Cell<u64>,
}

impl Teller {
    pub(crate) fn new(total: u64) -> Result<Self> {
        let bar = ProgressBar::new(total);
        bar.set_style(ProgressStyle::with_template("sweep {wide_bar} {percent} % {msg}")?);
        let now = Instant::now();
        Ok(Self { bar, clip: RefCell::default(), started: now, told: Cell::new(now), own: Cell::new(0) })
    }

    /// Seconds that are left if what is left is like what was done.
    fn left(&self) -> Option<f64> {
        let rest = self.bar.length()?.saturating_sub(self.bar.position());
        let own = self.own.get();
        (own > 0).then(|| self.started.elapsed().as_secs_f64() / own as f64 * rest as f64)
    }

    fn line(&self, line: &str) {
        if self.bar.is_hidden() {
            // Nobody reads what cannot be written.
            let _ = writeln!(std::io::stderr(), "{line}");
        } else {
            self.bar.println(line);
        }
    }
}

impl Drop for Teller {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
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
            let percent = 100 * self.bar.position() / self.bar.length().unwrap_or(1).max(1);
            self.line(&format!("{percent} % {message}"));
        }
        self.bar.set_message(message);
    }

    fn note(&self, line: &str) {
        self.line(line);
    }
}
