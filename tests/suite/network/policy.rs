//! The densify policy: folded it is the same on any cloud, its gradient is the slope, threads do not matter.

use std::collections::HashMap;

use candle_core::{DType, Tensor, Var};
use candle_nn::var_builder::SimpleBackend;
use candle_nn::{Init, VarBuilder};
use lgs_engine::network::policy::{Cycle, Geometry, Policy, PolicyConfig, StageConfig};
use lgs_engine::network::weights::{RandomWeights, Recorder, TensorSpec};
use lgs_engine::ops::DEVICE;
use lgs_engine::ops::serialization::Curve;
use lgs_engine::ops::sparse_conv::Sites;
use lgs_tests::compare::same_bits;
use lgs_tests::random::Random;
use lgs_tests::slopes::Slopes;
use lgs_tests::{Outcome, case};
use libtest_mimic::{Failed, Trial};

const INPUTS: usize = 7;
const PATCH: usize = 16;

/// A cloud by its blobs: the centre of each, its reach and how many voxels are drawn in it.
struct Cloud {
    name: &'static str,
    blobs: &'static [([i32; 3], f64, usize)],
}

const CLOUDS: [Cloud; 6] = [
    Cloud { name: "one_point", blobs: &[([5, -3, 2], 0.0, 1)] },
    Cloud { name: "two_far_points", blobs: &[([-4000, 0, 1], 0.0, 1), ([4000, 9000, -7], 0.0, 1)] },
    Cloud { name: "fewer_than_a_patch", blobs: &[([0, 0, 0], 2.0, 6)] },
    Cloud { name: "one_patch_and_a_bit", blobs: &[([3, 1, 0], 4.0, PATCH + 3)] },
    Cloud { name: "patches_that_do_not_divide", blobs: &[([-7, 2, 1], 8.0, 9 * PATCH + 5)] },
    Cloud {
        name: "several_blobs",
        blobs: &[([0, 0, 0], 6.0, 300), ([-500, 130, 4], 9.0, 400), ([77, -60, -9], 3.0, 90), ([900, 900, 0], 1.0, 5)],
    },
];

pub(crate) fn cases() -> Vec<Trial> {
    let folded = CLOUDS.iter().flat_map(|cloud| {
        [Cycle::Restart, Cycle::Continue].map(|cycle| {
            let name = format!("network::policy::folded_is_trained::{}::{cycle:?}", cloud.name);
            case(name.to_lowercase(), move || folded_is_trained(cloud, cycle))
        })
    });
    let others = [
        case("network::policy::gradient_is_the_finite_difference", gradient_is_the_slope),
        case("network::policy::same_bits_for_any_number_of_threads", same_for_any_threads),
        case("network::policy::order_of_the_points_does_not_matter", order_does_not_matter),
    ];
    folded.chain(others).collect()
}

fn failed(error: impl std::fmt::Display) -> Failed {
    error.to_string().into()
}

fn config(cycle: Cycle) -> PolicyConfig {
    let stage = |channels, heads, blocks| StageConfig { channels, heads, blocks };
    PolicyConfig {
        encoder: vec![stage(8, 2, 2), stage(12, 3, 1), stage(16, 2, 1)],
        decoder: vec![stage(8, 1, 1), stage(12, 2, 2)],
        patch: PATCH,
        mlp_ratio: 2,
        curves: vec![Curve::Z, Curve::ZTransposed, Curve::Hilbert, Curve::HilbertTransposed],
        cycle,
        head_blocks: 2,
        head_width: 8,
    }
}

/// Weights of which none is at its start: running statistics, normalisation and heads too.
fn variables(config: &PolicyConfig) -> Result<Vec<(String, Var)>, Failed> {
    let specs = Recorder::list(|vb| Policy::new(INPUTS, config, vb)).map_err(failed)?;
    let mut random = Random::new(3);
    let mut draw = |spec: &TensorSpec| -> Result<Tensor, Failed> {
        let uniform = |random: &mut Random, low, high| -> Vec<f32> {
            (0..spec.len()).map(|_| random.uniform_single(low, high)).collect()
        };
        let values = match spec.init {
            Init::Const(1.0) => uniform(&mut random, 0.5, 1.5),
            Init::Const(_) => uniform(&mut random, -0.4, 0.4),
            init => {
                let shape = spec.shape.clone().into();
                return RandomWeights { seed: 8 }.get(shape, &spec.name, init, DType::F32, &DEVICE).map_err(failed);
            }
        };
        Tensor::from_vec(values, spec.shape.clone(), &DEVICE).map_err(failed)
    };
    specs.iter().map(|spec| Ok((spec.name.clone(), Var::from_tensor(&draw(spec)?).map_err(failed)?))).collect()
}

fn policy(config: &PolicyConfig, variables: &[(String, Var)]) -> Result<Policy, Failed> {
    let tensors: HashMap<String, Tensor> = variables.iter().map(|(n, v)| (n.clone(), v.as_tensor().clone())).collect();
    Policy::new(INPUTS, config, &VarBuilder::from_tensors(tensors, DType::F32, &DEVICE)).map_err(failed)
}

/// The voxels of a cloud, in the order of their draw.
#[expect(clippy::cast_possible_truncation, reason = "small offsets")]
fn voxels(cloud: &Cloud) -> Vec<[i32; 4]> {
    let mut random = Random::new(5);
    let mut all = std::collections::BTreeSet::new();
    for &(centre, reach, count) in cloud.blobs {
        let want = all.len() + count;
        while all.len() < want {
            let [x, y, z] = centre.map(|c| c + random.uniform(-reach, reach + 1e-9).round() as i32);
            all.insert([0, x, y, z]);
        }
    }
    all.into_iter().collect()
}

