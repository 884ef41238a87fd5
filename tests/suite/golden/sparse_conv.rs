//! Sparse convolutions and their gradients against dense ones.

use std::sync::Arc;

use candle_core::{Device, Tensor, Var};
use lgs_engine::ops::sparse_conv::{ConvWeights, KernelMap, Sites, convolve};
use lgs_tests::compare::{absolute, close};
use lgs_tests::golden::tensors::TensorFile;
use lgs_tests::golden::{GoldenFile, files};
use lgs_tests::{Outcome, case};
use libtest_mimic::{Failed, Trial};

const VALUES: f64 = 1e-5;
const GRADIENTS: f64 = 1e-4;

pub(crate) fn cases() -> Vec<Trial> {
    let files = match files("sparse_conv", "safetensors") {
        Ok(files) => files,
        Err(error) => return vec![case("golden::sparse_conv::files", move || Err(error.into()))],
    };
    let cases = |file: GoldenFile| {
        let other = file.clone();
        [
            case(format!("{}::chain", file.name), move || chain(&file)),
            case(format!("{}::other_kernels", other.name), move || other_kernels(&other)),
        ]
    };
    files.into_iter().flat_map(cases).collect()
}

/// Inputs in the order of the sites, and the way back to the order of the file.
struct Input {
    tensors: TensorFile,
    sites: Sites,
    /// Row of the file of every site.
    row_of: Tensor,
    /// Site of every row of the file.
    site_of: Tensor,
    features: Var,
}

impl Input {
    #[expect(clippy::cast_possible_truncation, reason = "small coordinates of the file")]
    fn open(file: &GoldenFile) -> Result<Self, Failed> {
        let tensors = TensorFile::open(&file.path)?;
        let coords = coords_of(&tensors, "in.coords")?;
        let (sites, site_of) = Sites::unique(&coords).map_err(|e| e.to_string())?;
        let mut row_of = vec![0_u32; sites.len()];
        for (row, &site) in site_of.iter().enumerate() {
            row_of[site as usize] = row as u32;
        }
        let features = variable(&tensors, "in.feat")?;
        let index = |rows: Vec<u32>| Tensor::new(rows, &Device::Cpu).map_err(failed);
        Ok(Self { sites, row_of: index(row_of)?, site_of: index(site_of)?, features, tensors })
    }

    fn sorted(&self) -> Result<Tensor, Failed> {
        self.features.index_select(&self.row_of, 0).map_err(failed)
    }

    fn in_file_order(&self, rows: &Tensor) -> Result<Tensor, Failed> {
        rows.index_select(&self.site_of, 0).map_err(failed)
    }

    fn check(&self, name: &str, got: &Tensor, tolerance: f64) -> Outcome {
        let got: Vec<f64> =
            got.flatten_all().and_then(|t| t.to_vec1::<f32>()).map_err(failed)?.into_iter().map(f64::from).collect();
        close(name, &got, &self.tensors.get(name)?.data, absolute(tolerance))
    }
}

fn failed(error: candle_core::Error) -> Failed {
    error.to_string().into()
}

#[expect(clippy::cast_possible_truncation, reason = "small coordinates of the file")]
fn coords_of(tensors: &TensorFile, name: &str) -> Result<Vec<[i32; 4]>, Failed> {
    Ok(tensors.get(name)?.data.as_chunks::<4>().0.iter().map(|c| c.map(|v| v as i32)).collect())
}

#[expect(clippy::cast_possible_truncation, reason = "the file holds f32 values")]
fn variable(tensors: &TensorFile, name: &str) -> Result<Var, Failed> {
    let values = tensors.get(name)?;
    let data: Vec<f32> = values.data.iter().map(|&v| v as f32).collect();
    let tensor = Tensor::from_vec(data, values.shape.clone(), &Device::Cpu).map_err(failed)?;
    Var::from_tensor(&tensor).map_err(failed)
}

