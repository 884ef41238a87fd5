//! Per-scene optimisation of a scene over the input views: what `adam:N` of a recipe does.

use std::{
    borrow::Cow,
    time::{Duration, Instant},
};

use super::{Deadline, Inputs, Marks, MemorySettings, Reconstruction, Run, Stage, Watch, check_refinement};
use crate::{
    error::Result,
    refine::{
        RefineSummary,
        adam::{Adam, AdamRates, AdamSettings},
    },
    render::{MemoryEstimate, Pass},
    views::{View, at_factor},
};

impl Reconstruction {
    /// Optimises the scene over the input views, in place: as many steps, with such views, as the recipe of `run` says, or those that its
    /// deadline leaves time for. `rates`: the lengths of the steps; `marks`: after how many of them the scene is shown, and to whom.
    ///
    /// # Errors
    /// More Gaussians than there is memory to optimise or to draw them.
    pub fn optimise(
        &mut self,
        inputs: &Inputs,
        run: &Run<'_>,
        rates: AdamRates,
        watch: &mut Watch<'_>,
        marks: Marks<'_>,
    ) -> Result<()> {
        let (steps, reduce) = (run.adam_steps(), run.recipe.refine_reduce);
        check_refinement([self.scene.num_lidar, self.scene.num_background()], None, MemorySettings::default())?;
        let (start, mut waited) = (Instant::now(), Duration::ZERO);
        // A step draws the views once, as the learned refinement has.
        let refined = self.network.as_ref().and_then(|network| RefineSummary::drawing_s(&network.refine));
        let mut step_s = refined.or(run.deadline.map(|deadline| deadline.adam_step_s)).unwrap_or(0.0);
        let settings = AdamSettings {
            rates,
            schedule: run.recipe.view_schedule(run.seed),
            warm_start: self.network.as_ref().is_some_and(|network| network.refine.steps > 0),
            device: run.recipe.device(),
        };
        let mut adam = self.begin_adam(settings, reduce, inputs.views().len());
        let (before, refine_before) = (self.seconds, watch.times.refine);
        watch.progress.begin(Stage::Refine, steps);
        let full: Vec<&View> = inputs.views().iter().collect();
        let reduced = watch.time(Stage::Refine, |_| at_factor(&full, reduce));
        let views: Vec<&View> = reduced.iter().map(Cow::as_ref).collect();
        for step in 1..=steps {
            let (begun, draws) = (Instant::now(), adam.draws());
            if draws {
                let late = |deadline: Deadline| begun + Duration::from_secs_f64(step_s) > deadline.until;
                if run.deadline.is_some_and(late) {
                    break;
                }
                let pinholes = views.iter().map(|view| &view.pinhole);
                watch.time(Stage::Refine, |_| MemoryEstimate::of_set(&self.scene).check(pinholes, Pass::Gradient))?;
            }
            watch.time(Stage::Refine, |progress| {
                adam.step_ahead(&mut self.scene, &views);
                if marks.steps.contains(&step) {
                    adam.settle(&mut self.scene, &views);
                }
                progress.step(Stage::Refine);
            });
            if draws {
                step_s = begun.elapsed().as_secs_f64();
            }
            let asked = Instant::now();
            watch.times.refine = refine_before;
            watch.times.add_refine(adam.summary().seconds);
            self.seconds = before + (asked - start - waited).as_secs_f64();
            if marks.steps.contains(&step) {
                (marks.done)(self, &watch.times);
            }
            waited += asked.elapsed();
        }
        watch.time(Stage::Refine, |_| adam.settle(&mut self.scene, &views));
        watch.progress.end(Stage::Refine);
        let summary = adam.into_summary();
        self.optimisation = (!summary.losses.is_empty()).then_some(summary);
        self.seconds = before + (start.elapsed() - waited).as_secs_f64();
        Ok(())
    }

    /// An optimisation that has not begun. What learned steps measured of the scene last is its first step's, if that looks at the same.
    fn begin_adam<'v>(&mut self, settings: AdamSettings, reduce: usize, num_views: usize) -> Adam<'v> {
        let mut adam = Adam::new(self.scene.len(), settings);
        let measured = self.measured.take();
        adam.begin_with(measured.filter(|measured| measured.reduce == reduce && settings.schedule.take_all(num_views)));
        adam
    }
}
