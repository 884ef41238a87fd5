//! Variation of what a step is computed from: crops, light, the initial Gaussians.

use lgs_engine::{
    gaussians::{GaussianSet, LOG_SCALE, LOGIT_COLOUR, LOGIT_OPACITY},
    views::{DepthSample, View},
};

use crate::scenes::{dice::Dice, maths::narrow};

/// A part of an image, pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// First column.
    pub left: usize,
    /// First row.
    pub top: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Window {
    /// A window of at most `height` x `width` somewhere in an image of `size` (height, width).
    pub(crate) fn draw(dice: &mut Dice, size: [usize; 2], [height, width]: [usize; 2]) -> Self {
        let (height, width) = (height.min(size[0]), width.min(size[1]));
        let (top, left) = (dice.between(0, size[0] - height), dice.between(0, size[1] - width));
        Self { left, top, width, height }
    }

    /// The part of the view that lies in the window, which is cut to the image.
    pub fn of(&self, view: &View) -> View {
        let (full_width, full_height) = (view.pinhole.width, view.pinhole.height);
        let (left, top) = (self.left.min(full_width - 1), self.top.min(full_height - 1));
        let (width, height) = (self.width.min(full_width - left), self.height.min(full_height - top));
        let rows = || top..top + height;
        let mut pinhole = view.pinhole;
        (pinhole.width, pinhole.height) = (width, height);
        pinhole.cx -= left as f32;
        pinhole.cy -= top as f32;
        let mut image = view.image.clone();
        (image.width, image.height) = (width, height);
        image.data =
            rows().flat_map(|y| &view.image.data[3 * (y * full_width + left)..][..3 * width]).copied().collect();
        let labels = view.labels.as_ref().map(|labels| {
            rows().flat_map(|y| &labels[y * full_width + left..][..width]).copied().collect::<Vec<_>>()
        });
        let depth_samples = view.depth_samples.iter().filter_map(|sample| {
            let (x, y) = (sample.pixel as usize % full_width, sample.pixel as usize / full_width);
            let inside = (left..left + width).contains(&x) && rows().contains(&y);
            let pixel = u32::try_from((y.checked_sub(top)?) * width + x.checked_sub(left)?).ok()?;
            inside.then_some(DepthSample { pixel, depth: sample.depth })
        });
        let depth_samples = depth_samples.collect();
        View { camera: view.camera.clone(), pinhole, image, labels, depth_samples, ..*view }
    }
}

/// Another light for a whole clip: `gain_c x^gamma`, per colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    gain: [f32; 3],
    gamma: f32,
}

impl Light {
    /// Some light; in one of three cases the clip's own.
    pub(crate) fn draw(dice: &mut Dice) -> Self {
        if dice.chance(1.0 / 3.0) {
            return Self { gain: [1.0; 3], gamma: 1.0 };
        }
        let all = dice.uniform(0.6, 1.35);
        let gain = std::array::from_fn(|_| narrow(all * dice.uniform(0.85, 1.15)));
        Self { gain, gamma: narrow(dice.uniform(0.75, 1.5)) }
    }

    /// Changes the colours of a view.
    pub fn apply(&self, view: &mut View) {
        for pixel in view.image.data.as_chunks_mut::<3>().0 {
            for (value, gain) in pixel.iter_mut().zip(self.gain) {
                *value = (gain * value.powf(self.gamma)).clamp(0.0, 1.0);
            }
        }
    }
}

/// Moves the initial Gaussians away from where inference starts: sizes and opacities as a whole, colours one by one.
pub(crate) fn disturb(set: &mut GaussianSet, dice: &mut Dice) {
    let num_lidar = set.num_lidar;
    for branch in [0..num_lidar, num_lidar..set.len()] {
        let (size, opacity, colour) = (dice.normal() * 0.25, dice.uniform(-0.7, 1.0), dice.uniform(0.0, 0.3));
        for row in &mut set.attributes[branch] {
            row[LOG_SCALE].iter_mut().for_each(|s| *s += narrow(size));
            row[LOGIT_OPACITY] += narrow(opacity);
            row[LOGIT_COLOUR].iter_mut().for_each(|c| *c += narrow(colour * dice.normal()));
        }
    }
}
