//! The objective on a GPU: what crosses are the Gaussians to it, the true images once, and the rows of the Gaussians that are seen back.

use std::time::Instant;

use super::{BEHIND, Found, ObjectiveSeconds, Sums, Wanted};
use crate::gaussians::physical::Splat;
use crate::loss::{Kept, LossWeights, gpu};
use crate::parallel;
use crate::render::gpu::{Gpu, GpuError, MAPPED, Row, SceneBuffers, Work};
use crate::views::View;

/// Bytes of a Gaussian, of one more set of rows, and of a pixel of the largest view: what does not depend on who touches which tile.
const BYTES_OF_SPLAT: u64 = 300;
const BYTES_OF_ROW: u64 = 80;
const BYTES_OF_PIXEL: u64 = 108;
/// Gaussians that a thread fills in at once.
const CHUNK: usize = 4096;

/// What [`found`](super::found) finds, on a GPU.
///
/// # Errors
/// Where a view does not fit, or the GPU has stopped.
pub(super) fn found<'v>(
    gpu: &Gpu,
    splats: &[Splat],
    views: &[&'v View],
    weights: &LossWeights,
    wanted: Wanted,
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
    let stay = wanted.images && kept.begin_drawn(&mut work, views);
    for (number, view) in views.iter().enumerate() {
        let drawn = work.draw(&scene, &view.pinhole, BEHIND)?;
        let truth = sums.truth(&mut work, number, view, kept)?;
        let by_pixel = sums.gradient(&mut work, &truth, &drawn)?;
        if wanted.gradient {
            work.add_backward(&scene, &drawn, &by_pixel, &scene.gradients, share)?;
        }
        if let Some(residuals) = &residuals {
            let by_pixel = gpu::residual(&mut work, &truth, &drawn)?;
            work.add_backward(&scene, &drawn, &by_pixel, residuals, 1.0)?;
        }
        if stay && let Some(to) = kept.drawn(&work, number) {
            work.copy::<[f32; 4]>(&drawn.image, &to, drawn.num_pixels());
        } else if wanted.images {
            images.push(work.colours(&drawn)?);
        }
    }
    let terms = sums.terms(&mut work)?;
    let seen = work.seen(&scene)?;
    let mut gradients = Vec::new();
    if wanted.gradient {
        let rows = work.gather(&seen, &scene.gradients, 0..MAPPED)?;
        gradients = spread(&seen.indices, rows.as_chunks().0, splats.len(), Row::gradient_of);
    }
    let (mut of_residuals, mut blended) = (Vec::new(), Vec::new());
    if let Some(residuals) = residuals {
        let rows = work.gather(&seen, &residuals, 0..MAPPED + 2)?;
        let rows = rows.as_chunks::<{ MAPPED + 2 }>().0;
        let gradient = |row: &[f32; MAPPED + 2]| row.first_chunk().map(Row::gradient_of).unwrap_or_default();
        of_residuals = spread(&seen.indices, rows, splats.len(), gradient);
        blended = spread(&seen.indices, rows, splats.len(), |row| [row[MAPPED], row[MAPPED + 1]].map(f64::from));
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

/// `[len]` what the rows of some give, which are ascending; defaults for the others.
fn spread<R: Sync, T: Clone + Default + Send>(
    indices: &[u32],
    rows: &[R],
    len: usize,
    of: impl Fn(&R) -> T + Sync,
) -> Vec<T> {
    let mut all = vec![T::default(); len];
    parallel::for_chunks(&mut all, CHUNK, &|number, part| {
        let (start, end) = (number * CHUNK, number * CHUNK + part.len());
        let first = indices.partition_point(|&i| (i as usize) < start);
        let chosen = indices.iter().zip(rows).skip(first).take_while(|(i, _)| (**i as usize) < end);
        chosen.for_each(|(&i, row)| part[i as usize - start] = of(row));
    });
    all
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
        let truth = sums.truth(work, number, view, kept)?;
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
