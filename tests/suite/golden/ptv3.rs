//! Point Transformer V3 against its reference implementation, as training and as inference run it.

use std::collections::BTreeSet;

use candle_core::{DType, Device, Tensor};
use candle_nn::VarBuilder;
use lgs_engine::network::policy::{Geometry, Policy};
use lgs_engine::ops::serialization::{codes, order};
use lgs_tests::compare::{absolute, close};
use lgs_tests::golden::ptv3::{IO, Ptv3Golden, load};
use lgs_tests::golden::{GoldenFile, files};
use lgs_tests::{Outcome, case};
use libtest_mimic::{Failed, Trial};

const TOLERANCE: f64 = 1e-4;

pub(crate) fn cases() -> Vec<Trial> {
    match files("ptv3", "safetensors") {
        Ok(files) => files.iter().filter(|file| file.name.ends_with(IO)).flat_map(cases_of).collect(),
        Err(error) => vec![case("golden::ptv3::files", move || Err(error.into()))],
    }
}

fn cases_of(file: &GoldenFile) -> Vec<Trial> {
    let with = |what: &str, check: fn(&Ptv3Golden) -> Outcome| {
        let path = file.path.clone();
        case(format!("{}::{what}", file.name.trim_end_matches(IO)), move || check(&load(&path)?))
    };
    vec![with("serialization", serialization), with("trained", trained), with("folded", folded)]
}

fn failed(error: impl std::fmt::Display) -> Failed {
    error.to_string().into()
}

/// Codes and orders of the input's voxels, to the bit.
fn serialization(golden: &Ptv3Golden) -> Outcome {
    for &curve in &golden.config.curves {
        let name = serde_json::to_value(curve)?;
        let name = name.as_str().ok_or("a curve without a name")?;
        let got = codes(&golden.voxels, curve, golden.depth).map_err(failed)?;
        same(&format!("ser.code.{name}"), &got, golden)?;
        let rows: Vec<u64> = order(&got).rows.into_iter().map(u64::from).collect();
        same(&format!("ser.order.{name}"), &rows, golden)?;
    }
    Ok(())
}

fn same(name: &str, got: &[u64], golden: &Ptv3Golden) -> Outcome {
    let want = golden.io.integers(name)?;
    if got.len() != want.len() {
        return Err(format!("{name}: {} values, want {}", got.len(), want.len()).into());
    }
    match (0..got.len()).find(|&i| i64::try_from(got[i]) != Ok(want[i])) {
        None => Ok(()),
        Some(i) => Err(format!("{name}[{i}]: got {}, want {}, tolerance 0", got[i], want[i]).into()),
    }
}

/// The network, its input in the order of the sites, and what was compared so far.
struct Run<'a> {
    golden: &'a Ptv3Golden,
    policy: Policy,
    geometry: Geometry,
    features: Vec<f32>,
    compared: BTreeSet<String>,
}

impl<'a> Run<'a> {
    #[expect(clippy::cast_possible_truncation, reason = "the file holds f32 values")]
    fn new(golden: &'a Ptv3Golden) -> Result<Self, Failed> {
        let input = golden.io.get("in.feat")?;
        let width = input.shape[1];
        let vb = VarBuilder::from_tensors(golden.weights.clone(), DType::F32, &Device::Cpu);
        let policy = Policy::new(width, &golden.config, &vb).map_err(failed)?;
        let geometry = Geometry::new(&golden.stages[0], &[], &golden.config).map_err(failed)?;
        let mut features = vec![0.0_f32; input.data.len()];
        for (row, &site) in input.data.chunks_exact(width).zip(&golden.site_of) {
            let slots = &mut features[site as usize * width..][..width];
            slots.iter_mut().zip(row).for_each(|(slot, &v)| *slot = v as f32);
        }
        Ok(Self { golden, policy, geometry, features, compared: BTreeSet::new() })
    }

    /// Compares all that a policy makes on the way of what `expected` names, and its result.
    fn check(mut self, policy: &Policy, expected: fn(&str) -> bool) -> Outcome {
        let width = self.features.len() / self.golden.voxels.len();
        let shape = (self.golden.voxels.len(), width);
        let x = Tensor::from_vec(self.features.clone(), shape, &Device::Cpu).map_err(failed)?;
        let geometry = self.geometry.clone();
        let values = |t: &Tensor| t.flatten_all().and_then(|t| t.to_vec1::<f32>());
        let mut outcome = Ok(());
        let mut observer = |name: &str, features: &Tensor| {
            let got = values(features)?;
            if outcome.is_ok() {
                outcome = self.compare(name, &got);
            }
            Ok(())
        };
        let result = policy.features(&x, &geometry, false, Some(&mut observer)).map_err(failed)?;
        outcome?;
        self.finish(&values(&result).map_err(failed)?, expected)
    }

    /// Compares what a stage made, if the golden has it.
    fn compare(&mut self, name: &str, got: &[f32]) -> Outcome {
        let key = format!("act.{name}");
        let Ok(want) = self.golden.io.get(&key) else { return Ok(()) };
        let stage = stage_of(name)?;
        let width = want.shape[1];
        if got.len() != want.data.len() {
            return Err(format!("{key}: {} values, want {}", got.len(), want.data.len()).into());
        }
        let rows = self.golden.sites_of_rows(name, stage)?;
        let sorted: Vec<f64> =
            rows.iter().flat_map(|&row| &got[row * width..][..width]).map(|&v| f64::from(v)).collect();
        self.compared.insert(key.clone());
        close(&key, &sorted, &want.data, absolute(TOLERANCE))
    }

    /// Compares the result, and fails if an activation that `expected` names was not compared on the way.
    fn finish(self, result: &[f32], expected: fn(&str) -> bool) -> Outcome {
        let want = self.golden.io.get("out.feat")?;
        let rows = self.golden.site_of.iter().map(|&site| &result[site as usize * want.shape[1]..][..want.shape[1]]);
        let sorted: Vec<f64> = rows.flatten().map(|&v| f64::from(v)).collect();
        close("out.feat", &sorted, &want.data, absolute(TOLERANCE))?;
        let names = self.golden.io.names()?;
        let activation = |name: &&String| name.starts_with("act.") && !name.ends_with(".grid_coord");
        match names.iter().filter(activation).find(|name| expected(name) && !self.compared.contains(*name)) {
            None => Ok(()),
            Some(name) => Err(format!("{name} was not computed").into()),
        }
    }
}

/// The stage that an activation belongs to, from its name: `embedding`, `enc1.down`, `dec0`.
fn stage_of(name: &str) -> Result<usize, Failed> {
    let first = name.split('.').next().unwrap_or(name);
    let digits = first.trim_start_matches(|c: char| !c.is_ascii_digit());
    if digits.is_empty() { Ok(0) } else { digits.parse().map_err(failed) }
}

fn trained(golden: &Ptv3Golden) -> Outcome {
    let run = Run::new(golden)?;
    let policy = run.policy.clone();
    run.check(&policy, |_| true)
}

/// Folded, it shows its stages, not the inside of its blocks.
fn folded(golden: &Ptv3Golden) -> Outcome {
    let run = Run::new(golden)?;
    let policy = run.policy.fold().map_err(failed)?;
    run.check(&policy, |name| !name.contains(".block"))
}