/// Features of every voxel, which depend on where it is and not on its place in a list.
fn features(sites: &Sites) -> Vec<f32> {
    let feature = |&[_, x, y, z]: &[i32; 4]| {
        let seed =
            [x, y, z].into_iter().fold(17_u64, |seed, c| seed.wrapping_mul(1_000_003) ^ u64::from(c.cast_unsigned()));
        let mut random = Random::new(seed);
        (0..INPUTS).map(|_| random.normal_single()).collect::<Vec<_>>()
    };
    sites.coords().iter().flat_map(feature).collect()
}

/// A cloud as the policy reads it.
struct Input {
    geometry: Geometry,
    features: Tensor,
}

impl Input {
    fn new(voxels: &[[i32; 4]], config: &PolicyConfig) -> Result<Self, Failed> {
        let (sites, _) = Sites::unique(voxels).map_err(failed)?;
        let features = Tensor::from_vec(features(&sites), (sites.len(), INPUTS), &DEVICE).map_err(failed)?;
        Ok(Self { geometry: Geometry::new(&sites, &[], config).map_err(failed)?, features })
    }
}

fn folded_is_trained(cloud: &Cloud, cycle: Cycle) -> Outcome {
    let config = config(cycle);
    let policy = policy(&config, &variables(&config)?)?;
    let input = Input::new(&voxels(cloud), &config)?;
    // Batch statistics first, so that the running ones are not those of the draw.
    policy.scores(&input.features, &input.geometry, true).map_err(failed)?;
    let trained = scores(&policy, &input)?;
    let folded = scores(&policy.fold().map_err(failed)?, &input)?;
    if cloud.blobs.len() > 1 && trained.iter().all(|score| (score - trained[0]).abs() < 1e-4) {
        return Err("the scores do not differ: nothing is compared".into());
    }
    same_bits("scores", &folded, &trained)
}

/// Scores by running statistics, voxel after voxel.
fn scores(policy: &Policy, input: &Input) -> Result<Vec<f32>, Failed> {
    let scores = policy.scores(&input.features, &input.geometry, false).map_err(failed)?;
    scores.flatten_all().and_then(|t| t.to_vec1()).map_err(failed)
}

fn gradient_is_the_slope() -> Outcome {
    let config = config(Cycle::Continue);
    let mut variables = variables(&config)?;
    let policy = policy(&config, &variables)?;
    let input = Input::new(&voxels(&CLOUDS[4]), &config)?;
    let mut random = Random::new(21);
    let num_rows = input.features.dim(0).map_err(failed)?;
    let weights: Vec<f32> = (0..2 * num_rows).map(|_| random.normal_single()).collect();
    let weights = Tensor::from_vec(weights, (num_rows, 2), &DEVICE).map_err(failed)?;
    let features = Var::from_tensor(&input.features).map_err(failed)?;
    variables.retain(|(name, _)| !name.contains("running"));
    variables.push(("features".to_owned(), features.clone()));
    let loss = || (policy.scores(&features, &input.geometry, true)? * &weights)?.sum_all();
    Slopes { directions: 6, tolerance: 0.02, change: 2e-4, seed: 4 }.check(&variables, &loss)
}

/// Scores with batch statistics, their gradient by the input, and folded scores, with so many threads.
fn with_threads(threads: usize) -> Result<[Vec<f32>; 3], Failed> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
    pool.install(|| {
        let config = config(Cycle::Continue);
        let policy = policy(&config, &variables(&config)?)?;
        let input = Input::new(&voxels(&CLOUDS[5]), &config)?;
        let features = Var::from_tensor(&input.features).map_err(failed)?;
        let scores = policy.scores(&features, &input.geometry, true).map_err(failed)?;
        let gradients = scores.sqr().and_then(|s| s.sum_all()).and_then(|l| l.backward()).map_err(failed)?;
        let gradient = gradients.get(&features).ok_or("the features have no gradient")?;
        let values = |t: &Tensor| t.flatten_all().and_then(|t| t.to_vec1::<f32>()).map_err(failed);
        let folded = self::scores(&policy.fold().map_err(failed)?, &input)?;
        Ok([values(&scores)?, values(gradient)?, folded])
    })
}

fn same_for_any_threads() -> Outcome {
    let one = with_threads(1)?;
    for threads in [2, 3] {
        let many = with_threads(threads)?;
        for (what, (many, one)) in ["scores", "gradient", "folded scores"].iter().zip(many.iter().zip(&one)) {
            same_bits(&format!("{what} with {threads} threads"), many, one)?;
        }
    }
    Ok(())
}

fn order_does_not_matter() -> Outcome {
    let config = config(Cycle::Continue);
    let policy = policy(&config, &variables(&config)?)?.fold().map_err(failed)?;
    let voxels = voxels(&CLOUDS[5]);
    let shuffled: Vec<[i32; 4]> = Random::new(2).order(voxels.len()).into_iter().map(|i| voxels[i]).collect();
    let scores =
        |voxels: &[[i32; 4]]| -> Result<Vec<f32>, Failed> { self::scores(&policy, &Input::new(voxels, &config)?) };
    same_bits("scores by site", &scores(&shuffled)?, &scores(&voxels)?)
}
