//! The background branch: what stands behind, between and above the returns.

mod backdrop;
mod backstop;
mod blocks;
mod coverage;
mod depth;
mod emit;
mod gaps;
mod maps;
mod moving;
mod sky;

use std::cmp::Reverse;

use lgs_formats::image::PixelLabel;
use serde::{Deserialize, Serialize};

pub use self::maps::MapFit;
use self::{backdrop::Backdrop, depth::Trust, maps::Aligned};
use super::{GaussianSet, Start, motion::Movement};
use crate::{
    points::PointCloud,
    views::{PinholeView, Role, View},
};

/// Where the background comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// What the clip needs: its own depth maps where it has some, else what scored best on held-out frames, `depth`.
    ///
    /// PSNR without a network, gaps and depth: 15.87 and 19.59 dB on DDAD (three cameras, 304x484), 19.52 and 20.67 on KITTI (188x621),
    /// 24.10 and 25.92 over six procedural scenes (128x256).
    #[default]
    Auto,
    /// None.
    Off,
    /// A hemisphere far away, above the horizon.
    Sky,
    /// Where the surfaces around a gap continue to: quicker than `depth`, and worse.
    Gaps,
    /// Where the images and sweeps agree that it is.
    Depth,
    /// Where the clip's depth maps say it is, each brought to metres by the sweep; `depth` for images without one that fits.
    ///
    /// Held-out PSNR over five procedural scenes (one camera, 128x256, every second of five frames) with exact maps, with maps as a network
    /// gives them (off by up to a tenth in patches), and by search: 32.97, 32.60 and 32.44 dB with the weights that ship, 26.21, 26.13 and
    /// 26.15 dB without a network, where the width of the Gaussians hides the difference; in about half the time.
    Maps,
}

/// What stands behind a view's pixels.
#[derive(Clone, Debug, PartialEq)]
struct Sheet {
    /// `[H, W]` inverse depths, 1 / metres along the camera's z axis; NaN where nothing is known.
    inverse_depths: Vec<f32>,
    /// `[H, W]` how far they can be trusted.
    trust: Vec<Trust>,
}

impl Sheet {
    /// That of a view behind whose pixels nothing is known.
    fn unknown(view: &View) -> Self {
        let count = view.pinhole.num_pixels();
        Self { inverse_depths: vec![0.0; count], trust: vec![Trust::Unknown; count] }
    }
}

/// How depth maps were used: appends Gaussians to `set` where its `LiDAR` branch leaves pixels of the input views uncovered.
///
/// What views agree on comes first, then what one alone knows, then what is contradicted; within each, view after view, from the middle frame outwards.
/// Pixels that an earlier Gaussian covers get no other. All of them are static but the own vehicle's, which moves with the
/// sensors. What is returned says how the clip's depth maps were brought to metres, where they were asked for.
pub(crate) fn add_background(
    set: &mut GaussianSet,
    views: &[View],
    cloud: &PointCloud,
    movement: &Movement,
    start: Start,
) -> Vec<MapFit> {
    let Start { background: mode, coarseness } = start;
    let views = from_the_middle(views);
    let without_maps = |sheets: Vec<Sheet>| Aligned { sheets, fits: Vec::new() };
    let radius = sky::radius(cloud);
    let things = moving::things(cloud, movement);
    let still = moving::still(cloud, movement);
    let cloud = &still;
    let Aligned { sheets, fits } = match mode {
        Mode::Off => return Vec::new(),
        Mode::Sky => without_maps(sky::sheets(&views, radius)),
        Mode::Gaps => without_maps(gaps::sheets(&views, radius)),
        Mode::Depth => without_maps(depth::sheets(&views, cloud, radius)),
        Mode::Auto | Mode::Maps => maps::sheets(&views, cloud, radius),
    };
    let mut backdrop = Backdrop::new(views, sheets, set);
    backdrop.add_moving(set, cloud, &things, coarseness);
    backdrop.add_pixels(set, coarseness);
    if !matches!(mode, Mode::Sky | Mode::Gaps) {
        backdrop.add_own_vehicle(set, coarseness);
        backdrop.add_backstop(set, coarseness);
    }
    fits
}

/// Whether a pixel takes part in nothing.
fn is_ignored(view: &View, pixel: usize) -> bool {
    view.labels.as_ref().is_some_and(|labels| labels[pixel] == PixelLabel::Ignored)
}

/// Length of the ray through a pixel's centre to the depth of one metre.
fn slant(view: &PinholeView, pixel: usize) -> f32 {
    let x = ((pixel % view.width) as f32 + 0.5 - view.cx) / view.fx;
    let y = ((pixel / view.width) as f32 + 0.5 - view.cy) / view.fy;
    (1.0 + x * x + y * y).sqrt()
}

/// The input views, those that resolve finest first, by the distance of their frame from the mean of their frames; those of the same
/// distance in their order.
fn from_the_middle(views: &[View]) -> Vec<&View> {
    let mut inputs: Vec<&View> = views.iter().filter(|view| view.role == Role::Input).collect();
    let (sum, count) = (inputs.iter().map(|view| view.frame).sum::<usize>(), inputs.len());
    // Times the count, so that all stays whole.
    inputs.sort_by_key(|view| (Reverse(view.pinhole.resolution()), (view.frame * count).abs_diff(sum)));
    inputs
}

#[cfg(test)]
mod tests {
    use super::from_the_middle;
    use crate::views::{
        Role, View,
        samples::{ahead, seen},
    };

    #[test]
    fn the_middle_comes_first_and_held_out_views_never() {
        let view = |frame: usize| View {
            frame,
            role: if frame.is_multiple_of(2) { Role::Input } else { Role::HeldOut },
            ..seen(ahead(1, 1, 1.0), vec![0.0; 3])
        };
        let order = |frames: &[usize]| -> Vec<usize> {
            let views: Vec<View> = frames.iter().map(|&frame| view(frame)).collect();
            from_the_middle(&views).iter().map(|view| view.frame).collect()
        };
        assert_eq!(order(&[0, 1, 2, 3, 4]), [2, 0, 4]);
        assert_eq!(order(&[0, 2, 4, 6]), [2, 4, 0, 6]);
        assert_eq!(order(&[0, 1, 2]), [0, 2]);
        assert!(order(&[1]).is_empty());
    }
}
