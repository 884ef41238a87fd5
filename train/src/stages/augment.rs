//! Variation of what a step is computed from: crops, light, the initial Gaussians.

use lgs_engine::{
    gaussians::{GaussianSet, LOG_SCALE, LOGIT_COLOUR, LOGIT_OPACITY, MEAN, QUAT},
    views::{DepthSample, View},
};
use lgs_formats::image::DepthMap;

use crate::scenes::{maths::narrow, rng::Rng};

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
    pub(crate) fn draw(rng: &mut Rng, size: [usize; 2], [height, width]: [usize; 2]) -> Self {
        let (height, width) = (height.min(size[0]), width.min(size[1]));
        let (top, left) = (rng.between(0, size[0] - height), rng.between(0, size[1] - width));
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
        pinhole.shutter = pinhole.shutter.map(|shutter| shutter.cropped([left as f32, top as f32]));
        let mut image = view.image.clone();
        (image.width, image.height) = (width, height);
        image.data =
            rows().flat_map(|y| &view.image.data[3 * (y * full_width + left)..][..3 * width]).copied().collect();
        let labels = view
            .labels
            .as_ref()
            .map(|labels| rows().flat_map(|y| &labels[y * full_width + left..][..width]).copied().collect::<Vec<_>>());
        let depth_samples = view.depth_samples.iter().filter_map(|sample| {
            let (x, y) = (sample.pixel as usize % full_width, sample.pixel as usize / full_width);
            let inside = (left..left + width).contains(&x) && rows().contains(&y);
            let pixel = u32::try_from((y.checked_sub(top)?) * width + x.checked_sub(left)?).ok()?;
            inside.then_some(DepthSample { pixel, depth: sample.depth })
        });
        let depth_samples = depth_samples.collect();
        let depth_map = view.depth_map.as_ref().map(|map| DepthMap {
            inverse: rows().flat_map(|y| &map.inverse[y * full_width + left..][..width]).copied().collect(),
            ..*map
        });
        View { camera: view.camera.clone(), pinhole, image, labels, depth_map, depth_samples, ..*view }
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
    pub(crate) fn draw(rng: &mut Rng) -> Self {
        if rng.chance(1.0 / 3.0) {
            return Self { gain: [1.0; 3], gamma: 1.0 };
        }
        let all = rng.uniform(0.6, 1.35);
        let gain = std::array::from_fn(|_| narrow(all * rng.uniform(0.85, 1.15)));
        Self { gain, gamma: narrow(rng.uniform(0.75, 1.5)) }
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
pub(crate) fn disturb(set: &mut GaussianSet, rng: &mut Rng) {
    let num_lidar = set.num_lidar;
    for branch in [0..num_lidar, num_lidar..set.len()] {
        let (size, opacity, colour) = (rng.normal() * 0.25, rng.uniform(-0.7, 1.0), rng.uniform(0.0, 0.3));
        for row in &mut set.attributes[branch] {
            row[LOG_SCALE].iter_mut().for_each(|s| *s += narrow(size));
            row[LOGIT_OPACITY] += narrow(opacity);
            row[LOGIT_COLOUR].iter_mut().for_each(|c| *c += narrow(colour * rng.normal()));
        }
    }
}

/// Adds normal noise of a standard deviation up to `most` to the colours of views, one deviation for all of them.
pub(crate) fn add_noise(views: &mut [View], most: f64, rng: &mut Rng) {
    let deviation = rng.uniform(0.0, most);
    for value in views.iter_mut().flat_map(|view| &mut view.image.data) {
        *value = (*value + narrow(deviation * rng.normal())).clamp(0.0, 1.0);
    }
}

/// The scene and its views as a mirror shows them that stands upright along the x axis of the clip frame.
pub(crate) fn mirror(set: &mut GaussianSet, views: &mut [View]) {
    for (row, velocity) in set.attributes.iter_mut().zip(&mut set.velocities) {
        row[MEAN][1] *= -1.0;
        velocity[1] *= -1.0;
        // (w, x, y, z): the axis of a turn is mirrored and its sense reversed.
        row[QUAT][1] *= -1.0;
        row[QUAT][3] *= -1.0;
    }
    for view in views {
        let width = view.pinhole.width;
        view.pinhole.cx = width as f32 - view.pinhole.cx;
        view.pinhole.shutter = view.pinhole.shutter.map(|shutter| shutter.mirrored(width));
        // To the right in the mirror is what was to the left, in the clip frame along y and in the camera along x.
        for (k, row) in view.pinhole.camera_from_clip.iter_mut().enumerate() {
            row[1] *= -1.0;
            if k == 0 {
                row.iter_mut().for_each(|v| *v *= -1.0);
            }
        }
        for row in view.image.data.chunks_exact_mut(3 * width) {
            row.reverse();
            row.as_chunks_mut::<3>().0.iter_mut().for_each(|pixel| pixel.reverse());
        }
        if let Some(labels) = &mut view.labels {
            labels.chunks_exact_mut(width).for_each(<[_]>::reverse);
        }
        if let Some(map) = &mut view.depth_map {
            map.inverse.chunks_exact_mut(width).for_each(<[_]>::reverse);
        }
        for sample in &mut view.depth_samples {
            if let Ok(width) = u32::try_from(width) {
                let column = sample.pixel % width;
                sample.pixel = sample.pixel - column + (width - 1 - column);
            }
        }
        view.depth_samples.sort_by_key(|sample| sample.pixel);
    }
}

#[cfg(test)]
mod tests {
    use lgs_engine::views::{DepthSample, PinholeView, Role, View};
    use lgs_formats::{
        clip::DepthKind,
        image::{DepthMap, PixelLabel, RgbImage},
    };

    use lgs_engine::gaussians::GaussianSet;

    use super::{Light, Rng, Window, add_noise, mirror};

    fn view(width: usize, height: usize) -> View {
        let pinhole = PinholeView {
            width,
            height,
            fx: 9.0,
            fy: 8.0,
            cx: 3.5,
            cy: 2.5,
            camera_from_clip: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
            time: 0.0,
            shutter: None,
            pixel_side: 1.0,
        };
        let data = (0..width * height).flat_map(|i| [i as f32 / 100.0; 3]).collect();
        let labels = (0..width * height).map(|i| if i % 3 == 0 { PixelLabel::Dynamic } else { PixelLabel::Static });
        let depth_samples = (0..).take(width * height).map(|pixel| DepthSample { pixel, depth: pixel as f32 });
        View {
            frame: 4,
            camera: "front".to_owned(),
            role: Role::Input,
            pinhole,
            image: RgbImage { width, height, data },
            labels: Some(labels.collect()),
            response: None,
            depth_map: Some(DepthMap {
                kind: DepthKind::Metric,
                inverse: (0..width * height).map(|i| i as f32).collect(),
            }),
            depth_samples: depth_samples.collect(),
        }
    }

    fn of_map(view: &View, pixel: usize) -> f32 {
        view.depth_map.as_ref().unwrap().inverse[pixel]
    }

    #[test]
    fn a_crop_shows_the_same_rays() {
        let whole = view(7, 5);
        let part = Window { left: 2, top: 1, width: 4, height: 3 }.of(&whole);
        assert_eq!((part.pinhole.width, part.pinhole.height, part.depth_samples.len()), (4, 3, 12));
        for (x, y) in [(0, 0), (3, 2), (1, 2)] {
            let (inner, outer) = (y * 4 + x, (y + 1) * 7 + x + 2);
            assert_eq!(part.image.data[3 * inner], whole.image.data[3 * outer]);
            assert_eq!(part.labels.as_ref().unwrap()[inner], whole.labels.as_ref().unwrap()[outer]);
            assert_eq!(part.depth_samples[inner].depth, whole.depth_samples[outer].depth);
            assert_eq!(of_map(&part, inner), of_map(&whole, outer));
            assert_eq!(part.depth_samples[inner].pixel as usize, inner);
        }
        let point = [0.3, -0.1, 4.0];
        let (a, b) = (whole.pinhole.project(point).unwrap(), part.pinhole.project(point).unwrap());
        assert!((a.u - b.u - 2.0).abs() < 1e-5 && (a.v - b.v - 1.0).abs() < 1e-5);
    }

    #[test]
    fn a_window_is_cut_to_the_image() {
        let part = Window { left: 5, top: 4, width: 100, height: 100 }.of(&view(7, 5));
        assert_eq!((part.pinhole.width, part.pinhole.height, part.image.data.len()), (2, 1, 6));
    }

    #[test]
    fn a_mirrored_scene_looks_like_a_mirrored_image() {
        let mut mirrored = [view(7, 5)];
        let plain = &view(7, 5);
        let mut set = GaussianSet {
            attributes: vec![std::array::from_fn(|k| 0.1 * k as f32)],
            times: vec![0.0],
            frames: vec![0],
            velocities: vec![[1.0, 2.0, 3.0]],
            num_lidar: 1,
        };
        let before = set.attributes[0];
        mirror(&mut set, &mut mirrored);
        let row = set.attributes[0];
        assert_eq!(
            (row[1], row[3], row[4], row[5], row[6]),
            (-before[1], before[3], -before[4], before[5], -before[6])
        );
        assert_eq!(set.velocities[0], [1.0, -2.0, 3.0]);
        let mirrored = &mirrored[0];
        let (a, b) =
            (plain.pinhole.project([0.3, -0.1, 4.0]).unwrap(), mirrored.pinhole.project([0.3, 0.1, 4.0]).unwrap());
        assert!((a.u + b.u - 7.0).abs() < 1e-5 && (a.v - b.v).abs() < 1e-6, "{} {}", a.u, b.u);
        let [r0, r1, r2] = mirrored.pinhole.camera_from_clip.map(|r| glam::Vec3::new(r[0], r[1], r[2]));
        assert!((r0.cross(r1).dot(r2) - 1.0).abs() < 1e-6, "a camera stays right-handed");
        for y in 0..5 {
            for x in 0..7 {
                let (from, to) = (y * 7 + x, y * 7 + 6 - x);
                assert_eq!(mirrored.image.data[3 * to..3 * to + 3], plain.image.data[3 * from..3 * from + 3]);
                assert_eq!(mirrored.labels.as_ref().unwrap()[to], plain.labels.as_ref().unwrap()[from]);
                assert_eq!(mirrored.depth_samples[to].depth, plain.depth_samples[from].depth);
                assert_eq!(of_map(mirrored, to), of_map(plain, from));
            }
        }
    }

    #[test]
    fn noise_has_its_deviation_and_stays_in_range() {
        let mut views = [view(40, 40)];
        views[0].image.data.fill(0.5);
        add_noise(&mut views, 0.0, &mut Rng::new(1, 2));
        assert!(views[0].image.data.iter().all(|v| *v == 0.5));
        add_noise(&mut views, 1.0, &mut Rng::new(1, 2));
        assert!(views[0].image.data.iter().all(|v| (0.0..=1.0).contains(v)));
        assert!(views[0].image.data.iter().any(|v| *v != 0.5));
    }

    #[test]
    fn light_stays_in_range() {
        let mut lit = view(7, 5);
        Light { gain: [2.0, 0.5, 1.0], gamma: 0.8 }.apply(&mut lit);
        assert!(lit.image.data.iter().all(|v| (0.0..=1.0).contains(v)));
        let expected = 0.5 * 0.2_f32.powf(0.8);
        assert!((lit.image.data[3 * 20 + 1] - expected).abs() < 1e-6);
    }
}
