//! Layers and whole networks under values, sizes and weights at their ends.

use std::sync::Arc;

use candle_core::{Device, Tensor, Var};
use lgs_engine::gaussians::{LOG_SCALE, LOGIT_COLOUR, LOGIT_OPACITY, MEAN};
use lgs_engine::network::levels::{Levels, voxels_of};
use lgs_engine::ops::attention::{Patches, attention};
use lgs_engine::ops::norm::{batch_norm, layer_norm};
use lgs_engine::ops::segment::mean_pool;
use lgs_engine::ops::serialization::{Curve, codes, depth_of, order};
use lgs_engine::ops::sparse_conv::Sites;
use lgs_engine::predict::{backbone, predict, query, scores};
use lgs_engine::refine::refine;
use lgs_tests::Outcome;
use lgs_tests::compare::{close, relative, widened};
use lgs_tests::weights::{Heads, SMALL, Weights};

use super::gradients::by_residuals;
use super::tiny::{noise, set_of, sphere};
use super::{Extreme, all_finite, ensure, failed};

pub(super) const CASES: &[Extreme] = &[
    Extreme::new("attention_logits_1e4", "queries and keys whose products are +-1e4", "finite rows within the values' range: the largest logit is taken off first", attention_logits),
    Extreme::new("attention_of_one_point", "patches of one point", "the point's own value (1e-6)", attention_of_one),
    Extreme::new("constant_rows_into_layer_norm", "rows of one value: 0, 1e-30, 1, 1e18", "the bias exactly, finite gradients: the variance is 0 and eps keeps the root", constant_layer_norm),
    Extreme::new("constant_columns_into_batch_norm", "columns of one value: 0, 1e-30, 1, 1e30", "the bias exactly, finite gradients", constant_batch_norm),
    Extreme::new("one_row_into_batch_norm", "a batch of one row", "the bias, finite gradients", one_row_batch_norm),
    Extreme::new("a_voxel_of_1e5_points", "10^5 points in one voxel", "their mean to the last bit of f32: sums are f64", full_voxel),
    Extreme::new("a_million_values_of_1e30_in_a_voxel", "10^6 values of 1e30 in one voxel", "1e30, not infinity", huge_voxel),
    Extreme::new("levels_of_one_site", "a scene of one Gaussian through every level of the U-Net", "finite features and scores", one_site),
    Extreme::new("no_gaussians", "a scene without LiDAR Gaussians", "nothing, and no error", no_gaussians),
    Extreme::new("curve_at_its_last_bit", "voxel coordinates of 2^16 - 1", "codes of 48 bits, in order", curve_end),
    Extreme::new("curve_beyond_its_bits", "a voxel coordinate of 2^16, and a negative one", "an error that names the row and the bounds, not a wrap", beyond_curve),
    Extreme::new("sites_at_the_ends_of_the_grid", "voxels at +-(2^17 - 9) and beyond", "sites; beyond them an error that names the row", grid_ends),
    Extreme::new("positions_of_1e30", "positions of +-1e30 m, and NaN", "an error that names the row: the cast saturates", || far_positions(&[1e30, -1e30, f32::NAN])),
    Extreme::new("channels_of_zeros", "a scene whose every input but the place is zero", "finite features", zero_channels),
    Extreme::new("weights_of_f16_maximum", "every convolution weight at 65504", "finite predictions or an error that names --weights", f16_weights)
        .mended("outputs that overflow went into the scene and showed as NaN in the export, after all the work: now the prediction says so"),
    Extreme::new("outputs_of_1e38", "heads whose outputs overflow", "an error that names --weights, the scene unspoilt", overflowing_heads)
        .mended("as for weights of f16 maximum"),
    Extreme::new("outputs_of_1e38_in_a_refinement", "a refinement whose outputs overflow for all Gaussians", "all left as they are, counted, the loop ended", || overflowing_refinement(SMALL))
        .mended("infinities went into the scene, where they vanish from the image, which can lower the loss, and the step was kept: now such Gaussians stay as they were and are counted"),
    Extreme::new("outputs_of_1e38_in_a_refinement_by_residuals", "the same guided by residuals, with hidden heads", "all left as they are, counted, the loop ended", || overflowing_refinement(&by_residuals()))
        .mended("as for the one above"),
    Extreme::new("heads_of_extreme_states", "states of 1e5 m, log-scales of +-80, logits of +-200 into hidden heads", "finite outputs", extreme_states),
];

