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
        let (steps, reduce) = (run.adam_passes(), run.recipe.refine_reduce);
        check_refinement([self.scene.num_lidar, self.scene.num_background()], None, MemorySettings::default())?;
        let (start, mut waited) = (Instant::now(), Duration::ZERO);
        // A step draws the views once, as the learned refinement has.
        let refined = self.network.as_ref().and_then(|network| RefineSummary::drawing_s(&network.refine));
        let mut pass_s = refined.or(run.deadline.map(|deadline| deadline.adam_pass_s)).unwrap_or(0.0);
        let settings = AdamSettings {
            rates,
            schedule: run.recipe.adam_schedule(run.seed),
            warm_start: self.network.as_ref().is_some_and(|network| network.refine.steps > 0),
            device: run.recipe.device(),
        };
        let mut adam = Adam::new(self.scene.len(), settings);
        let (before, refine_before) = (self.seconds, watch.times.refine);
        watch.progress.begin(Stage::Refine, steps);
        let full: Vec<&View> = inputs.views().iter().collect();
        let reduced = watch.time(Stage::Refine, |_| at_factor(&full, reduce));
        let views: Vec<&View> = reduced.iter().map(Cow::as_ref).collect();
        for step in 1..=steps {
            let begun = Instant::now();
            let late = |deadline: Deadline| begun + Duration::from_secs_f64(pass_s) > deadline.until;
            if run.deadline.is_some_and(late) {
                break;
            }
            let pinholes = views.iter().map(|view| &view.pinhole);
            watch.time(Stage::Refine, |_| MemoryEstimate::of_set(&self.scene).check(pinholes, Pass::Gradient))?;
            watch.time(Stage::Refine, |progress| {
                adam.pass_ahead(&mut self.scene, &views);
                if marks.steps.contains(&step) {
                    adam.settle(&mut self.scene, &views);
                }
                progress.step(Stage::Refine);
            });
            pass_s = begun.elapsed().as_secs_f64();
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
}
