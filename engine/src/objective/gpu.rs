//! The objective on a GPU: what crosses are the Gaussians to it, the true images once, and the rows of the Gaussians that are seen back.

use std::time::Instant;

use super::{BEHIND, Found, ObjectiveSeconds, Sums, Wanted};
use crate::gaussians::physical::{Splat, SplatGradient};
use crate::loss::{Kept, LossWeights, gpu};
use crate::render::gpu::{Gpu, GpuError, MAPPED, Row, SceneBuffers, Work};
use crate::views::View;

/// Bytes of a Gaussian, of one more set of rows, and of a pixel of the largest view: what does not depend on who touches which tile.
const BYTES_OF_SPLAT: u64 = 304;
const BYTES_OF_ROW: u64 = 80;
const BYTES_OF_PIXEL: u64 = 108;

/// What [`found`](super::found) finds, on a GPU.
///
/// # Errors
/// Where a view does not fit, or the GPU has stopped.
pub(super) fn found<'v>(
    gpu: &Gpu,
    splats: &[Splat],
    views: &[&'v View],
    (weights, wanted): (&LossWeights, Wanted),
    kept: &mut Kept<'v>,
) -> Result<Found, GpuError> {
    let start = Instant::now();
    let mut work = gpu.work()?;
    expect(&work, splats.len(), views, if wanted.mean_residuals { BYTES_OF_ROW } else { 0 })?;
    let scene = work.load(splats)?;
    let residuals = if wanted.mean_residuals { Some(work.rows("residuals", splats.len())?) } else { None };
    let sums = gpu::LossSums::new(&mut work, views, weights)?;
    let share = 1.0 / views.len().max(1) as f32;
    let mut images = Vec::new();
    for (number, view) in views.iter().enumerate() {
        let drawn = work.draw(&scene, &view.pinhole, BEHIND)?;
        let truth = sums.truth(&mut work, (number, view), kept)?;
        let by_pixel = sums.gradient(&mut work, &truth, &drawn)?;
        if wanted.gradient {
            work.add_backward(&scene, &drawn, &by_pixel, &scene.gradients, share)?;
        }
        if let Some(residuals) = &residuals {
            let by_pixel = gpu::residual(&mut work, &truth, &drawn)?;
            work.add_backward(&scene, &drawn, &by_pixel, residuals, 1.0)?;
        }
        if wanted.images {
            images.push(work.colours(&drawn)?);
        }
    }
    let terms = sums.terms(&mut work)?;
    let seen = work.seen(&scene)?;
    let mut gradients = vec![SplatGradient::default(); if wanted.gradient { splats.len() } else { 0 }];
    if wanted.gradient {
        let rows = work.gather(&seen, &scene.gradients, 0..MAPPED)?;
        for (&i, row) in seen.indices.iter().zip(rows.as_chunks().0) {
            gradients[i as usize] = Row::gradient_of(row);
        }
    }
    let mut of_residuals = Vec::new();
    let mut blended = Vec::new();
    if let Some(residuals) = residuals {
        (of_residuals, blended) = (vec![SplatGradient::default(); splats.len()], vec![[0.0; 2]; splats.len()]);
        let rows = work.gather(&seen, &residuals, 0..MAPPED + 2)?;
        for (&i, row) in seen.indices.iter().zip(rows.as_chunks::<{ MAPPED + 2 }>().0) {
            let (gradient, mapped) = row.split_at(MAPPED);
            of_residuals[i as usize] = gradient.first_chunk().map(Row::gradient_of).unwrap_or_default();
            blended[i as usize] = [f64::from(mapped[0]), f64::from(mapped[1])];
        }
    }
    let mut is_seen = vec![false; splats.len()];
    seen.indices.iter().for_each(|&i| is_seen[i as usize] = true);
    Ok(Found {
        terms,
        gradients: Sums(gradients),
        residuals: Sums(of_residuals),
        blended,
        images,
        seen: is_seen,
        seconds: ObjectiveSeconds { render: start.elapsed().as_secs_f64(), loss: None },
    })
}

/// Draws the views, and adds the gradients of their mean loss to the scene's rows; the sums of the losses.
///
/// # Errors
/// Where a view does not fit, or the GPU has stopped.
pub(crate) fn descend<'v>(
    work: &mut Work<'_>,
    scene: &SceneBuffers,
    views: &[&'v View],
    weights: &LossWeights,
    kept: &mut Kept<'v>,
) -> Result<gpu::LossSums, GpuError> {
    let sums = gpu::LossSums::new(work, views, weights)?;
    let share = 1.0 / views.len().max(1) as f32;
    for (number, view) in views.iter().enumerate() {
        let drawn = work.draw(scene, &view.pinhole, BEHIND)?;
        let truth = sums.truth(work, (number, view), kept)?;
        let by_pixel = sums.gradient(work, &truth, &drawn)?;
        work.add_backward(scene, &drawn, &by_pixel, &scene.gradients, share)?;
    }
    Ok(sums)
}

/// Fails before the work where Gaussians that keep so many bytes beside their drawing, and the largest view, are more than there is room for.
///
/// # Errors
/// [`GpuError::NoRoom`].
pub(crate) fn expect(work: &Work<'_>, num_splats: usize, views: &[&View], beside: u64) -> Result<(), GpuError> {
    let pixels = views.iter().map(|view| view.pinhole.num_pixels()).max().unwrap_or(0);
    work.expect("the scene and a view", num_splats as u64 * (BYTES_OF_SPLAT + beside) + pixels as u64 * BYTES_OF_PIXEL)
}
