//! The first prediction: features of every primitive, the exchange between timestamps, residuals and velocities.

use std::collections::BTreeMap;
use std::sync::Arc;

use candle_core::Tensor;

use crate::error::{EngineError, Result};
use crate::gaussians::{Branch, GaussianSet, NUM_ATTRIBUTES};
use crate::network::config::ModelConfig;
use crate::network::levels::{Levels, voxels_of};
use crate::network::model::Model;
use crate::network::normalise::{INITIAL_INPUTS, LeftOut, add_residuals, initial_rows};
use crate::network::policy::{EXTRA_INPUTS, Geometry, Policy};
use crate::ops::knn::{Neighbours, nearest_other_time};
use crate::ops::segment::{Segments, gather, mean_pool};
use crate::ops::tensors::{of_rows, with_values};

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

/// Decoder features of the `LiDAR` branch, `[N, width]`.
///
/// # Errors
/// When a position leaves the voxel grid.
pub fn backbone(set: &GaussianSet, model: &Model) -> Result<Tensor> {
    let chosen: Vec<usize> = set.rows(Branch::Lidar).collect();
    let levels = model.levels(&model.voxels(set, &chosen, Branch::Lidar)?, Branch::Lidar)?;
    let rows = of_rows(initial_rows(set, &chosen), INITIAL_INPUTS)?;
    Ok(model.initial.features(&rows, &levels, false)?)
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
    let points: Vec<[f32; 3]> = set.rows(Branch::Lidar).map(|i| set.mean(i)).collect();
    Ok(Some(nearest_other_time(&points, &groups, k)?))
}

/// Lets every primitive ask its nearest of other frames, `features` `[N, width]` become the fused ones; says why where it does not.
///
/// # Errors
/// When a position is not finite.
pub fn query(features: &mut Tensor, set: &GaussianSet, model: &Model) -> Result<Option<QuerySkipped>> {
    let (Some(query), Some(config)) = (&model.query, &model.config.query) else {
        return Ok(Some(QuerySkipped::NotInModel));
    };
    let Some(neighbours) = other_time_neighbours(set, config.neighbours)? else {
        return Ok(Some(QuerySkipped::SingleTimestamp));
    };
    *features = query.forward(features.clone(), &Arc::new(neighbours.indices), config.neighbours)?;
    Ok(None)
}

/// Adds the predicted residuals and velocities of the `LiDAR` branch, and the residuals of the background.
///
/// # Shapes
/// `features` `[N, width]` of the `LiDAR` branch.
///
/// # Errors
/// When a position leaves the voxel grid, or a Gaussian would get a value that is not finite.
pub fn predict(set: &mut GaussianSet, features: &Tensor, model: &Model) -> Result<()> {
    let chosen: Vec<usize> = (0..set.num_lidar).collect();
    let point_inputs = of_rows(initial_rows(set, &chosen), INITIAL_INPUTS)?;
    let outputs = model.initial.heads().forward(features, &point_inputs)?;
    check_outputs(&add_outputs(set, &chosen, &outputs)?, chosen.len())?;
    let chosen: Vec<usize> = set.rows(Branch::Background).collect();
    if chosen.is_empty() {
        return Ok(());
    }
    let levels = model.levels(&model.voxels(set, &chosen, Branch::Background)?, Branch::Background)?;
    let rows = of_rows(initial_rows(set, &chosen), INITIAL_INPUTS)?;
    let (pass, heads) = (&model.background_initial, model.background_initial.heads());
    let outputs = if heads.read_point_inputs() {
        heads.forward(&pass.features(&rows, &levels, false)?, &rows)?
    } else {
        // Linear heads say the same of all points of a site.
        let features = pass.site_features(&rows, &levels, false)?;
        gather(&heads.forward(&features, &features)?, &levels.points)?
    };
    check_outputs(&add_outputs(set, &chosen, &outputs)?, chosen.len())
}

