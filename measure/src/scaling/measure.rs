//! Runs of a clip through the pipeline, as `lgs-infer` goes through it with its defaults: often for time, once for memory and for what
//! there was to do.

use std::{collections::BTreeMap, sync::Arc, time::Instant};

use lgs_engine::{
    allocator,
    densify::DensityMap,
    error::Result as EngineResult,
    gaussians::{background::Mode, physical::to_physical},
    network::source::LoadedModel,
    pipeline::{Drawing, Need, Opening, RenderedView, Run, Session, Silent, Stage, Watch, evaluate_views},
    recipe::Recipe,
    refine::RefineSummary,
    views::View,
};
use lgs_formats::clip_dir::ClipDir;
use serde::{Deserialize, Serialize};

use super::{
    part::Part,
    profiler::{StageProfiler, Wanted},
    work::Work,
};
use crate::error::Result;

/// Timed runs of a size, however long they take.
const FEWEST_REPEATS: usize = 2;
/// Seconds of timed runs after which there are no more of a size.
const ENOUGH_S: f64 = 20.0;

/// Seconds of each part in one run.
pub type Pass = BTreeMap<Part, f64>;

/// What runs of a clip in one process took.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Times {
    /// The first run, which finds caches and pages cold.
    pub first: Pass,
    /// Those after it.
    pub passes: Vec<Pass>,
    /// Resident memory before the first run, 10^6 bytes; `None` where the system does not say.
    pub resident_mb: Option<f64>,
    /// Largest resident memory when the first run was done, 10^6 bytes.
    pub peak_rss_mb: Option<f64>,
}

/// What a run needs, and what there is to do.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Space {
    /// Of each part, how far resident memory rose above what it was when the part began, in a process that gives freed pages back; 10^6
    /// bytes.
    pub memory_mb: BTreeMap<Part, f64>,
    /// What the engine says beforehand that a run surely needs, 10^6 bytes.
    pub predicted_mb: f64,
    /// How much there is to do.
    pub work: Work,
}

/// A clip, and what runs on it.
#[derive(Clone, Copy, Debug)]
pub struct Bench<'a> {
    /// The clip.
    pub dir: &'a Arc<ClipDir>,
    /// The network; `None` without one.
    pub model: Option<&'a LoadedModel>,
    /// Seed of everything that is drawn at random.
    pub seed: u64,
}

/// One run.
#[derive(Debug)]
struct Passed {
    seconds: Pass,
    memory_mb: BTreeMap<Part, f64>,
    refine: Option<RefineSummary>,
}

impl Bench<'_> {
    /// What runs of the clip take: one that does not count, then at most `repeats`, fewer when they take long.
    ///
    /// # Errors
    /// A clip that does not fit into the memory; those of the pipeline.
    pub fn times(&self, repeats: usize) -> Result<Times> {
        let resident_mb = allocator::peak_rss_mb();
        let first = self.pass(Wanted::Time)?.seconds;
        let peak_rss_mb = allocator::peak_rss_mb();
        let (mut passes, start) = (Vec::new(), Instant::now());
        while passes.len() < repeats && (passes.len() < FEWEST_REPEATS || start.elapsed().as_secs_f64() < ENOUGH_S) {
            passes.push(self.pass(Wanted::Time)?.seconds);
        }
        Ok(Times { first, passes, resident_mb, peak_rss_mb })
    }

    /// What a run of the clip needs, and what there is to do. Afterwards the process gives freed memory back.
    ///
    /// # Errors
    /// A clip that does not fit into the memory; those of the pipeline.
    pub fn space(&self) -> Result<Space> {
        allocator::return_pages();
        let passed = self.pass(Wanted::Memory)?;
        let mut watch = Watch::new(&Silent);
        let session = self.open(&mut watch)?;
        let inputs = session.inputs();
        let size = |view: &View| [view.pinhole.height, view.pinhole.width];
        let sizes: Vec<[usize; 2]> = inputs.views().iter().map(size).collect();
        let returns = inputs.cloud()?.len();
        let initial = session.run(&Run::initial(Mode::default().into()), &mut watch)?.scene;
        let mut work = Work::of(&initial, inputs.views(), self.model.map(|loaded| &loaded.model))?;
        (work.returns, work.frames) = (returns, session.frames().input.len());
        if let Some(refine) = passed.refine {
            work.steps = refine.steps + usize::from(refine.stopped_early);
            let lengths = self.model.map(|loaded| loaded.model.config.step_length);
            let searches = lengths.is_some_and(|lengths| self.run().recipe.line_search.takes(lengths, false));
            work.drawings = refine.losses.len() + if searches { work.steps } else { 0 };
        }
        let Need { image_bytes, return_bytes, .. } = Need::of(&sizes, returns as u64);
        let predicted_mb = image_bytes.saturating_add(return_bytes) as f64 / 1e6;
        Ok(Space { memory_mb: passed.memory_mb, predicted_mb, work })
    }

    fn open(&self, watch: &mut Watch<'_>) -> Result<Session> {
        Ok(Session::open(Arc::clone(self.dir), Opening::default(), watch)?)
    }

    /// One way through the pipeline, from the files to the figures.
    fn pass(&self, wanted: Wanted) -> Result<Passed> {
        let profiler = StageProfiler::new(wanted);
        let (mut watch, start) = (Watch::new(&profiler), Instant::now());
        let session = self.open(&mut watch)?;
        let made = session.run(&self.run(), &mut watch)?;
        let (scene, scores) = (to_physical(&made.scene), made.density.as_ref().map(DensityMap::splats));
        let device = self.run().recipe.device.opened();
        let drawing = Drawing { scene: &scene, scores: scores.as_deref(), device };
        let views: Vec<&View> = session.inputs().views().iter().collect();
        evaluate_views(drawing, &views, session.truth(None), &mut watch, &|_: RenderedView<'_>| -> EngineResult<()> {
            Ok(())
        })?;
        let total = start.elapsed().as_secs_f64();
        let times = watch.times;
        let found = profiler.found();
        let mut seconds = found.seconds;
        let stages = Stage::ALL.into_iter().filter_map(|stage| Some((Part::of(stage)?, times.get(stage))));
        seconds.extend(stages.filter(|(_, seconds)| *seconds > 0.0));
        if let Some(parts) = times.refine.filter(|_| self.model.is_some()) {
            seconds.extend([(Part::RefineRender, parts.drawing()), (Part::RefineNetwork, parts.network)]);
            seconds.extend(parts.loss_alone().map(|loss| (Part::RefineLoss, loss)));
        }
        seconds.insert(Part::Total, total);
        let refine = made.network.map(|network| network.refine);
        Ok(Passed { seconds, memory_mb: found.memory_mb, refine })
    }

    fn run(&self) -> Run<'_> {
        let recipe = Recipe { network: self.model.is_some(), ..Recipe::default() };
        Run { recipe, model: self.model.map(|loaded| &loaded.model), seed: self.seed, deadline: None }
    }
}
