//! The objective on a GPU: what crosses are the Gaussians and the true images to it, and every Gaussian's row back.

use std::time::Instant;

use super::{BEHIND, Found, ObjectiveSeconds, Sums, Wanted};
use crate::gaussians::physical::Splat;
use crate::loss::{LossWeights, gpu};
use crate::render::gpu::{Gpu, GpuError};
use crate::views::View;

/// What [`found`](super::found) finds, on a GPU.
///
/// # Errors
/// Where a view does not fit, or the GPU has stopped.
pub(super) fn found(
    gpu: &Gpu,
    splats: &[Splat],
    views: &[&View],
    weights: &LossWeights,
    wanted: Wanted,
) -> Result<Found, GpuError> {
    let start = Instant::now();
    let mut work = gpu.work()?;
    let scene = work.load(splats)?;
    let residuals = if wanted.mean_residuals { Some(work.rows("residuals", splats.len())?) } else { None };
    let sums = gpu::LossSums::new(&mut work, views, weights)?;
    let share = 1.0 / views.len().max(1) as f32;
    let mut images = Vec::new();
    for (number, view) in views.iter().enumerate() {
        let drawn = work.draw(&scene, &view.pinhole, BEHIND)?;
        let truth = sums.truth(&mut work, number, view)?;
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
    let rows = work.read_rows(&scene.gradients, splats.len())?;
    let residuals = match residuals {
        Some(rows) => work.read_rows(&rows, splats.len())?,
        None => Vec::new(),
    };
    let gradients = if wanted.gradient { rows.iter().map(|row| row.gradient).collect() } else { Vec::new() };
    Ok(Found {
        terms,
        gradients: Sums(gradients),
        residuals: Sums(residuals.iter().map(|row| row.gradient).collect()),
        blended: residuals.iter().map(|row| row.mapped.map(f64::from)).collect(),
        images,
        seen: rows.iter().map(|row| row.is_seen).collect(),
        // Drawing and losses run on without the processor, which cannot tell their parts.
        seconds: ObjectiveSeconds { render: start.elapsed().as_secs_f64(), loss: 0.0 },
    })
}
