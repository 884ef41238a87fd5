//! Inputs to scene.

use std::time::Instant;

use serde::Serialize;

use super::{
    Inputs, MemorySettings, NetworkRun, NetworkSettings, NetworkSummary, PointStep, Stage, Watch, check_refinement,
    run_network,
};
use crate::{
    densify::DensityMap,
    error::{EngineError, Result},
    gaussians::{
        self, GaussianSet, Start,
        background::{self, MapFit, Mode},
        motion,
    },
    points::{self, Dropped, PointCloud, Timing},
    refine::adam::AdamSummary,
    views::View,
};

/// How many Gaussians a reconstruction started with, changed and ended with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct GaussianCounts {
    /// Returns that some input camera sees.
    pub returns: usize,
    /// `LiDAR` branch: one per return, or for several that are denser than the pixels.
    pub initial: usize,
    /// Taken from the `LiDAR` branch by the set update.
    pub pruned: usize,
    /// Added to the `LiDAR` branch by the set update.
    pub added: usize,
    /// `LiDAR` branch at the end: `initial - pruned + added`.
    #[serde(rename = "final")]
    pub last: usize,
    /// Taken from the background branch by the set update.
    pub background_pruned: usize,
    /// Background branch at the end.
    pub background: usize,
}

/// A finished scene.
#[derive(Clone, Debug)]
pub struct Reconstruction {
    /// The scene.
    pub scene: GaussianSet,
    /// How it came about.
    pub counts: GaussianCounts,
    /// What the network did; `None` without one.
    pub network: Option<NetworkSummary>,
    /// What a per-scene optimisation did; `None` where there was none.
    pub optimisation: Option<AdamSummary>,
    /// What the policy said of each primitive; `None` where it was not asked.
    pub density: Option<DensityMap>,
    /// How the clip's depth maps were brought to metres; empty where none was used for the background.
    pub depth_maps: Vec<MapFit>,
    /// When returns were measured, where the sweeps or the images told and not the clip.
    pub timing: Timing,
    /// Returns that are no surface and were left out.
    pub dropped: Dropped,
    /// Seconds that it took, from the loaded inputs on.
    pub seconds: f64,
}

/// A reconstruction that has its initial `LiDAR` Gaussians, and nothing else yet.
#[derive(Debug)]
pub struct Begun<'a> {
    inputs: &'a Inputs,
    cloud: PointCloud,
    timing: Timing,
    dropped: Dropped,
    movement: motion::Movement,
    scene: GaussianSet,
    start: Instant,
}

/// The initial `LiDAR` Gaussians of what `inputs` show: every step of [`Stage::Points`] but [`PointStep::Merging`], which needs the recipe.
///
/// # Errors
/// Whatever is wrong with the sweep of an input frame.
pub fn begin<'a>(inputs: &'a Inputs, watch: &mut Watch<'_>) -> Result<Begun<'a>> {
    let start = Instant::now();
    let (cloud, timing, dropped, movement, scene) =
        watch.stage(Stage::Points, PointStep::ALL.len() - 1, |progress| {
            let mut cloud = inputs.cloud()?;
            let turn = inputs.tell_apart(&mut cloud)?;
            let dropped = points::drop_strays(&mut cloud)?;
            progress.point_step(PointStep::Cloud);
            let (movement, timing) = inputs.movement_and_times(&mut cloud)?;
            let timing = Timing { turn: turn.or(timing.turn), ..timing };
            progress.point_step(PointStep::Motion);
            let colours = points::paint(&cloud, &movement.velocities, inputs.views());
            progress.point_step(PointStep::Colours);
            let painted: Vec<u32> =
                (0..).zip(&colours).filter(|(_, colour)| colour.is_some()).map(|(i, _)| i).collect();
            let spacing = points::spacing(&cloud.positions, &painted)?;
            let spacing = points::bounded(&spacing, &cloud.ranges(&painted));
            let mut scene = gaussians::initial(&cloud, &colours, &spacing);
            for (own, &point) in scene.velocities.iter_mut().zip(&painted) {
                *own = movement.velocities[point as usize];
            }
            progress.point_step(PointStep::Spacing);
            Result::Ok((cloud, timing, dropped, movement, scene))
        })?;
    Ok(Begun { inputs, cloud, timing, dropped, movement, scene, start })
}

impl<'a> Begun<'a> {
    /// What the reconstruction reads.
    pub(super) const fn inputs(&self) -> &'a Inputs {
        self.inputs
    }

    /// How many `LiDAR` Gaussians there are.
    pub fn num_points(&self) -> usize {
        self.scene.len()
    }

    /// The scene.
    ///
    /// # Errors
    /// Those of [`run_network`]; [`EngineError::Setting`] for more Gaussians than there is memory to refine them, and for [`Mode::Maps`] where
    /// no input image has a map.
    pub(super) fn finish(
        self,
        settings: impl Into<Start>,
        network: Option<&NetworkSettings<'_>>,
        watch: &mut Watch<'_>,
    ) -> Result<Reconstruction> {
        let Self { inputs, cloud, timing, dropped, movement, mut scene, start } = self;
        let (settings, returns) = (settings.into(), scene.len());
        if settings.background == Mode::Maps && inputs.views().iter().all(|view| view.depth_map.is_none()) {
            return Err(EngineError::Setting {
                setting: "background",
                expected: "`depth` of an input image in clip.json for maps".to_owned(),
                found: "none".to_owned(),
            });
        }
        watch.stage(Stage::Points, 1, |progress| {
            gaussians::merge_dense(&mut scene, inputs.views(), settings.coarseness);
            progress.point_step(PointStep::Merging);
        });
        let depth_maps = watch.stage(Stage::Background, 1, |_| {
            background::add_background(&mut scene, inputs.views(), &cloud, &movement, settings)
        });
        drop((cloud, movement));
        let initial = scene.num_lidar;
        if let Some(settings) = network.filter(|settings| settings.refine.steps > 0) {
            check_refinement(
                [initial, scene.len() - initial],
                Some(&settings.model.config),
                MemorySettings::default(),
            )?;
        }
        let views: Vec<&View> = inputs.views().iter().collect();
        let network = network.map(|settings| run_network(&mut scene, &views, settings, watch)).transpose()?;
        let update = network.as_ref().map(|run| run.update).unwrap_or_default();
        let counts = GaussianCounts {
            returns,
            initial,
            pruned: update.pruned,
            added: update.added,
            last: scene.num_lidar,
            background_pruned: update.background_pruned,
            background: scene.num_background(),
        };
        let seconds = start.elapsed().as_secs_f64();
        let (network, density) = match network {
            Some(NetworkRun { summary, density, .. }) => (Some(summary), density),
            None => (None, None),
        };
        Ok(Reconstruction { scene, counts, network, optimisation: None, density, depth_maps, timing, dropped, seconds })
    }
}

impl Reconstruction {
    /// A scene that came from elsewhere, of which nothing else is known.
    pub fn of_scene(scene: GaussianSet) -> Self {
        Self {
            scene,
            counts: GaussianCounts::default(),
            network: None,
            optimisation: None,
            density: None,
            depth_maps: Vec::new(),
            timing: Timing::default(),
            dropped: Dropped::default(),
            seconds: 0.0,
        }
    }
}
