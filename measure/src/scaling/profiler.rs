//! What each part of a run takes beyond what the pipeline's own watch measures: the steps of its first stage, and memory.

use std::{
    collections::BTreeMap,
    sync::{Mutex, MutexGuard, PoisonError},
    time::Instant,
};

use lgs_engine::{
    allocator,
    pipeline::{PointStep, Progress, Stage},
};

use super::part::Part;

/// What is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wanted {
    /// Seconds.
    Time,
    /// Memory too, which costs a little time.
    Memory,
}

/// Is told of the stages of a run and notes what they take.
#[derive(Debug)]
pub struct StageProfiler {
    wanted: Wanted,
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    began: Instant,
    /// Resident memory at that moment, 10^6 bytes; `None` where it is not known.
    resident_mb: Option<f64>,
    found: StageCosts,
}

/// What parts took.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StageCosts {
    /// Seconds of the steps of [`Stage::Points`].
    pub seconds: BTreeMap<Part, f64>,
    /// Of each part, how far resident memory rose above what it was when the part began, 10^6 bytes.
    pub memory_mb: BTreeMap<Part, f64>,
}

impl StageProfiler {
    /// One that has noted nothing yet.
    pub fn new(wanted: Wanted) -> Self {
        let state = State { began: Instant::now(), resident_mb: None, found: StageCosts::default() };
        Self { wanted, state: Mutex::new(state) }
    }

    /// What was noted.
    pub fn found(self) -> StageCosts {
        self.state.into_inner().unwrap_or_else(PoisonError::into_inner).found
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn restart(&self, state: &mut State) {
        if self.wanted == Wanted::Memory {
            allocator::trim();
            state.resident_mb = allocator::reset_peak_rss().then(allocator::peak_rss_mb).flatten();
        }
        state.began = Instant::now();
    }

    fn close(state: &mut State, part: Part) {
        if let Some(risen) = state.resident_mb.zip(allocator::peak_rss_mb()).map(|(before, peak)| peak - before) {
            let most = state.found.memory_mb.entry(part).or_default();
            *most = most.max(risen);
        }
    }
}

impl Progress for StageProfiler {
    fn begin(&self, stage: Stage, _: usize) {
        // Figures are made while views are drawn: what both need counts for the drawing.
        if stage != Stage::Evaluate {
            self.restart(&mut self.state());
        }
    }

    fn step(&self, _: Stage) {}

    fn point_step(&self, step: PointStep) {
        let (mut state, part) = (self.state(), Part::of_step(step));
        let seconds = state.began.elapsed().as_secs_f64();
        state.found.seconds.insert(part, seconds);
        Self::close(&mut state, part);
        self.restart(&mut state);
    }

    fn end(&self, stage: Stage) {
        if let Some(part) = Part::of(stage).filter(|part| *part != Part::Evaluate) {
            Self::close(&mut self.state(), part);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_of_the_first_stage_are_parts_and_memory_is_what_was_needed_in_between() {
        let profiler = StageProfiler::new(Wanted::Memory);
        profiler.begin(Stage::Points, PointStep::ALL.len());
        for (number, step) in (0_u64..).zip(PointStep::ALL) {
            std::thread::sleep(std::time::Duration::from_millis(2 * number));
            profiler.point_step(step);
        }
        profiler.end(Stage::Points);
        profiler.begin(Stage::Query, 1);
        let touched = std::hint::black_box(vec![1_u8; 100_000_000]);
        profiler.end(Stage::Query);
        let found = profiler.found();
        assert_eq!(found.seconds.keys().copied().collect::<Vec<_>>(), PointStep::ALL.map(Part::of_step));
        assert!(found.seconds[&Part::Spacing] >= 0.006 && touched.len() == 100_000_000);
        if cfg!(target_os = "linux") {
            assert!((90.0..200.0).contains(&found.memory_mb[&Part::Query]), "{found:?}");
            assert!(found.memory_mb[&Part::Cloud] < 50.0, "{found:?}");
        }
    }
}
