//! What the input views show of every Gaussian, on a GPU: what crosses are the Gaussians, the true images, and four numbers of each Gaussian back.

use crate::gaussians::physical::Splat;
use crate::loss::{Kept, LossWeights, gpu};
use crate::objective::{BEHIND, gpu::expect};
use crate::render::Effect;
use crate::render::constants::HARDLY_SEEN;
use crate::render::gpu::{Gpu, GpuError};
use crate::views::View;

/// Bytes of a Gaussian's effects.
const BYTES_OF_EFFECTS: u64 = size_of::<[f32; 4]>() as u64;

/// `[N]` effects, removals by the mean loss over the views: those of [`Evidence::removal_costs`](super::Evidence::removal_costs), nothing of halves.
///
/// # Errors
/// Where a view does not fit, or the GPU has stopped.
pub(super) fn effects(
    gpu: &Gpu,
    splats: &[Splat],
    views: &[&View],
    costs: (&LossWeights, f32),
) -> Result<Vec<Effect>, GpuError> {
    let mut work = gpu.work()?;
    expect(&work, splats.len(), views, BYTES_OF_EFFECTS)?;
    let scene = work.load(splats)?;
    let effects = work.buffer::<[f32; 4]>("effects", splats.len())?;
    work.clear::<[f32; 4]>(&effects, splats.len());
    let mut kept = Kept::default();
    for view in views {
        let drawn = work.draw_through(&scene, &view.pinhole, BEHIND, HARDLY_SEEN)?;
        gpu::add_effects(&mut work, (view, &drawn), costs, &mut kept, &effects)?;
    }
    let share = 1.0 / views.len().max(1) as f64;
    let of = |&[removal, shown, covered, _]: &[f32; 4]| Effect {
        removal: share * f64::from(removal),
        shown: f64::from(shown),
        covered: f64::from(covered),
        ..Effect::default()
    };
    Ok(work.read::<[f32; 4]>(&effects, 0, splats.len())?.iter().map(of).collect())
}
