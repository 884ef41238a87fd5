//! Figures of rendered views against what the sensors saw.
//!
//! Pixels whose label is `Ignored` are excluded from all figures: the ratios and means leave them out, and for the windows
//! of SSIM and LPIPS the truth stands in for what was rendered there.

mod copying;
pub mod dmae;
pub mod lpips;
pub mod masks;
mod polygon;
pub mod psnr;
pub mod ssim;

use std::borrow::Cow;

use lgs_formats::image::{PixelLabel, RgbImage};

use crate::{
    error::{EngineError, Result},
    loss::{
        fill_ignored,
        ssim::{ImagePair, similarity_map},
    },
    render::Rendered,
    views::View,
};
pub use copying::copying;
use lpips::Lpips;

/// Figures of one view; `None` where one is not defined.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ViewFigures {
    /// PSNR, decibels; infinite for identical images.
    pub psnr: Option<f64>,
    /// PSNR of the nearest input image in its place, decibels: see [`copying`], which gives it.
    pub psnr_copying: Option<f64>,
    /// Mean SSIM; none for a side below 11 pixels.
    pub ssim: Option<f64>,
    /// LPIPS distance; none without its weights or for a side below 17 pixels.
    pub lpips: Option<f64>,
    /// Mean absolute error of the expected depth, metres; none without a LiDAR return in the view.
    pub dmae: Option<f64>,
    /// PSNR over the dynamic pixels, decibels.
    pub psnr_dynamic: Option<f64>,
    /// Mean SSIM over the window centres that are dynamic pixels.
    pub ssim_dynamic: Option<f64>,
    /// PSNR over the static pixels, decibels.
    pub psnr_static: Option<f64>,
    /// Mean SSIM over the window centres that are static pixels.
    pub ssim_static: Option<f64>,
}

impl ViewFigures {
    /// Means over views, each figure over those that have it.
    pub fn mean<'a>(views: impl Iterator<Item = &'a Self> + Clone) -> Self {
        let mean_of = |figure: fn(&Self) -> Option<f64>| {
            let values: Vec<f64> = views.clone().filter_map(figure).collect();
            (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
        };
        Self {
            psnr: mean_of(|f| f.psnr),
            psnr_copying: mean_of(|f| f.psnr_copying),
            ssim: mean_of(|f| f.ssim),
            lpips: mean_of(|f| f.lpips),
            dmae: mean_of(|f| f.dmae),
            psnr_dynamic: mean_of(|f| f.psnr_dynamic),
            ssim_dynamic: mean_of(|f| f.ssim_dynamic),
            psnr_static: mean_of(|f| f.psnr_static),
            ssim_static: mean_of(|f| f.ssim_static),
        }
    }
}

/// Figures of a rendered image against its view, but for [`ViewFigures::psnr_copying`], which needs other views.
///
/// # Shapes
/// `rendered` has the size of `view`; `dynamic` `[H, W]`. Without `dynamic` the figures by motion are absent.
///
/// # Errors
/// A rendered colour or an accumulated alpha or depth that is not finite, by frame, camera and index; a failed tensor
/// operation of LPIPS.
pub fn evaluate_view(
    rendered: &Rendered,
    view: &View,
    dynamic: Option<&[bool]>,
    lpips: Option<&Lpips>,
) -> Result<ViewFigures> {
    check_finite(rendered, view)?;
    let labels = view.labels.as_deref();
    let truth = &view.image.data;
    let colours = colours_without_ignored(rendered, truth, labels);
    let (width, height) = (view.image.width, view.image.height);
    let valid = |pixel: usize| labels.is_none_or(|labels| labels[pixel] != PixelLabel::Ignored);
    let map = similarity_map(&ImagePair { truth, rendered: &colours, width, height });
    let psnr_where = |keep: &dyn Fn(usize) -> bool| psnr::psnr_where(truth, &colours, |i| valid(i) && keep(i));
    let ssim_where = |keep: &dyn Fn(usize) -> bool| map.as_ref()?.mean_where(|i| valid(i) && keep(i));
    let mut figures = ViewFigures {
        psnr: psnr_where(&|_| true),
        ssim: ssim_where(&|_| true),
        dmae: dmae::dmae(rendered, &view.depth_samples, labels),
        ..ViewFigures::default()
    };
    if let Some(dynamic) = dynamic {
        figures.psnr_dynamic = psnr_where(&|i| dynamic[i]);
        figures.ssim_dynamic = ssim_where(&|i| dynamic[i]);
        figures.psnr_static = psnr_where(&|i| !dynamic[i]);
        figures.ssim_static = ssim_where(&|i| !dynamic[i]);
    }
    if let Some(lpips) = lpips.filter(|_| width.min(height) >= lpips::MIN_SIDE && figures.psnr.is_some()) {
        let image = RgbImage { width, height, data: colours.into_owned() };
        figures.lpips = Some(lpips.distance(&view.image, &image)?);
    }
    Ok(figures)
}

fn colours_without_ignored<'a>(rendered: &'a Rendered, truth: &[f32], labels: Option<&[PixelLabel]>) -> Cow<'a, [f32]> {
    match labels.filter(|labels| labels.contains(&PixelLabel::Ignored)) {
        None => Cow::Borrowed(&rendered.rgb),
        Some(labels) => {
            let mut filled = Vec::new();
            fill_ignored(&rendered.rgb, truth, labels, &mut filled);
            Cow::Owned(filled)
        }
    }
}

fn check_finite(rendered: &Rendered, view: &View) -> Result<()> {
    let images = [("colour", &rendered.rgb), ("alpha", &rendered.alpha), ("depth", &rendered.depth)];
    for (name, values) in images {
        if let Some(index) = values.iter().position(|value| !value.is_finite()) {
            let what = format!("rendered {name} {index} of frame {} {}", view.frame, view.camera);
            return Err(EngineError::NonFinite { what, found: values[index] });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