/// Adds head outputs `[n, width]` to `chosen` Gaussians, but for those that this would spoil.
///
/// # Errors
/// When the outputs cannot be read.
pub fn add_outputs(set: &mut GaussianSet, chosen: &[usize], outputs: &Tensor) -> Result<LeftOut> {
    let width = outputs.dim(1)?;
    Ok(with_values([outputs], |[values]| Ok(add_residuals(set, chosen, values, width)))?)
}

/// Fails when outputs of some of `count` Gaussians had to be left out because they are not finite.
///
/// # Errors
/// So.
fn check_outputs(left_out: &LeftOut, count: usize) -> Result<()> {
    let Some(first) = left_out.not_finite.first() else { return Ok(()) };
    let skipped = left_out.not_finite.len();
    let found = format!("others for {skipped} of {count}, the first of them Gaussian {first}");
    Err(EngineError::Setting { setting: "weights", expected: "finite outputs of the network".to_owned(), found })
}

/// Scores `[N]` of pruning and of adding for the `LiDAR` branch; `None` when the model has no policy.
///
/// # Errors
/// As [`scores_of`].
pub fn scores(features: &Tensor, set: &GaussianSet, model: &Model) -> Result<Option<[Vec<f32>; 2]>> {
    let Some(policy) = &model.policy else { return Ok(None) };
    scores_of(features, set, policy, &model.config).map(Some)
}

/// Scores `[N]` of pruning and of adding for the `LiDAR` branch of a scene as predicted.
///
/// # Shapes
/// `features` `[N, width]` decoder features, after the query.
///
/// # Errors
/// When a position leaves the voxel grid, or the voxels span more than the curves' bits.
pub fn scores_of(features: &Tensor, set: &GaussianSet, policy: &Policy, config: &ModelConfig) -> Result<[Vec<f32>; 2]> {
    let chosen: Vec<usize> = (0..set.num_lidar).collect();
    let Some(inputs) = PolicyInputs::new(features, set, &chosen, config)? else { return Ok([Vec::new(), Vec::new()]) };
    let found = policy.scores(&inputs.rows, &inputs.geometry, false)?;
    Ok(with_values([&found], |[found]| {
        let score = |k: usize| inputs.points.segment_of().iter().map(|&site| found[2 * site as usize + k]).collect();
        Ok([score(0), score(1)])
    })?)
}

/// What the policy is given of some primitives.
#[derive(Debug)]
pub struct PolicyInputs {
    /// `[M, width + EXTRA_INPUTS]` by voxel.
    pub rows: Tensor,
    /// The voxels.
    pub geometry: Geometry,
    /// The voxel of every primitive.
    pub points: Arc<Segments>,
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
    pub fn new(features: &Tensor, set: &GaussianSet, chosen: &[usize], config: &ModelConfig) -> Result<Option<Self>> {
        let Some(policy) = config.policy.as_ref().filter(|_| !chosen.is_empty()) else { return Ok(None) };
        let voxels = voxels_of(chosen.iter().map(|&i| set.mean(i)), config.voxel_size)?;
        let levels = Levels::new(&voxels, policy.encoder.len())?;
        let maps: Vec<_> = levels.levels.iter().map(|level| level.submanifold.clone()).collect();
        let geometry = Geometry::new(&levels.sites, &maps, policy)?;
        let (width, states) = (config.unet.width(), initial_rows(set, chosen));
        let mut rows = vec![0.0; chosen.len() * (width + EXTRA_INPUTS)];
        with_values([features], |[features]| {
            let parts = chosen.iter().zip(states.chunks_exact(INITIAL_INPUTS)).zip(levels.points.segment_of());
            for (row, ((&i, state), &site)) in rows.chunks_exact_mut(width + EXTRA_INPUTS).zip(parts) {
                row[..width].copy_from_slice(&features[i * width..][..width]);
                row[width..width + NUM_ATTRIBUTES].copy_from_slice(&state[..NUM_ATTRIBUTES]);
                row[width + NUM_ATTRIBUTES] = (levels.points.members(site as usize).len() as f32).ln_1p();
            }
            Ok(())
        })?;
        let rows = mean_pool(&of_rows(rows, width + EXTRA_INPUTS)?, &levels.points)?;
        Ok(Some(Self { rows, geometry, points: levels.points }))
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
