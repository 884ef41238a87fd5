//! One whole prediction, from the parameters to the loss of a rendered view, against finite differences.

use std::collections::HashMap;
use std::sync::Arc;

use candle_core::{DType, Tensor, Var};
use candle_nn::VarBuilder;
use candle_nn::var_builder::SimpleBackend;
use lgs_engine::gaussians::GaussianSet;
use lgs_engine::loss::LossWeights;
use lgs_engine::network::heads::{HeadSizes, Outputs};
use lgs_engine::network::levels::{Levels, voxels_of};
use lgs_engine::network::normalise::{INITIAL_INPUTS, LeftOut, initial_rows, residual_gradients};
use lgs_engine::network::pass::Pass;
use lgs_engine::network::query::Query;
use lgs_engine::network::unet::UNetConfig;
use lgs_engine::network::weights::{RandomWeights, Recorder};
use lgs_engine::objective::objective;
use lgs_engine::ops::DEVICE;
use lgs_engine::ops::knn::nearest_other_time;
use lgs_engine::ops::tensors::of_rows;
use lgs_engine::predict::add_outputs;
use lgs_engine::views::View;
use lgs_tests::random::Random;
use lgs_tests::slopes::Slopes;
use lgs_tests::{Outcome, case};
use libtest_mimic::{Failed, Trial};

use super::scene::{scene, view};

const VOXEL: f64 = 0.5;
/// Directions along which the loss is followed.
const DIRECTIONS: usize = 6;
/// Relative.
const TOLERANCE: f64 = 0.02;

pub(crate) fn cases() -> Vec<Trial> {
    vec![case("network::gradient_of_the_whole_path_is_the_finite_difference", whole_path)]
}

/// The view at four times its size: where a Gaussian reaches another pixel the loss jumps, and no gradient knows of jumps; they are
/// the smaller the more pixels a Gaussian has.
fn enlarged(mut view: View, random: &mut Random) -> View {
    const FACTOR: usize = 4;
    let (width, height) = (FACTOR * view.image.width, FACTOR * view.image.height);
    view.image.data = (0..width * height * 3).map(|_| random.uniform_single(0.0, 1.0)).collect();
    (view.image.width, view.image.height) = (width, height);
    (view.pinhole.width, view.pinhole.height) = (width, height);
    for length in [&mut view.pinhole.fx, &mut view.pinhole.fy, &mut view.pinhole.cx, &mut view.pinhole.cy] {
        *length *= FACTOR as f32;
    }
    view
}

struct Path {
    variables: Vec<(String, Var)>,
    pass: Pass,
    query: Query,
    scene: GaussianSet,
    levels: Levels,
    neighbours: Arc<Vec<u32>>,
    view: View,
}

fn failed(error: impl std::fmt::Display) -> Failed {
    error.to_string().into()
}

impl Path {
    fn new() -> Result<Self, Failed> {
        let config = UNetConfig { stem: 8, encoder: vec![8, 12], decoder: vec![12, 8] };
        let build = |vb: &VarBuilder<'_>| {
            let heads = HeadSizes {
                features: config.width(),
                point_inputs: INITIAL_INPUTS,
                hidden: None,
                outputs: Outputs::Moving,
            };
            let pass = Pass::new(INITIAL_INPUTS, &config, &heads, &vb.pp("pass"))?;
            candle_core::Result::Ok((pass, Query::new(config.width(), &vb.pp("query"))?))
        };
        let specs = Recorder::list(build).map_err(failed)?;
        let mut random = Random::new(7);
        let mut variables = Vec::new();
        for spec in &specs {
            let seeded = RandomWeights { seed: 5 };
            let shape = spec.shape.clone().into();
            let drawn = seeded.get(shape, &spec.name, spec.init, DType::F32, &DEVICE).map_err(failed)?;
            // Heads and query start at zero, where their inputs have no gradient.
            let start = if spec.name.contains("heads") || spec.name.contains("query") {
                let values: Vec<f32> = (0..spec.len()).map(|_| 0.03 * random.normal_single()).collect();
                Tensor::from_vec(values, spec.shape.clone(), &DEVICE).map_err(failed)?
            } else {
                drawn
            };
            variables.push((spec.name.clone(), Var::from_tensor(&start).map_err(failed)?));
        }
        let tensors: HashMap<String, Tensor> =
            variables.iter().map(|(name, var)| (name.clone(), var.as_tensor().clone())).collect();
        let (pass, query) = build(&VarBuilder::from_tensors(tensors, DType::F32, &DEVICE)).map_err(failed)?;
        let scene = scene(&mut random);
        let points: Vec<[f32; 3]> = scene.attributes.iter().map(|a| [a[0], a[1], a[2]]).collect();
        let voxels = voxels_of(points.iter().copied(), VOXEL).map_err(failed)?;
        let levels = Levels::new(&voxels, config.num_levels()).map_err(failed)?;
        let neighbours = Arc::new(nearest_other_time(&points, &scene.frames, 8).map_err(failed)?.indices);
        let view = enlarged(view(&mut random), &mut random);
        variables.retain(|(name, _)| !name.contains("running"));
        Ok(Self { variables, pass, query, scene, levels, neighbours, view })
    }

    /// The loss as training computes it, carried back as training does it: as a scalar with that gradient.
    fn loss(&self) -> candle_core::Result<Tensor> {
        let all: Vec<usize> = (0..self.scene.len()).collect();
        let rows = of_rows(initial_rows(&self.scene, &all), INITIAL_INPUTS)?;
        let features = self.pass.features(&rows, &self.levels, true)?;
        let fused = self.query.forward(features, &self.neighbours, 8)?;
        let outputs = self.pass.heads().forward(&fused, &rows)?;
        let mut predicted = self.scene.clone();
        let spoilt = add_outputs(&mut predicted, &all, &outputs).map_err(candle_core::Error::wrap)?;
        if spoilt != LeftOut::default() {
            candle_core::bail!("expected outputs for all Gaussians, found {spoilt:?}");
        }
        let found = objective(&predicted, &[&self.view], &LossWeights::default());
        let width = outputs.dim(1)?;
        let v_outputs = of_rows(residual_gradients(&self.scene, &all, &found.gradient, width), width)?;
        let carried = (outputs * v_outputs)?.sum_all()?;
        let loss = Tensor::new(found.loss, &DEVICE)?.to_dtype(DType::F32)?;
        loss + (&carried - carried.detach())?
    }
}

fn whole_path() -> Outcome {
    let path = Path::new()?;
    let slopes = Slopes { directions: DIRECTIONS, tolerance: TOLERANCE, change: 3e-5, seed: 11 };
    slopes.check(&path.variables, &|| path.loss())
}
