//! The background branch: what stands behind, between and above the returns.

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

use lgs_formats::{casts::to_u32, image::PixelLabel};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

pub use self::maps::MapFit;
use self::{
    coverage::{Coverage, Shape},
    depth::Trust,
    emit::Wanted,
    maps::Aligned,
};
use super::{Coarseness, Gaussian, GaussianSet, NUM_ATTRIBUTES, Start, mean_of, motion::Movement};
use crate::{
    points::{PointCloud, samples_at},
    views::{PinholeView, Role, View},
};

/// Images of one camera that are nearer in time than this say nothing about its speed, seconds.
const SAME_MOMENT: f32 = 1e-3;

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
    let shapes = Shape::moving(set);
    let covered = |view: &&View| {
        let mut coverage = Coverage::new(&view.pinhole);
        coverage.add(&view.pinhole, &shapes);
        coverage
    };
    let coverages = views.par_iter().map(covered).collect();
    let mut backdrop = Backdrop { views, sheets, coverages };
    backdrop.add_moving(set, cloud, &things, coarseness);
    backdrop.add_pixels(set, coarseness);
    if matches!(mode, Mode::Sky | Mode::Gaps) {
        return fits;
    }
    backdrop.add_own_vehicle(set, coarseness);
    let behind = |(view, sheet): (&&View, &Sheet)| backstop::rows(view, sheet, coarseness);
    let behind: Vec<_> = backdrop.views.par_iter().zip(&backdrop.sheets).map(behind).collect();
    backdrop.views.iter().zip(behind).for_each(|(view, rows)| append(set, view, rows));
    fits
}

/// What is behind the pixels of the input views, and which of them Gaussians cover.
struct Backdrop<'a> {
    /// From the middle frame outwards.
    views: Vec<&'a View>,
    /// `[views]`
    sheets: Vec<Sheet>,
    /// `[views]`
    coverages: Vec<Coverage>,
}

impl<'a> Backdrop<'a> {
    /// Appends Gaussians for the uncovered pixels of what moves, and takes these pixels from the sheets.
    fn add_moving(
        &mut self,
        set: &mut GaussianSet,
        still: &PointCloud,
        things: &[moving::Thing],
        coarseness: Coarseness,
    ) {
        let velocities = vec![[0.0; 3]; still.len()];
        for k in 0..self.views.len() {
            let view = self.views[k];
            let things: Vec<&moving::Thing> =
                things.iter().filter(|thing| u32::try_from(view.frame) == Ok(thing.flow.frame)).collect();
            let standing = samples_at(still, &velocities, view);
            let shown = moving::shown(view, &self.sheets[k], &standing, &things, &self.sources(k));
            let mut own = Sheet::unknown(view);
            for (thing, shown) in things.into_iter().zip(shown) {
                let Some(shown) = shown else { continue };
                for &(pixel, inverse) in &shown.pixels {
                    self.sheets[k].trust[pixel] = Trust::Unknown;
                    (own.inverse_depths[pixel], own.trust[pixel]) = (inverse, Trust::Alone);
                }
                let wanted = Wanted { trust: Trust::Alone, rows: shown.rows };
                let rows = emit::rows(view, &own, &self.coverages[k], wanted, &[], coarseness);
                shown.pixels.iter().for_each(|&(pixel, _)| own.trust[pixel] = Trust::Unknown);
                let first = set.len();
                moving::append(set, view, thing, &rows);
                let mut shapes = Shape::of(&set.attributes[first..]);
                for (shape, i) in shapes.iter_mut().zip(first..) {
                    shape.move_as(set.times[i], set.velocities[i]);
                }
                self.cover(&shapes);
            }
        }
    }

    /// Appends Gaussians for all uncovered pixels of a known depth.
    fn add_pixels(&mut self, set: &mut GaussianSet, coarseness: Coarseness) {
        for trust in [Trust::Confirmed, Trust::Alone, Trust::Contradicted] {
            for k in 0..self.views.len() {
                let view = self.views[k];
                let wanted = Wanted { trust, rows: 0..view.pinhole.height };
                let rows = emit::rows(view, &self.sheets[k], &self.coverages[k], wanted, &self.sources(k), coarseness);
                self.cover(&Shape::of(&rows));
                append(set, view, rows);
            }
        }
    }

    /// Appends Gaussians for the own vehicle as the first view of each camera shows it, which move with the camera.
    fn add_own_vehicle(&self, set: &mut GaussianSet, coarseness: Coarseness) {
        for (k, &view) in self.views.iter().enumerate() {
            let first = !self.views[..k].iter().any(|other| other.camera == view.camera);
            let Some(other) = self.sources(k).first().copied().filter(|_| first) else { continue };
            let nothing = Coverage::new(&view.pinhole);
            let wanted = Wanted { trust: Trust::OwnVehicle, rows: 0..view.pinhole.height };
            let rows = emit::rows(view, &self.sheets[k], &nothing, wanted, &[], coarseness);
            let velocity = velocity(&view.pinhole, &other.pinhole);
            for attributes in rows {
                let time = view.pinhole.exposed_at(mean_of(&attributes));
                set.push(Gaussian { attributes, time, frame: frame_of(view), velocity });
            }
        }
    }

    /// The views that the one at `k` is compared with.
    fn sources(&self, k: usize) -> Vec<&'a View> {
        depth::sources(&self.views, k).into_iter().map(|j| self.views[j]).collect()
    }

    fn cover(&mut self, shapes: &[Shape]) {
        let views = self.views.par_iter().zip(&mut self.coverages);
        views.for_each(|(view, coverage)| coverage.add(&view.pinhole, shapes));
    }
}

/// Appends Gaussians that stand still and that an image asked for.
fn append(set: &mut GaussianSet, view: &View, rows: Vec<[f32; NUM_ATTRIBUTES]>) {
    let frame = frame_of(view);
    for attributes in rows {
        set.push(Gaussian { attributes, time: 0.0, frame, velocity: [0.0; 3] });
    }
}

fn frame_of(view: &View) -> u32 {
    to_u32(view.frame)
}

/// Whether a pixel takes part in nothing.
fn is_ignored(view: &View, pixel: usize) -> bool {
    view.labels.as_ref().is_some_and(|labels| labels[pixel] == PixelLabel::Ignored)
}

/// Velocity (metres a second) of a camera between two of its images; 0 when they were taken at the same moment, or nearly.
fn velocity(from: &PinholeView, to: &PinholeView) -> [f32; 3] {
    let (a, b, seconds) = (from.centre(), to.centre(), to.time - from.time);
    if seconds.abs() < SAME_MOMENT { [0.0; 3] } else { std::array::from_fn(|k| (b[k] - a[k]) / seconds) }
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
