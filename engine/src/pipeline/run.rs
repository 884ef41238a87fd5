//! A recipe, run on an opened clip.

use std::time::Instant;

use super::{Begun, NetworkSettings, Reconstruction, Session, StageTimes, Watch, begin};
use crate::{error::Result, gaussians::Start, network::model::Model, recipe::Recipe, refine::adam::AdamRates};

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

/// When a run has to be done.
#[derive(Clone, Copy, Debug)]
pub struct Deadline {
    /// No step begins that would probably end later.
    pub until: Instant,
    /// Passes of per-scene optimisation that are made where there is time.
    pub adam_passes: usize,
    /// Seconds that the first pass of per-scene optimisation will probably take, where no learned one has told.
    pub adam_pass_s: f64,
}

/// Who is told of a scene after how many steps, and of the times until then; what that takes counts for nothing.
pub struct Marks<'a> {
    /// Numbers of steps, from 1 on.
    pub steps: &'a [usize],
    /// Is told.
    pub done: &'a mut dyn FnMut(&Reconstruction, &StageTimes),
}

impl std::fmt::Debug for Marks<'_> {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Marks").field("steps", &self.steps).finish_non_exhaustive()
    }
}

impl Run<'_> {
    /// The initial Gaussians alone.
    pub fn initial(start: Start) -> Self {
        Self { recipe: Recipe::initial(start), model: None, seed: 0, deadline: None }
    }

    /// Most passes of per-scene optimisation.
    pub(super) fn adam_passes(&self) -> usize {
        self.deadline.map_or(self.recipe.adam_passes, |deadline| deadline.adam_passes)
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
        done: &mut dyn FnMut(&Reconstruction, &StageTimes),
    ) -> Result<Reconstruction> {
        let (recipe, inputs) = (&run.recipe, self.inputs());
        let until = run.deadline.map(|deadline| deadline.until);
        let network = run.model.filter(|_| recipe.network);
        let network = network.map(|model| NetworkSettings::of(recipe, model, run.seed, until));
        let mut made = self.finish(recipe.start(), network.as_ref(), watch)?;
        if marks.contains(&0) {
            done(&made, &watch.times);
        }
        if run.adam_passes() > 0 {
            made.optimise(inputs, run, AdamRates::default(), watch, Marks { steps: marks, done })?;
        }
        Ok(made)
    }
}
