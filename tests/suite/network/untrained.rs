//! A network whose heads are still zero changes nothing.

use candle_core::Tensor;
use lgs_engine::gaussians::{GaussianSet, MEAN, QUAT};
use lgs_engine::network::config::{Guidance, MODEL_FORMAT, ModelConfig, QueryConfig, StepLength};
use lgs_engine::network::model::Model;
use lgs_engine::network::unet::UNetConfig;
use lgs_engine::predict::{QuerySkipped, backbone, predict, query};
use lgs_tests::random::Random;
use lgs_tests::{Outcome, case};
use libtest_mimic::Trial;

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("network::zero_heads_change_nothing", zero_heads_change_nothing),
        case("network::a_single_timestamp_asks_nobody", a_single_timestamp_asks_nobody),
        case("network::same_bits_for_any_number_of_threads", same_bits),
    ]
}

fn model() -> Result<Model, String> {
    let unet = UNetConfig { stem: 8, encoder: vec![8, 16], decoder: vec![16, 8] };
    let config = ModelConfig {
        format: MODEL_FORMAT.to_owned(),
        name: "test".to_owned(),
        voxel_size: 0.2,
        background_voxel_size: 1.0,
        guidance: Guidance::default(),
        step_length: StepLength::default(),
        head_width: None,
        unet: unet.clone(),
        background_unet: unet,
        query: Some(QueryConfig { neighbours: 8 }),
        policy: None,
    };
    Model::random(&config, 3).map_err(|e| e.to_string())
}

fn rows(features: &Tensor) -> Result<Vec<f32>, String> {
    features.flatten_all().and_then(|t| t.to_vec1()).map_err(|e| e.to_string())
}

fn scene(num_frames: usize) -> GaussianSet {
    let mut random = Random::new(2);
    let mut set = GaussianSet::default();
    for i in 0..1500 {
        let mut row = [0.0_f32; 14].map(|_: f32| random.normal_single());
        row[MEAN].copy_from_slice(&[0.0; 3].map(|_: f32| random.uniform_single(-4.0, 4.0)));
        row[QUAT.start] = 1.0;
        set.attributes.push(row);
        set.times.push([0.0, 0.1, 0.2][i % num_frames]);
        set.frames.push([0, 1, 2][i % num_frames]);
        set.velocities.push([0.0; 3]);
    }
    set.num_lidar = 1200;
    set
}

fn zero_heads_change_nothing() -> Outcome {
    let (model, start) = (model()?, scene(3));
    let mut set = start.clone();
    let mut features = backbone(&set, &model).map_err(|e| e.to_string())?;
    let before = rows(&features)?;
    let skipped = query(&mut features, &set, &model).map_err(|e| e.to_string())?;
    predict(&mut set, &features, &model).map_err(|e| e.to_string())?;
    if skipped.is_some() || before != rows(&features)? {
        return Err(format!("the query's projection is zero: skipped {skipped:?}").into());
    }
    if set != start { Err("the scene changed".into()) } else { Ok(()) }
}

fn a_single_timestamp_asks_nobody() -> Outcome {
    let (model, set) = (model()?, scene(1));
    let mut features = backbone(&set, &model).map_err(|e| e.to_string())?;
    match query(&mut features, &set, &model).map_err(|e| e.to_string())? {
        Some(QuerySkipped::SingleTimestamp) => Ok(()),
        other => Err(format!("expected a skipped query, found {other:?}").into()),
    }
}

fn same_bits() -> Outcome {
    let (model, set) = (model()?, scene(3));
    let run = |threads: usize| -> Result<Vec<u32>, String> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().map_err(|e| e.to_string())?;
        let features = pool.install(|| backbone(&set, &model)).map_err(|e| e.to_string())?;
        Ok(rows(&features)?.iter().map(|v| v.to_bits()).collect())
    };
    let one = run(1)?;
    for threads in [2, 3] {
        if run(threads)? != one {
            return Err(format!("{threads} threads give other bits than 1").into());
        }
    }
    Ok(())
}
