//! The first prediction: features of every primitive, the exchange between timestamps, residuals and velocities.

use std::collections::BTreeMap;

use crate::error::{EngineError, Result};
use crate::gaussians::{GaussianSet, NUM_ATTRIBUTES};
use crate::network::buffers::Buffers;
use crate::network::config::ModelConfig;
use crate::network::levels::{Levels, voxels_of};
use crate::network::model::{BACKGROUND_INITIAL_INPUTS, FoldedModel};
use crate::network::normalise::{INITIAL_INPUTS, add_residuals, initial_rows};
use crate::network::pass::gather;
use crate::network::policy::{EXTRA_INPUTS, FoldedPolicy, Geometry};
use crate::ops::knn::{Neighbours, nearest_other_time};

/// Features of the `LiDAR` branch, and what the next stages need beside them.
#[derive(Debug)]
pub struct Features {
    /// `[N, width]` decoder features; after [`query`] the fused ones.
    pub rows: Vec<f32>,
    /// Buffers that the stages share.
    pub buffers: Buffers,
}

/// Why the query did not run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum QuerySkipped {
    /// The setting says so.
    Off,
    /// The model has none.
    NotInModel,
    /// All primitives are of one frame, or of frames of one moment: there is nobody to ask.
    SingleTimestamp,
}

/// Positions of chosen Gaussians.
pub fn positions(set: &GaussianSet, chosen: &[usize]) -> impl Iterator<Item = [f32; 3]> {
    chosen.iter().map(|&i| set.mean(i))
}

/// Decoder features of the `LiDAR` branch.
///
/// # Errors
/// When a position leaves the voxel grid.
pub fn backbone(set: &GaussianSet, model: &FoldedModel) -> Result<Features> {
    let chosen: Vec<usize> = (0..set.num_lidar).collect();
    let voxels = voxels_of(positions(set, &chosen), model.config.voxel_size)?;
    let levels = Levels::new(&voxels, model.config.unet.num_levels())?;
    let mut buffers = Buffers::default();
    let sites = model.initial.site_features(&initial_rows(set, &chosen), INITIAL_INPUTS, &levels, &mut buffers);
    let rows = gather(&sites, &levels, &mut buffers);
    buffers.give(sites);
    Ok(Features { rows, buffers })
}

/// For every primitive of the `LiDAR` branch the first frame of its moment: frames of a single time, the same for all of them, are one moment;
/// any other frame is one by itself, whatever the times of its returns.
fn moments(set: &GaussianSet) -> Vec<u32> {
    let rows = || set.frames[..set.num_lidar].iter().zip(&set.times);
    let mut time_of = BTreeMap::new();
    for (&frame, time) in rows() {
        let time = Some(time.to_bits());
        let known = time_of.entry(frame).or_insert(time);
        *known = known.filter(|_| *known == time);
    }
    let mut first_of = BTreeMap::new();
    let first = |(&frame, &time): (&u32, &Option<u32>)| {
        (frame, time.map_or(frame, |time| *first_of.entry(time).or_insert(frame)))
    };
    let moment_of: BTreeMap<u32, u32> = time_of.iter().map(first).collect();
    rows().map(|(frame, _)| moment_of[frame]).collect()
}

/// The `k` nearest of other frames of every primitive of the `LiDAR` branch; `None` when all are of one.
///
/// # Errors
/// When a position is not finite.
pub fn other_time_neighbours(set: &GaussianSet, k: usize) -> Result<Option<Neighbours>> {
    let groups = moments(set);
    if groups.iter().all(|group| *group == groups[0]) {
        return Ok(None);
    }
    let chosen: Vec<usize> = (0..set.num_lidar).collect();
    let points: Vec<[f32; 3]> = positions(set, &chosen).collect();
    Ok(Some(nearest_other_time(&points, &groups, k)?))
}

/// Lets every primitive ask its nearest of other frames; says why where it does not.
///
/// # Errors
/// When a position is not finite.
pub fn query(features: &mut Features, set: &GaussianSet, model: &FoldedModel) -> Result<Option<QuerySkipped>> {
    let (Some(query), Some(config)) = (&model.query, &model.config.query) else {
        return Ok(Some(QuerySkipped::NotInModel));
    };
    let Some(neighbours) = other_time_neighbours(set, config.neighbours)? else {
        return Ok(Some(QuerySkipped::SingleTimestamp));
    };
    let fused = query.forward(&features.rows, &neighbours.indices, config.neighbours, &mut features.buffers);
    let plain = std::mem::replace(&mut features.rows, fused);
    features.buffers.give(plain);
    Ok(None)
}

