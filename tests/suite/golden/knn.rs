//! Exact neighbours at other timestamps.

use lgs_engine::ops::knn::{NO_NEIGHBOUR, nearest_other_time};
use lgs_tests::golden::tensors::TensorFile;
use lgs_tests::golden::{GoldenFile, files};
use lgs_tests::{Outcome, case};
use libtest_mimic::Trial;

pub(crate) fn cases() -> Vec<Trial> {
    match files("knn", "safetensors") {
        Ok(files) => files.into_iter().map(|file| case(file.name.clone(), move || equals(&file))).collect(),
        Err(error) => vec![case("golden::knn::files", move || Err(error.into()))],
    }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "coordinates and indices of the file")]
fn equals(file: &GoldenFile) -> Outcome {
    let tensors = TensorFile::open(&file.path)?;
    let points: Vec<[f32; 3]> =
        tensors.get("in.points")?.data.as_chunks::<3>().0.iter().map(|p| p.map(|v| v as f32)).collect();
    let times: Vec<u32> = tensors.get("in.time_index")?.data.iter().map(|&t| t as u32).collect();
    let want = tensors.get("out.idx")?;
    let found = nearest_other_time(&points, &times, want.shape[1]).map_err(|e| e.to_string())?;
    for (at, (&got, &want)) in found.indices.iter().zip(&want.data).enumerate() {
        let want = if want < 0.0 { NO_NEIGHBOUR } else { want as u32 };
        if got != want {
            let place = format!("out.idx[{at}] (neighbour {} of point {})", at % found.k, at / found.k);
            return Err(format!("{place}: got {got}, want {want}, tolerance 0").into());
        }
    }
    Ok(())
}
