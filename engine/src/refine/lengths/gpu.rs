//! What the images ask of steps, on a GPU.

use crate::gaussians::physical::Splat;
use crate::loss::{Kept, LossWeights, gpu};
use crate::objective::BEHIND;
use crate::render::gpu::{Gpu, GpuError, MAPPED};
use crate::views::View;

/// `[N]` sums over the views of what is wanted of a step times what it does, and of the square of the latter, under the weights of every Gaussian.
///
/// # Errors
/// Where a view does not fit, or the GPU has stopped.
pub(super) fn agreements<'v>(
    gpu: &Gpu,
    before: &[Vec<f32>],
    splats: &[Splat],
    views: &[&'v View],
    kept: &mut Kept<'v>,
) -> Result<Vec<[f64; 2]>, GpuError> {
    let mut work = gpu.work()?;
    let scene = work.load(splats)?;
    let sums = gpu::LossSums::new(&mut work, views, &LossWeights::default())?;
    for (number, view) in views.iter().enumerate() {
        let drawn = work.draw(&scene, &view.pinhole, BEHIND)?;
        let truth = sums.truth(&mut work, number, view, kept)?;
        let before = match before.get(number) {
            Some(image) => gpu::colours_before(&mut work, image)?,
            None => kept.drawn(&work, number).ok_or_else(|| GpuError::Lost("a drawn image is no more".to_owned()))?,
        };
        let maps = gpu::agreement(&mut work, &truth, &drawn, &before)?;
        work.add_backward(&scene, &drawn, &maps, &scene.gradients, 1.0)?;
    }
    let seen = work.seen(&scene)?;
    let rows = work.gather(&seen, &scene.gradients, MAPPED..MAPPED + 2)?;
    let mut sums = vec![[0.0; 2]; splats.len()];
    for (&i, row) in seen.indices.iter().zip(rows.as_chunks::<2>().0) {
        sums[i as usize] = row.map(f64::from);
    }
    Ok(sums)
}
