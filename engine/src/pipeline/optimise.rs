//! Per-scene optimisation of a scene over the input views: what `adam:N` of a recipe does.

use std::{
    borrow::Cow,
    time::{Duration, Instant},
};

use super::{Inputs, Marks, MemorySettings, Reconstruction, Run, Stage, Watch, check_refinement};
use crate::{
    error::Result,
    refine::{
        RefineSummary,
        adam::{Adam, AdamRates, AdamSettings, AdamSummary},
    },
    render::{MemoryEstimate, Pass},
    views::{View, strided},
};

/// Every so many passes one looks at all pixels, whatever the stride.
const ALL_EVERY: usize = 4;

/// Seconds of a pass over some of the pixels, and over all.
struct PassSeconds {
    fewer: f64,
    all: f64,
}

/// The views of the passes that look at every so many pixels, by turns; none where a pass looks at all.
fn turns<'a>(views: &[&'a View], stride: usize, passes: usize) -> Vec<Vec<Cow<'a, View>>> {
    let count = if stride > 1 { passes.min(stride * stride) } else { 0 };
    (0..count).map(|turn| strided(views, stride, turn)).collect()
}

/// Which of so many turns a pass looks at, from 1 on; `None` for all pixels.
const fn turn_of(pass: usize, num_turns: usize) -> Option<usize> {
    if num_turns == 0 || pass.is_multiple_of(ALL_EVERY) {
        return None;
    }
    Some((pass - 1 - pass / ALL_EVERY) % num_turns)
}

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
        let steps = run.adam_passes();
        check_refinement([self.scene.num_lidar, self.scene.num_background()], None, MemorySettings::default())?;
        let (start, mut waited) = (Instant::now(), Duration::ZERO);
        let full: Vec<&View> = inputs.views().iter().collect();
        let stride = watch.time(Stage::Refine, |_| run.recipe.pixel_stride.of(&full));
        let fewer = watch.time(Stage::Refine, |_| turns(&full, stride, steps));
        let fewer: Vec<Vec<&View>> = fewer.iter().map(|views| views.iter().map(Cow::as_ref).collect()).collect();
        // A pass draws the views once, as a learned step has.
        let refined = self.network.as_ref().and_then(|network| RefineSummary::drawing_s(&network.refine));
        let pass_s = refined.or(run.deadline.map(|deadline| deadline.adam_pass_s)).unwrap_or(0.0);
        let mut seconds = PassSeconds { fewer: pass_s, all: pass_s * (stride * stride) as f64 };
        let settings = AdamSettings {
            rates,
            schedule: run.recipe.adam_schedule(run.seed),
            warm_start: self.network.as_ref().is_some_and(|network| network.refine.steps > 0),
            device: run.recipe.device(),
        };
        let mut adam = Adam::new(self.scene.len(), settings);
        let (before, refine_before) = (self.seconds, watch.times.refine);
        watch.progress.begin(Stage::Refine, steps);
        for step in 1..=steps {
            let begun = Instant::now();
            let (views, pass_s) = match turn_of(step, fewer.len()) {
                Some(turn) => (&fewer[turn], &mut seconds.fewer),
                None => (&full, &mut seconds.all),
            };
            if run.deadline.is_some_and(|deadline| begun + Duration::from_secs_f64(*pass_s) > deadline.until) {
                break;
            }
            let pinholes = views.iter().map(|view| &view.pinhole);
            watch.time(Stage::Refine, |_| MemoryEstimate::of_set(&self.scene).check(pinholes, Pass::Gradient))?;
            watch.time(Stage::Refine, |progress| {
                adam.pass_ahead(&mut self.scene, views);
                if marks.steps.contains(&step) {
                    adam.settle(&mut self.scene);
                }
                progress.step(Stage::Refine);
            });
            *pass_s = begun.elapsed().as_secs_f64();
            let asked = Instant::now();
            watch.times.refine = refine_before;
            watch.times.add_refine(adam.summary().seconds);
            self.seconds = before + (asked - start - waited).as_secs_f64();
            if marks.steps.contains(&step) {
                (marks.done)(self, &watch.times);
            }
            waited += asked.elapsed();
        }
        watch.time(Stage::Refine, |_| adam.settle(&mut self.scene));
        watch.progress.end(Stage::Refine);
        let summary = adam.into_summary();
        self.optimisation = (!summary.losses.is_empty()).then_some(AdamSummary { pixel_stride: stride, ..summary });
        self.seconds = before + (start.elapsed() - waited).as_secs_f64();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::turn_of;

    #[test]
    fn turns_follow_each_other_and_every_fourth_pass_looks_at_all() {
        let turns = |count| (1..=9).map(|pass| turn_of(pass, count)).collect::<Vec<_>>();
        let all = None;
        assert_eq!(turns(4), [Some(0), Some(1), Some(2), all, Some(3), Some(0), Some(1), all, Some(2)]);
        assert_eq!(turns(2)[..3], [Some(0), Some(1), Some(0)]);
        assert!(turns(0).iter().all(Option::is_none));
    }
}