/// Fails where outputs had to be skipped.
fn all_finite(skipped: &[usize], count: usize) -> Result<()> {
    let Some(first) = skipped.first() else { return Ok(()) };
    let found = format!("others for {} of {count}, the first of them Gaussian {first}", skipped.len());
    Err(EngineError::Setting { setting: "weights", expected: "finite outputs of the network".to_owned(), found })
}

/// Adds the predicted residuals and velocities of the `LiDAR` branch, and the residuals of the background.
///
/// # Errors
/// When a position leaves the voxel grid, or a Gaussian would get a value that is not finite.
pub fn predict(set: &mut GaussianSet, features: &mut Features, model: &FoldedModel) -> Result<()> {
    let chosen: Vec<usize> = (0..set.num_lidar).collect();
    let heads = model.initial.heads();
    let own = if heads.read_own() { initial_rows(set, &chosen) } else { Vec::new() };
    let outputs = heads.forward(&features.rows, &own, chosen.len(), &mut features.buffers);
    all_finite(&add_residuals(set, &chosen, &outputs, heads.num_outputs()).not_finite, chosen.len())?;
    features.buffers.give(outputs);
    let chosen: Vec<usize> = (set.num_lidar..set.len()).collect();
    if chosen.is_empty() {
        return Ok(());
    }
    let voxels = voxels_of(positions(set, &chosen), model.config.background_voxel_size)?;
    let levels = Levels::new(&voxels, model.config.background_unet.num_levels())?;
    let (pass, rows) = (&model.background_initial, initial_rows(set, &chosen));
    let (heads, buffers) = (pass.heads(), &mut features.buffers);
    let sites = pass.site_features(&rows, BACKGROUND_INITIAL_INPUTS, &levels, buffers);
    // Linear heads say the same of all points of a site.
    let (first, outputs) = if heads.read_own() {
        let by_point = gather(&sites, &levels, buffers);
        let outputs = heads.forward(&by_point, &rows, chosen.len(), buffers);
        (by_point, outputs)
    } else {
        let by_site = heads.forward(&sites, &[], levels.sites.len(), buffers);
        let outputs = gather(&by_site, &levels, buffers);
        (by_site, outputs)
    };
    all_finite(&add_residuals(set, &chosen, &outputs, heads.num_outputs()).not_finite, chosen.len())?;
    [sites, first, outputs].into_iter().for_each(|buffer| buffers.give(buffer));
    Ok(())
}

/// Scores `[N]` of pruning and of adding for the `LiDAR` branch; `None` when the model has no policy.
///
/// # Errors
/// As [`scores_of`].
pub fn scores(features: &mut Features, set: &GaussianSet, model: &FoldedModel) -> Result<Option<[Vec<f32>; 2]>> {
    let Some(policy) = &model.policy else { return Ok(None) };
    scores_of(&features.rows, set, policy, &model.config, &mut features.buffers).map(Some)
}

/// Scores `[N]` of pruning and of adding for the `LiDAR` branch of a scene as predicted.
///
/// # Shapes
/// `features` `[N, width]` decoder features, after the query.
///
/// # Errors
/// When a position leaves the voxel grid, or the voxels span more than the curves' bits.
pub fn scores_of(
    features: &[f32],
    set: &GaussianSet,
    policy: &FoldedPolicy,
    config: &ModelConfig,
    buffers: &mut Buffers,
) -> Result<[Vec<f32>; 2]> {
    let chosen: Vec<usize> = (0..set.num_lidar).collect();
    let Some(inputs) = PolicyInputs::new(features, set, &chosen, config)? else { return Ok([Vec::new(), Vec::new()]) };
    let found = policy.scores(&inputs.rows, &inputs.geometry, buffers)?;
    Ok([0, 1].map(|k| inputs.site_of.iter().map(|&site| found[site as usize][k]).collect()))
}

