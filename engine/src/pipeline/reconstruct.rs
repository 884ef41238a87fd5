//! Inputs to scene.

use std::time::Instant;

use serde::Serialize;

use super::{Inputs, NetworkSettings, NetworkSummary, Stage, Watch, run_network};
use crate::{
    densify::DensityMap,
    error::{EngineError, Result},
    gaussians::{
        self, GaussianSet,
        background::{self, MapFit, Mode},
    },
    points,
    refine::adam::{Adam, AdamSettings, AdamSummary},
    views::View,
};

/// How many Gaussians a reconstruction started with, changed and ended with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct GaussianCounts {
    /// `LiDAR` branch: one per return that some input camera sees.
    pub initial: usize,
    /// Taken from the `LiDAR` branch by the set update.
    pub pruned: usize,
    /// Added to the `LiDAR` branch by the set update.
    pub added: usize,
    /// `LiDAR` branch at the end: `initial - pruned + added`.
    #[serde(rename = "final")]
    pub last: usize,
    /// Background branch, which the set update does not change.
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
    /// Seconds that it took, from the loaded inputs on.
    pub seconds: f64,
}

/// Steps of [`Stage::Points`] that progress is told of: cloud, colours, spacing, background.
const POINT_STEPS: usize = 4;

/// The scene that `inputs` show.
///
/// # Errors
/// Whatever is wrong with the sweep of an input frame; [`EngineError::Setting`] for [`Mode::Maps`] where no input image has a map.
pub fn reconstruct(
    inputs: &Inputs<'_>,
    background: Mode,
    network: Option<&NetworkSettings<'_>>,
    watch: &mut Watch<'_>,
) -> Result<Reconstruction> {
    let start = Instant::now();
    if background == Mode::Maps && inputs.views().iter().all(|view| view.depth_map.is_none()) {
        return Err(EngineError::Setting {
            setting: "--background",
            expected: "`depth` of an input image in clip.json for maps".to_owned(),
            found: "none".to_owned(),
        });
    }
    let (mut scene, depth_maps) = watch.stage(Stage::Points, POINT_STEPS, |progress| {
        let step = || progress.step(Stage::Points);
        let cloud = inputs.cloud()?;
        step();
        let colours = points::paint(&cloud, inputs.views());
        step();
        let painted: Vec<u32> = (0..).zip(&colours).filter(|(_, colour)| colour.is_some()).map(|(i, _)| i).collect();
        let spacing = points::spacing(&cloud.positions, &painted)?;
        step();
        let mut scene = gaussians::initial(&cloud, &colours, &spacing);
        let depth_maps = background::add_background(&mut scene, inputs.views(), &cloud, background);
        step();
        Result::Ok((scene, depth_maps))
    })?;
    let initial = scene.num_lidar;
    let views: Vec<&View> = inputs.views().iter().collect();
    let network = network.map(|settings| run_network(&mut scene, &views, settings, watch)).transpose()?;
    let update = network.as_ref().map(|run| run.update).unwrap_or_default();
    let counts = GaussianCounts {
        initial,
        pruned: update.pruned,
        added: update.added,
        last: scene.num_lidar,
        background: scene.len() - scene.num_lidar,
    };
    let seconds = start.elapsed().as_secs_f64();
    let (network, density) = network.map(|run| (run.summary, run.density)).unzip();
    Ok(Reconstruction { scene, counts, network, optimisation: None, density: density.flatten(), depth_maps, seconds })
}

/// Optimises a finished scene over the input views, in place: what `--refine-with adam` does instead of the learned refinement.
pub fn optimise(
    reconstruction: &mut Reconstruction,
    inputs: &Inputs<'_>,
    settings: AdamSettings,
    steps: usize,
    watch: &mut Watch<'_>,
) {
    let start = Instant::now();
    let views: Vec<&View> = inputs.views().iter().collect();
    let scene = &mut reconstruction.scene;
    let mut adam = Adam::new(scene.len(), settings);
    watch.stage(Stage::Refine, steps, |progress| {
        for _ in 0..steps {
            adam.step(scene, &views);
            progress.step(Stage::Refine);
        }
    });
    watch.times.refine = Some(adam.summary().seconds);
    reconstruction.optimisation = Some(adam.into_summary());
    reconstruction.seconds += start.elapsed().as_secs_f64();
}