fn tensor(values: Vec<f32>, rows: usize) -> Result<Tensor, libtest_mimic::Failed> {
    let width = values.len() / rows;
    Tensor::from_vec(values, (rows, width), &Device::Cpu).map_err(failed)
}

fn values(tensor: &Tensor) -> Result<Vec<f32>, libtest_mimic::Failed> {
    tensor.flatten_all().and_then(|t| t.to_vec1::<f32>()).map_err(failed)
}

fn patches(count: usize, size: usize) -> Result<Arc<Patches>, libtest_mimic::Failed> {
    let along = order(&(0..count as u64).collect::<Vec<u64>>());
    Ok(Arc::new(Patches::new(along, &[count], size).map_err(failed)?))
}

fn attention_logits() -> Outcome {
    let row = |i: usize| {
        let side = if i.is_multiple_of(2) { 120.0 } else { -120.0 };
        [[side; 4], [if i.is_multiple_of(3) { 120.0 } else { -120.0 }; 4], [i as f32 - 6.0; 4]].concat()
    };
    let qkv = tensor((0..12).flat_map(row).collect(), 12)?;
    let out = values(&attention(&qkv, 1, &patches(12, 12)?).map_err(failed)?)?;
    ensure(out.iter().all(|v| (-6.0..=6.0).contains(v)), || format!("{out:?}"))
}

fn attention_of_one() -> Outcome {
    let qkv = tensor((0..3 * 12).map(|k| k as f32 * 1e3).collect(), 3)?;
    let out = values(&attention(&qkv, 2, &patches(3, 1)?).map_err(failed)?)?;
    let want: Vec<f32> = (0..3).flat_map(|i| (8..12).map(move |k| (12 * i + k) as f32 * 1e3)).collect();
    close("values", &widened(&out), &widened(&want), relative(1e-6, 0.0))
}

type Norm = fn(&Tensor, &Tensor, &Tensor) -> candle_core::Result<Tensor>;

/// The norm of rows with a bias of 0.5, which must come out, and its gradient, which must be finite.
fn gives_the_bias(x: Tensor, norm: Norm) -> Outcome {
    let width = x.dim(1).map_err(failed)?;
    let x = Var::from_tensor(&x).map_err(failed)?;
    let [weight, bias] = [2.0, 0.5].map(|v: f32| Tensor::from_vec(vec![v; width], width, &Device::Cpu));
    let out = norm(&x, &weight.map_err(failed)?, &bias.map_err(failed)?).map_err(failed)?;
    let found = values(&out)?;
    ensure(found.iter().all(|v| *v == 0.5), || format!("{found:?}"))?;
    let gradients = out.sum_all().and_then(|s| s.backward()).map_err(failed)?;
    all_finite("gradient", values(gradients.get(&x).ok_or("no gradient")?)?)
}

fn constant_layer_norm() -> Outcome {
    let rows = [0.0, 1e-30, 1.0, 1e18].map(|v| [v; 16]);
    gives_the_bias(tensor(rows.concat(), 4)?, |x, w, b| layer_norm(x, w, b, 1e-5))
}

fn constant_batch_norm() -> Outcome {
    let row = [0.0, 1e-30, 1.0, 1e30];
    gives_the_bias(tensor(row.repeat(64), 64)?, |x, w, b| Ok(batch_norm(x, w, b, 1e-5)?.0))
}

fn one_row_batch_norm() -> Outcome {
    gives_the_bias(tensor(vec![-1e20, 0.0, 3.0], 1)?, |x, w, b| Ok(batch_norm(x, w, b, 1e-5)?.0))
}

