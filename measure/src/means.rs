//! Mean figures of a clip.

use lgs_engine::evaluate::ViewFigures;
use serde::{Deserialize, Serialize};

/// Mean figures over the held-out views of a clip.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Means {
    /// PSNR, decibels.
    pub psnr: Option<f64>,
    /// Mean SSIM.
    pub ssim: Option<f64>,
    /// LPIPS distance.
    pub lpips: Option<f64>,
    /// Mean absolute depth error, metres.
    pub dmae: Option<f64>,
    /// PSNR over pixels of moving things, decibels.
    pub psnr_dynamic: Option<f64>,
    /// PSNR over the other pixels, decibels.
    pub psnr_static: Option<f64>,
}

impl From<ViewFigures> for Means {
    fn from(figures: ViewFigures) -> Self {
        let finite = |value: Option<f64>| value.filter(|value| value.is_finite());
        Self {
            psnr: finite(figures.psnr),
            ssim: finite(figures.ssim),
            lpips: finite(figures.lpips),
            dmae: finite(figures.dmae),
            psnr_dynamic: finite(figures.psnr_dynamic),
            psnr_static: finite(figures.psnr_static),
        }
    }
}
