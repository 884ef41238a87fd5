//! The renderer on a GPU: the passes of the CPU's, file beside file, as WGSL kernels that wgpu runs on Vulkan, Metal and DX12.
//!
//! Passes: `project` (footprints, counts), `tiles` (lists: a stable radix sort by depth, then by tile), `forward`, `backward` (sums, in a place of
//! its own for every intersection; the chain rule of the projection). Results are the same bits in every run on one device: no atomic decides a
//! place, floats are added in a fixed order. The constants are those of the CPU.
//!
//! Kernels use groups of 64 or 256, no subgroups and no f64. A buffer that would be larger than the GPU allows is an error, but for the sums of
//! the intersections, which are taken in runs of tiles.

mod backward;
mod clock;
mod device;
mod effects;
mod error;
mod forward;
mod gather;
mod kernels;
mod memory;
mod project;
mod read;
mod room;
mod sort;
mod tiles;
mod told;
mod walk;
mod work;

use std::time::Instant;

use super::{ImageGradient, Rendered};
use crate::gaussians::physical::{Splat, SplatGradient};
use crate::views::PinholeView;

pub(crate) use backward::Row;
use clock::Clock;
pub use device::{Adapter, Gpu, adapters, open, open_limited, open_real};
pub(crate) use effects::ViewCosts;
pub use error::GpuError;
pub(crate) use forward::Drawn;
pub(crate) use kernels::{Kernel, MAPPED, count, single};
pub(crate) use memory::Owned;
pub(crate) use project::SceneBuffers;
pub(crate) use told::Told;
pub(crate) use work::{Work, groups_over};

/// As [`render`](super::render), on a GPU.
///
/// # Errors
/// Where the view does not fit, or the GPU has stopped.
pub fn render(gpu: &Gpu, splats: &[Splat], view: &PinholeView, background: [f32; 3]) -> Result<Rendered, GpuError> {
    let mut work = gpu.work()?;
    let scene = work.load(splats)?;
    let drawn = work.draw(&scene, view, background)?;
    work.images(&drawn)
}

/// What drawing takes.
#[derive(Clone, Debug, PartialEq)]
pub struct Times {
    /// Mean seconds of a drawing.
    pub mean: f64,
    /// Seconds of each kernel in one drawing, by the GPU's clock; empty where it has none.
    pub kernels: Vec<(&'static str, f64)>,
}

/// Times of `times` drawings of a view, over black, of a scene that is on the GPU already; with a gradient, of its way back too.
///
/// # Errors
/// Where the view does not fit, or the GPU has stopped.
pub fn times(
    gpu: &Gpu,
    splats: &[Splat],
    view: &PinholeView,
    gradient: Option<&ImageGradient>,
    times: u32,
) -> Result<Times, GpuError> {
    let mut work = gpu.work()?;
    let scene = work.load(splats)?;
    let drawn = work.draw(&scene, view, [0.0; 3])?;
    let by_pixel = gradient.map(|gradient| work.upload_gradient(&drawn, gradient, [&[], &[]])).transpose()?;
    let draw = |work: &mut Work<'_>, times: u32| -> Result<f64, GpuError> {
        let start = Instant::now();
        for _ in 0..times {
            let drawn = work.draw(&scene, view, [0.0; 3])?;
            if let Some(by_pixel) = &by_pixel {
                work.add_backward(&scene, &drawn, by_pixel, &scene.gradients, 1.0)?;
            }
        }
        // What is read is there once all is done.
        work.read::<f32>(&scene.gradients, 0, 1)?;
        Ok(start.elapsed().as_secs_f64() / f64::from(times.max(1)))
    };
    // The first builds kernels.
    draw(&mut work, 1)?;
    let mean = draw(&mut work, times)?;
    work.clock = Clock::new(gpu);
    draw(&mut work, 1)?;
    let Some(clock) = work.clock.take() else { return Ok(Times { mean, kernels: Vec::new() }) };
    let (ticks, len) = clock.resolve(gpu, work.encoder());
    let ticks = work.read(&ticks, 0, len)?;
    Ok(Times { mean, kernels: clock.seconds(gpu, &ticks) })
}

/// A drawn view, gradients by all Gaussians, and the sums of two maps under their blending weights.
#[derive(Clone, Debug, PartialEq)]
pub struct Gradients {
    /// The images.
    pub images: Rendered,
    /// `[N]` by the physical values.
    pub splats: Vec<SplatGradient>,
    /// `[N]` sums of the maps.
    pub mapped: Vec<[f32; 2]>,
    /// `[N]` whether the view shows the Gaussian.
    pub seen: Vec<bool>,
}

/// A view drawn on a GPU, with the gradients of a scalar from those by its images, as [`backward`](super::backward) has them.
///
/// # Shapes
/// `maps` of `[H, W]`; an empty one stands for zeros.
///
/// # Errors
/// Where the view does not fit, or the GPU has stopped.
pub fn render_and_backward(
    gpu: &Gpu,
    splats: &[Splat],
    view: &PinholeView,
    background: [f32; 3],
    gradient: &ImageGradient,
    maps: [&[f32]; 2],
) -> Result<Gradients, GpuError> {
    let mut work = gpu.work()?;
    let scene = work.load(splats)?;
    let drawn = work.draw(&scene, view, background)?;
    let by_pixel = work.upload_gradient(&drawn, gradient, maps)?;
    work.add_backward(&scene, &drawn, &by_pixel, &scene.gradients, 1.0)?;
    let rows = work.read_rows(&scene.gradients, splats.len())?;
    Ok(Gradients {
        images: work.images(&drawn)?,
        splats: rows.iter().map(|row| row.gradient).collect(),
        mapped: rows.iter().map(|row| row.mapped).collect(),
        seen: rows.iter().map(|row| row.is_seen).collect(),
    })
}