fn voxel_mean(count: usize, value: impl Fn(usize) -> f32) -> Result<Vec<f32>, libtest_mimic::Failed> {
    let voxels = voxels_of((0..count).map(|_| [0.05; 3]), 0.1).map_err(failed)?;
    let levels = Levels::new(&voxels, 3).map_err(failed)?;
    ensure(levels.sites.len() == 1, || format!("{} sites", levels.sites.len()))?;
    values(&mean_pool(&tensor((0..count).map(value).collect(), count)?, &levels.points).map_err(failed)?)
}

fn full_voxel() -> Outcome {
    let mean = voxel_mean(100_000, |i| 0.1 + (i % 2) as f32 * 0.2)?;
    let want = f64::midpoint(f64::from(0.1_f32), f64::from(0.1_f32 + 0.2));
    ensure((f64::from(mean[0]) - want).abs() < 1e-8, || format!("{mean:?}, want {want}"))
}

fn huge_voxel() -> Outcome {
    let mean = voxel_mean(1_000_000, |_| 1e30)?;
    ensure(mean == [1e30], || format!("{mean:?}"))
}

fn one_site() -> Outcome {
    let model = Weights::seeded(SMALL, 2, Heads { residuals: 0.1, scores: 0.5 })?.model()?;
    let mut set = set_of(vec![sphere()], 1);
    let mut features = backbone(&set, &model).map_err(failed)?;
    query(&mut features, &set, &model).map_err(failed)?;
    predict(&mut set, &features, &model).map_err(failed)?;
    all_finite("features", values(&features)?)?;
    let found = scores(&features, &set, &model).map_err(failed)?.ok_or("no policy")?;
    all_finite("scores", found.concat())
}

fn no_gaussians() -> Outcome {
    let model = Weights::seeded(SMALL, 2, Heads { residuals: 0.1, scores: 0.5 })?.model()?;
    let mut set = set_of(Vec::new(), 0);
    let mut features = backbone(&set, &model).map_err(failed)?;
    query(&mut features, &set, &model).map_err(failed)?;
    predict(&mut set, &features, &model).map_err(failed)?;
    let found = scores(&features, &set, &model).map_err(failed)?.ok_or("no policy")?;
    ensure(found.concat().is_empty() && set.is_empty(), || format!("{found:?}"))
}

const CURVES: [Curve; 4] = [Curve::Z, Curve::ZTransposed, Curve::Hilbert, Curve::HilbertTransposed];

fn curve_end() -> Outcome {
    let end = (1 << 16) - 1;
    let coords = [[0, 0, 0, 0], [0, end, end, end], [0, end, 0, 0]];
    let depth = depth_of(&coords).map_err(failed)?;
    for curve in CURVES {
        let codes = codes(&coords, curve, depth).map_err(failed)?;
        let distinct = codes[0] != codes[1] && codes[1] != codes[2] && codes[0] != codes[2];
        ensure(depth == 16 && distinct && codes.iter().all(|&code| code < 1 << 48), || format!("{curve:?} {codes:?}"))?;
    }
    Ok(())
}

fn beyond_curve() -> Outcome {
    for beyond in [1 << 16, i32::MAX, -1, i32::MIN] {
        let coords = [[0, 1, 2, 3], [0, 0, beyond, 0]];
        let said = depth_of(&coords).map_err(|e| e.to_string()).err().unwrap_or_default();
        ensure(said.contains("row 1") && said.contains("2^16"), || format!("{beyond}: {said:?}"))?;
        for curve in CURVES {
            ensure(codes(&coords, curve, 16).is_err(), || format!("{beyond} has a code along {curve:?}"))?;
        }
    }
    Ok(())
}

fn grid_ends() -> Outcome {
    let end = (1 << 17) - 9;
    let (sites, _) = Sites::unique(&[[0, end, -end, end], [0, -end, end, 0]]).map_err(failed)?;
    ensure(sites.len() == 2, || format!("{} sites", sites.len()))?;
    for beyond in [end + 1, -end - 2, i32::MAX, i32::MIN] {
        let said = Sites::unique(&[[0; 4], [0, 0, 0, beyond]]).map_err(|e| e.to_string()).err().unwrap_or_default();
        ensure(said.contains("row 1") && said.contains("expected"), || format!("{beyond}: {said:?}"))?;
    }
    Ok(())
}