/// What the policy is given of some primitives.
#[derive(Debug)]
pub struct PolicyInputs {
    /// `[M, width + EXTRA_INPUTS]` by voxel.
    pub rows: Vec<f32>,
    /// The voxels.
    pub geometry: Geometry,
    /// `[n]` voxel of every primitive.
    pub site_of: Vec<u32>,
}

impl PolicyInputs {
    /// The inputs of `chosen` primitives, which alone fill the voxels; `None` when the model has no policy or nothing is chosen.
    ///
    /// # Formula
    /// `[f', attributes, ln(1 + points in the voxel)]`, averaged over the points of a voxel; voxels of the positions as they are in `set`.
    ///
    /// # Shapes
    /// `features` `[N, width]` of all primitives of the `LiDAR` branch.
    ///
    /// # Errors
    /// When a position leaves the voxel grid, or the voxels span more than the curves' bits.
    pub fn new(features: &[f32], set: &GaussianSet, chosen: &[usize], config: &ModelConfig) -> Result<Option<Self>> {
        let Some(policy) = config.policy.as_ref().filter(|_| !chosen.is_empty()) else { return Ok(None) };
        let levels = Levels::new(&voxels_of(positions(set, chosen), config.voxel_size)?, policy.encoder.len())?;
        let maps: Vec<_> = levels.levels.iter().map(|level| level.submanifold.clone()).collect();
        let geometry = Geometry::new(&levels.sites, &maps, policy)?;
        let (width, states) = (config.unet.width(), initial_rows(set, chosen));
        let mut rows = vec![0.0; chosen.len() * (width + EXTRA_INPUTS)];
        let parts = chosen.iter().zip(states.chunks_exact(INITIAL_INPUTS)).zip(&levels.site_of);
        for (row, ((&i, state), &site)) in rows.chunks_exact_mut(width + EXTRA_INPUTS).zip(parts) {
            row[..width].copy_from_slice(&features[i * width..][..width]);
            row[width..width + NUM_ATTRIBUTES].copy_from_slice(&state[..NUM_ATTRIBUTES]);
            row[width + NUM_ATTRIBUTES] = (levels.num_points[site as usize] as f32).ln_1p();
        }
        Ok(Some(Self { rows: levels.mean_of_points(&rows, width + EXTRA_INPUTS), geometry, site_of: levels.site_of }))
    }
}

#[cfg(test)]
mod tests {
    use super::{GaussianSet, other_time_neighbours};
    use crate::gaussians::Gaussian;

    /// Three frames of twenty primitives each, all over the same place.
    fn scene(time: impl Fn(u32, u32) -> f32) -> GaussianSet {
        let mut set = GaussianSet::default();
        for (frame, i) in (0..3).flat_map(|frame| (0..20).map(move |i| (frame, i))) {
            let mut row = [0.0; 14];
            row[0] = (i * 7 % 20) as f32 + 0.3 * frame as f32;
            set.push(Gaussian { attributes: row, time: time(frame, i), frame, velocity: [0.0; 3] });
        }
        set.num_lidar = set.len();
        set
    }

    #[test]
    fn times_of_returns_leave_neighbours_as_they_are() {
        let whole = |frame: u32| 0.1 * frame as f32;
        let want = other_time_neighbours(&scene(|frame, _| whole(frame)), 8).unwrap().unwrap();
        let set = scene(|frame, i| whole(frame) + 0.005 * i as f32 - 0.05);
        let found = other_time_neighbours(&set, 8).unwrap().unwrap();
        assert_eq!(found.indices, want.indices);
        let own = |i: usize| found.of(i).iter().any(|&j| set.frames[j as usize] == set.frames[i]);
        assert!(!(0..set.len()).any(own), "one of its own frame, of another time");
    }

    #[test]
    fn a_frame_alone_and_frames_of_one_moment_ask_nobody() {
        let mut set = scene(|_, i| 0.005 * i as f32);
        set.frames.fill(4);
        assert!(other_time_neighbours(&set, 8).unwrap().is_none());
        assert!(other_time_neighbours(&scene(|_, _| 0.3), 8).unwrap().is_none());
        assert!(other_time_neighbours(&GaussianSet::default(), 8).unwrap().is_none());
    }
}