/// Submanifold, down, submanifold, up; then the gradients of a weighted sum.
fn chain(file: &GoldenFile) -> Outcome {
    let input = Input::open(file)?;
    let fine = Arc::new(KernelMap::submanifold(&input.sites, 3).map_err(|e| e.to_string())?);
    let halving = KernelMap::halving(&input.sites).map_err(|e| e.to_string())?;
    if halving.coarse.coords() != coords_of(&input.tensors, "out.coarse_coords")? {
        return Err("the coarse sites differ".into());
    }
    let coarse = Arc::new(KernelMap::submanifold(&halving.coarse, 3).map_err(|e| e.to_string())?);
    let weights = ["subm", "down", "subm2", "up"].map(|layer| variable(&input.tensors, &format!("w.{layer}")));
    let [subm, down, subm2, up] = weights;
    let (subm, down, subm2, up) = (subm?, down?, subm2?, up?);
    let bias = |layer: &str| variable(&input.tensors, &format!("b.{layer}"));
    let (b_subm, b_down, b_up) = (bias("subm")?, bias("down")?, bias("up")?);
    let layer = |x: &Tensor, weight: &Var, map: &Arc<KernelMap>, bias: Option<&Var>| {
        let weights = match bias {
            Some(bias) => ConvWeights::with_bias(weight, bias)?,
            None => ConvWeights::without_bias(weight)?,
        };
        convolve(x, &weights, None, map, false)
    };
    let a = layer(&input.sorted()?, &subm, &fine, Some(&b_subm)).map_err(failed)?;
    input.check("out.subm", &input.in_file_order(&a)?, VALUES)?;
    let b = layer(&a, &down, &halving.down, Some(&b_down)).map_err(failed)?;
    input.check("out.down", &b, VALUES)?;
    let c = layer(&b, &subm2, &coarse, None).map_err(failed)?;
    input.check("out.subm2", &c, VALUES)?;
    let d = input.in_file_order(&layer(&c, &up, &halving.up, Some(&b_up)).map_err(failed)?)?;
    input.check("out.up", &d, VALUES)?;
    let weight = variable(&input.tensors, "loss.w")?;
    let gradients = (d * weight.as_tensor()).and_then(|l| l.sum_all()).and_then(|l| l.backward()).map_err(failed)?;
    let named = [
        ("grad.in.feat", &input.features),
        ("grad.w.subm", &subm),
        ("grad.w.down", &down),
        ("grad.w.subm2", &subm2),
        ("grad.w.up", &up),
        ("grad.b.subm", &b_subm),
        ("grad.b.down", &b_down),
        ("grad.b.up", &b_up),
    ];
    for (name, variable) in named {
        input.check(name, gradients.get(variable).ok_or("no gradient")?, GRADIENTS)?;
    }
    Ok(())
}

/// A kernel of 5, and a kernel of 3 with stride 2 and padding 1.
fn other_kernels(file: &GoldenFile) -> Outcome {
    let input = Input::open(file)?;
    let wide = Arc::new(KernelMap::submanifold(&input.sites, 5).map_err(|e| e.to_string())?);
    let x = input.sorted()?;
    let weights = |name: &str| -> Result<ConvWeights, Failed> {
        let weight = variable(&input.tensors, name)?;
        ConvWeights::without_bias(&weight).map_err(failed)
    };
    let y = convolve(&x, &weights("w.subm5")?, None, &wide, false).map_err(failed)?;
    input.check("out.subm5", &input.in_file_order(&y)?, VALUES)?;
    let (coarse, map) = KernelMap::strided(&input.sites, 3).map_err(|e| e.to_string())?;
    if coarse.coords() != coords_of(&input.tensors, "out.k3s2p1_coords")? {
        return Err("the sites of kernel 3, stride 2, padding 1 differ".into());
    }
    let y = convolve(&x, &weights("w.k3s2p1")?, None, &Arc::new(map), false).map_err(failed)?;
    input.check("out.k3s2p1", &y, VALUES)
}