fn far_positions(values: &[f32]) -> Outcome {
    for &value in values {
        let place = [[0.0; 3], [0.0, value, 0.0]];
        let levels = voxels_of(place.into_iter(), 0.1).and_then(|voxels| Levels::new(&voxels, 2));
        let said = levels.map(drop).map_err(|e| e.to_string()).err().unwrap_or_default();
        ensure(said.contains("row 1") || said.contains("position of Gaussian 1"), || format!("{value}: {said:?}"))?;
    }
    Ok(())
}

fn zero_channels() -> Outcome {
    let model = Weights::seeded(SMALL, 2, Heads { residuals: 0.1, scores: 0.5 })?.model()?;
    let (mut set, _) = noise(50, 3);
    for row in &mut set.attributes {
        row[MEAN.end..].fill(0.0);
    }
    set.times.fill(0.0);
    all_finite("features", values(&backbone(&set, &model).map_err(failed)?)?)
}

/// What the whole prediction says: finite scenes are as good as a named refusal.
fn finite_or_named(weights: &Weights) -> Outcome {
    let model = weights.model()?;
    let (mut set, _) = noise(80, 3);
    let mut features = backbone(&set, &model).map_err(failed)?;
    query(&mut features, &set, &model).map_err(failed)?;
    let said = predict(&mut set, &features, &model).map_err(|e| e.to_string());
    set.check_finite().map_err(failed)?;
    match said {
        Ok(()) => Ok(()),
        Err(said) => ensure(said.contains("weights: expected finite outputs"), || said),
    }
}

fn f16_weights() -> Outcome {
    let mut weights = Weights::seeded(SMALL, 2, Heads { residuals: 0.1, scores: 0.5 })?;
    for (name, tensor) in &mut weights.tensors {
        if name.ends_with("weight") && tensor.rank() > 1 {
            *tensor = (tensor.ones_like().map_err(failed)? * 65504.0).map_err(failed)?;
        }
    }
    finite_or_named(&weights)
}

fn overflowing_heads() -> Outcome {
    let weights = Weights::seeded(SMALL, 2, Heads { residuals: 3e38, scores: 0.5 })?;
    finite_or_named(&weights)
}

fn overflowing_refinement(config: &str) -> Outcome {
    let weights = Weights::seeded(config, 2, Heads { residuals: 3e38, scores: 0.5 })?;
    let (start, view) = noise(80, 3);
    let mut set = start.clone();
    let summary = refine(&mut set, &[&view], &weights.model()?, 3, || ()).map_err(failed)?;
    set.check_finite().map_err(failed)?;
    let seen = start.len() - summary.unseen;
    let counted = summary.non_finite_outputs > 0 && summary.non_finite_outputs <= 3 * seen;
    ensure(counted && (summary.steps > 0 || set == start), || format!("{summary:?}"))
}

fn extreme_states() -> Outcome {
    let model = Weights::seeded(&by_residuals(), 2, Heads { residuals: 0.1, scores: 0.5 })?.model()?;
    let (mut set, _) = noise(60, 3);
    for (k, row) in set.attributes.iter_mut().enumerate() {
        row[MEAN.start] = if k % 3 == 0 { 2.6e4 } else { row[0] };
        row[LOG_SCALE].fill([80.0, -80.0][k % 2]);
        row[LOGIT_OPACITY] = [200.0, -200.0][k % 2];
        row[LOGIT_COLOUR].fill([-200.0, 200.0][k % 2]);
    }
    let features = backbone(&set, &model).map_err(failed)?;
    all_finite("features", values(&features)?)?;
    predict(&mut set, &features, &model).map_err(failed)?;
    set.check_finite().map_err(failed)
}
