//! A recipe, run on an opened clip.

use std::{
    borrow::Cow,
    time::{Duration, Instant},
};

use super::{
    Begun, Inputs, MemorySettings, NetworkSettings, Reconstruction, Session, Stage, StageTimes, Watch, begin,
    check_refinement,
};
use crate::{
    error::Result,
    gaussians::Start,
    network::model::Model,
    recipe::Recipe,
    refine::RefineSummary,
    render::{MemoryEstimate, Pass},
    views::{View, at_factor},
};

/// What is run.
#[derive(Clone, Copy, Debug)]
pub struct Run<'a> {
    /// The recipe.
    pub recipe: Recipe,
    /// The network; `None` for a recipe without one.
    pub model: Option<&'a Model>,
    /// Seed of everything that is drawn at random.
    pub seed: u64,
    /// When it has to be done; `None` for no limit.
    pub deadline: Option<Deadline>,
}

/// Who is told of a scene at a mark, and of the times until then.
pub(super) type Told<'a> = dyn FnMut(&Reconstruction, &StageTimes) + 'a;

/// When a run has to be done.
#[derive(Clone, Copy, Debug)]
pub struct Deadline {
    /// No step begins that would probably end later.
    pub until: Instant,
    /// Steps of per-scene optimisation that are made where there is time.
    pub adam_steps: usize,
    /// Seconds that the first step of per-scene optimisation will probably take, where no learned one has told.
    pub adam_step_s: f64,
}

impl Run<'_> {
    /// The initial Gaussians alone.
    pub fn initial(start: Start) -> Self {
        Self { recipe: Recipe::initial(start), model: None, seed: 0, deadline: None }
    }

    /// Most steps of per-scene optimisation.
    fn adam_steps(&self) -> usize {
        self.deadline.map_or(self.recipe.adam_steps, |deadline| deadline.adam_steps)
    }
}

impl Session {
    /// The scene that the clip shows.
    ///
    /// # Errors
    /// Those of [`begin`] and of [`Begun::run`].
    pub fn run(&self, run: &Run<'_>, watch: &mut Watch<'_>) -> Result<Reconstruction> {
        begin(self.inputs(), watch)?.run(run, watch, &[], &mut |_, _| ())
    }
}

impl Begun<'_> {
    /// The scene: the rest of the initial Gaussians, the network where the recipe has one, per-scene optimisation. `done` is told of the scene
    /// after each of the `marks`, steps of the latter, and of the times until then; what it takes counts for nothing.
    ///
    /// # Errors
    /// Those of `Begun::finish`; more Gaussians than there is memory to optimise or to draw them.
    pub fn run(
        self,
        run: &Run<'_>,
        watch: &mut Watch<'_>,
        marks: &[usize],
        done: &mut Told<'_>,
    ) -> Result<Reconstruction> {
        let (recipe, inputs) = (&run.recipe, self.inputs());
        let until = run.deadline.map(|deadline| deadline.until);
        let network = run.model.filter(|_| recipe.network);
        let network = network.map(|model| NetworkSettings::of(recipe, model, run.seed, until));
        let mut made = self.finish(recipe.start(), network.as_ref(), watch)?;
        if marks.contains(&0) {
            done(&made, &watch.times);
        }
        if run.adam_steps() > 0 {
            optimise(&mut made, inputs, run, watch, (marks, done))?;
        }
        Ok(made)
    }
}

/// Optimises a finished scene over the input views, in place: what `--refine-with adam` does.
pub(super) fn optimise(
    made: &mut Reconstruction,
    inputs: &Inputs,
    run: &Run<'_>,
    watch: &mut Watch<'_>,
    (marks, done): (&[usize], &mut Told<'_>),
) -> Result<()> {
    let (steps, schedule, reduce) = (run.adam_steps(), run.recipe.view_schedule(run.seed), run.recipe.refine_reduce);
    check_refinement([made.scene.num_lidar, made.scene.num_background()], None, MemorySettings::default())?;
    let (start, mut waited) = (Instant::now(), Duration::ZERO);
    // A step draws the views once, as the learned refinement has.
    let refined = made.network.as_ref().and_then(|network| RefineSummary::drawing_s(&network.refine));
    let mut step_s = refined.or(run.deadline.map(|deadline| deadline.adam_step_s)).unwrap_or(0.0);
    let mut adam = made.begin_adam((schedule, run.recipe.device()), reduce, inputs.views().len());
    let (before, refine_before) = (made.seconds, watch.times.refine);
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
            watch.time(Stage::Refine, |_| MemoryEstimate::of_set(&made.scene).check(pinholes, Pass::Gradient))?;
        }
        watch.time(Stage::Refine, |progress| {
            adam.step_ahead(&mut made.scene, &views);
            if marks.contains(&step) {
                adam.settle(&mut made.scene, &views);
            }
            progress.step(Stage::Refine);
        });
        if draws {
            step_s = begun.elapsed().as_secs_f64();
        }
        let asked = Instant::now();
        watch.times.refine = refine_before;
        watch.times.add_refine(adam.summary().seconds);
        made.seconds = before + (asked - start - waited).as_secs_f64();
        if marks.contains(&step) {
            done(made, &watch.times);
        }
        waited += asked.elapsed();
    }
    watch.time(Stage::Refine, |_| adam.settle(&mut made.scene, &views));
    watch.progress.end(Stage::Refine);
    let summary = adam.into_summary();
    made.optimisation = (!summary.losses.is_empty()).then_some(summary);
    made.seconds = before + (start.elapsed() - waited).as_secs_f64();
    Ok(())
}
