//! A small scene in front of a small camera.

use lgs_engine::gaussians::{GaussianSet, LOG_SCALE, LOGIT_COLOUR, MEAN, QUAT};
use lgs_engine::views::{DepthSample, PinholeView, Role, View};
use lgs_formats::image::RgbImage;
use lgs_tests::random::Random;

/// Gaussians of [`scene`].
pub(super) const NUM_POINTS: usize = 200;

/// Gaussians of two moments, all of them in view.
pub(super) fn scene(random: &mut Random) -> GaussianSet {
    let mut set = GaussianSet::default();
    for i in 0..NUM_POINTS {
        let mut row = [0.0_f32; 14];
        row[MEAN].copy_from_slice(&[
            random.uniform_single(-2.0, 2.0),
            random.uniform_single(-1.2, 1.2),
            random.uniform_single(3.0, 7.0),
        ]);
        row[QUAT.start] = 1.0;
        row[LOG_SCALE].fill(random.uniform_single(-2.6, -1.6));
        row[LOGIT_COLOUR].copy_from_slice(&[0.0; 3].map(|_: f32| random.normal_single()));
        set.attributes.push(row);
        set.times.push(if i % 2 == 0 { 0.0 } else { 0.1 });
        set.frames.push(u32::from(i % 2 == 1));
        set.velocities.push([0.0; 3]);
    }
    set.num_lidar = NUM_POINTS;
    set
}

/// A camera that looks along z, with an image of noise and some depths.
pub(super) fn view(random: &mut Random) -> View {
    let (width, height) = (40, 28);
    let pinhole = PinholeView {
        width,
        height,
        fx: 36.0,
        fy: 36.0,
        cx: 20.0,
        cy: 14.0,
        camera_from_clip: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
        time: 0.05,
        shutter: None,
        pixel_side: 1.0,
    };
    let data = (0..width * height * 3).map(|_| random.uniform_single(0.0, 1.0)).collect();
    let depth_samples =
        (0..40).map(|k| DepthSample { pixel: 28 * k, depth: random.uniform_single(3.0, 7.0) }).collect();
    let image = RgbImage { width, height, data };
    View {
        frame: 0,
        camera: "a".to_owned(),
        role: Role::Input,
        pinhole,
        image,
        labels: None,
        response: None,
        depth_map: None,
        depth_samples,
    }
}
