//! The background branch: static Gaussians behind what the sweeps leave uncovered.

mod coverage;
mod depth;
mod emit;
mod sky;

use rayon::prelude::*;

use self::coverage::{Coverage, Round};
use super::GaussianSet;
use crate::{
    points::PointCloud,
    views::{Role, View},
};

/// Where the background comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// The one that scored best on held-out frames: [`Mode::Depth`].
    #[default]
    Auto,
    /// No background.
    Off,
    /// A hemisphere far away, above the horizon.
    Sky,
    /// Where the returns around an uncovered pixel continue to.
    Depth,
}

/// Inverse depths (1 / metres, along the camera's z axis) of a view's pixels; NaN where nothing is known.
#[derive(Clone, Debug)]
struct Sheet(Vec<f32>);

/// Nothing: appends static Gaussians to `set` where its `LiDAR` branch leaves pixels of the input views uncovered.
///
/// View after view, from the middle frame outwards: a Gaussian that one view asked for covers pixels of those after it, and one that
/// stands at a wrong depth is less wrong in the others the nearer they are.
pub fn add_background(set: &mut GaussianSet, views: &[View], cloud: &PointCloud, mode: Mode) {
    let inputs = from_the_middle(views);
    let sheets: Vec<Sheet> = match mode {
        Mode::Off => return,
        Mode::Sky => sky::sheets(&inputs, cloud),
        Mode::Auto | Mode::Depth => depth::sheets(&inputs, sky::radius(cloud)),
    };
    let rounds = Round::of(&set.attributes);
    let mut coverages: Vec<Coverage> = inputs
        .par_iter()
        .map(|view| {
            let mut coverage = Coverage::new(&view.pinhole);
            coverage.add(&view.pinhole, &rounds);
            coverage
        })
        .collect();
    for k in 0..inputs.len() {
        let rows = emit::rows(inputs[k], &sheets[k], &coverages[k]);
        let rounds = Round::of(&rows);
        let later = inputs.par_iter().zip(&mut coverages).skip(k + 1);
        later.for_each(|(view, coverage)| coverage.add(&view.pinhole, &rounds));
        set.attributes.extend(rows);
    }
    set.times.resize(set.len(), 0.0);
    set.velocities.resize(set.len(), [0.0; 3]);
}

/// The input views by the distance of their frame from the mean of their frames; those of the same distance in their order.
fn from_the_middle(views: &[View]) -> Vec<&View> {
    let mut inputs: Vec<&View> = views.iter().filter(|view| view.role == Role::Input).collect();
    let (sum, count) = (inputs.iter().map(|view| view.frame).sum::<usize>(), inputs.len());
    // Times the count, so that all stays whole.
    inputs.sort_by_key(|view| (view.frame * count).abs_diff(sum));
    inputs
}

#[cfg(test)]
mod tests {
    use super::from_the_middle;
    use crate::views::{PinholeView, Role, View};
    use lgs_formats::image::RgbImage;

    #[test]
    fn the_middle_comes_first_and_held_out_views_never() {
        let pinhole = PinholeView {
            width: 1,
            height: 1,
            fx: 1.0,
            fy: 1.0,
            cx: 0.5,
            cy: 0.5,
            camera_from_clip: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
            time: 0.0,
        };
        let image = RgbImage { width: 1, height: 1, data: vec![0.0; 3] };
        let view = |frame: usize| View {
            frame,
            camera: "a".to_owned(),
            role: if frame.is_multiple_of(2) { Role::Input } else { Role::HeldOut },
            pinhole,
            image: image.clone(),
            labels: None,
            depth_samples: Vec::new(),
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
