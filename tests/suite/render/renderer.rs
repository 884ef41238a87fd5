//! One face for both renderers, so that one test body serves both.

use lgs_engine::render::reference::{self, Gradient, Images};
use lgs_tests::case;
use lgs_tests::scenes::Scene;
use libtest_mimic::Trial;

/// A renderer under test.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Renderer {
    /// The f64 twin.
    Twin,
}

/// The colour behind the scenes of these cases.
pub(crate) const BACKGROUND: [f64; 3] = [0.25, 0.5, 0.125];

impl Renderer {
    pub(crate) const ALL: [Self; 1] = [Self::Twin];

    pub(crate) fn images(self, scene: &Scene) -> Images {
        match self {
            Self::Twin => reference::render(&scene.gaussians, &scene.camera, BACKGROUND),
        }
    }

    pub(crate) fn gradients(self, scene: &Scene, v_images: &Images) -> Vec<Gradient> {
        match self {
            Self::Twin => reference::backward(&scene.gaussians, &scene.camera, BACKGROUND, v_images),
        }
    }

    /// What rounding alone may change in a value of order 1.
    pub(crate) fn rounding(self) -> f64 {
        match self {
            Self::Twin => 1e-9,
        }
    }

    /// Step of central differences.
    pub(crate) fn step(self) -> f64 {
        match self {
            Self::Twin => 1e-6,
        }
    }

    /// How far central differences of this step are from the gradient, relative L2.
    pub(crate) fn difference_tolerance(self) -> f64 {
        match self {
            Self::Twin => 1e-5,
        }
    }

    /// A case of this renderer.
    pub(crate) fn case(self, what: &str, body: fn(Self) -> lgs_tests::Outcome) -> Trial {
        let name = match self {
            Self::Twin => "twin",
        };
        case(format!("render::{name}::{what}"), move || body(self))
    }
}

/// Every number of the gradients, Gaussian by Gaussian.
pub(crate) fn flat(gradients: &[Gradient]) -> Vec<f64> {
    gradients.iter().flat_map(flat_one).collect()
}

/// The 17 numbers of one gradient: mean, quaternion, scale, opacity, colour, velocity.
pub(crate) fn flat_one(g: &Gradient) -> [f64; 17] {
    let mut out = [0.0; 17];
    out[..3].copy_from_slice(&g.mean);
    out[3..7].copy_from_slice(&g.quat);
    out[7..10].copy_from_slice(&g.scale);
    out[10] = g.opacity;
    out[11..14].copy_from_slice(&g.colour);
    out[14..].copy_from_slice(&g.velocity);
    out
}
