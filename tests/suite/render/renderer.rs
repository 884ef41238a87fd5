//! One face for all renderers, so that one test body serves all.

use lgs_engine::render::reference::{self, Gradient, Images};
use lgs_engine::render::{backward, gpu, render, render_for_gradient};
use lgs_tests::scenes::{Scene, flat_gradient, gradients_of, image_gradient, images_of, pinhole, splats};
use lgs_tests::{Needed, case_if};
use libtest_mimic::Trial;

use crate::gpu::adapter;

/// A renderer under test.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Renderer {
    /// The f64 twin.
    Twin,
    /// The fast path.
    Fast,
    /// The kernels of a GPU.
    Gpu,
}

/// The colour behind the scenes of these cases.
pub(crate) const BACKGROUND: [f64; 3] = [0.25, 0.5, 0.125];

/// The same in f32.
pub(crate) const SINGLE_BACKGROUND: [f32; 3] = [0.25, 0.5, 0.125];

impl Renderer {
    pub(crate) const ALL: [Self; 3] = [Self::Twin, Self::Fast, Self::Gpu];

    pub(crate) fn images(self, scene: &Scene) -> Images {
        match self {
            Self::Twin => reference::render(&scene.gaussians, &scene.camera, BACKGROUND),
            Self::Fast => images_of(&render(&splats(&scene.gaussians), &pinhole(&scene.camera), SINGLE_BACKGROUND)),
            Self::Gpu => {
                let (splats, view) = (splats(&scene.gaussians), pinhole(&scene.camera));
                images_of(&gpu::render(opened(), &splats, &view, SINGLE_BACKGROUND).expect("the GPU draws"))
            }
        }
    }

    pub(crate) fn gradients(self, scene: &Scene, v_images: &Images) -> Vec<Gradient> {
        match self {
            Self::Twin => reference::backward(&scene.gaussians, &scene.camera, BACKGROUND, v_images),
            Self::Fast => {
                let (splats, view) = (splats(&scene.gaussians), pinhole(&scene.camera));
                let state = render_for_gradient(&splats, &view, SINGLE_BACKGROUND);
                gradients_of(&backward(&splats, &view, &state, &image_gradient(v_images)))
            }
            Self::Gpu => {
                let (splats, view) = (splats(&scene.gaussians), pinhole(&scene.camera));
                let gradient = image_gradient(v_images);
                let got = gpu::render_and_backward(opened(), &splats, &view, SINGLE_BACKGROUND, &gradient, [&[], &[]]);
                gradients_of(&got.expect("the GPU draws").splats)
            }
        }
    }

    /// What rounding alone may change in a value of order 1.
    pub(crate) fn rounding(self) -> f64 {
        match self {
            Self::Twin => 1e-9,
            Self::Fast | Self::Gpu => 1e-6,
        }
    }

    /// Step of central differences.
    pub(crate) fn step(self) -> f64 {
        match self {
            Self::Twin => 1e-6,
            Self::Fast | Self::Gpu => 5e-4,
        }
    }

    /// How near to a threshold, relative, a value may come within this step.
    pub(crate) fn step_margin(self) -> f64 {
        match self {
            Self::Twin => 1e-4,
            Self::Fast | Self::Gpu => 0.05,
        }
    }

    /// How far central differences of this step are from the gradient, relative L2.
    pub(crate) fn difference_tolerance(self) -> f64 {
        match self {
            Self::Twin => 1e-5,
            Self::Fast | Self::Gpu => 3e-2,
        }
    }

    /// A case of this renderer.
    pub(crate) fn case(self, what: &str, body: fn(Self) -> lgs_tests::Outcome) -> Trial {
        let name = match self {
            Self::Twin => "twin",
            Self::Fast => "fast",
            Self::Gpu => "gpu",
        };
        let needed = if self == Self::Gpu { adapter::needed() } else { Needed::Here };
        case_if(&needed, format!("render::{name}::{what}"), move || body(self))
    }
}

fn opened() -> &'static gpu::Gpu {
    adapter::gpu().expect("cases run where there is one")
}

/// Every number of the gradients, Gaussian by Gaussian.
pub(crate) fn flat(gradients: &[Gradient]) -> Vec<f64> {
    gradients.iter().flat_map(flat_gradient).collect()
}
