//! Small clips, scenes and views that the cases spoil.

use std::cell::Cell;
use std::path::Path;
use std::sync::Arc;

use lgs_engine::gaussians::background::Mode;
use lgs_engine::gaussians::physical::{Splat, SplatGradient, to_physical};
use lgs_engine::gaussians::{GaussianSet, LOG_SCALE, LOGIT_COLOUR, MEAN, NUM_ATTRIBUTES, QUAT};
use lgs_engine::pipeline::{Opening, Reconstruction, Run, Session, Silent, Watch};
use lgs_engine::render::gpu::render_and_backward;
use lgs_engine::render::{ImageGradient, Rendered, backward, render, render_for_gradient};
use lgs_engine::views::{DepthSample, PinholeView, Role, Selection, View};
use lgs_formats::camera::{Camera, Intrinsics};
use lgs_formats::clip::{CameraRecord, Clip, Frame, LidarRecord};
use lgs_formats::clip_dir::{ClipDir, write_clip};
use lgs_formats::image::{ImageSize, RgbImage, write_png};
use lgs_formats::pose::Pose;
use lgs_formats::sweep::{Sweep, write_sweep};
use lgs_tests::Outcome;
use lgs_tests::random::Random;
use libtest_mimic::Failed;

use super::{all_finite, ensure, failed};
use crate::gpu::adapter;

/// Width and height of the images of made clips, pixels.
pub(super) const SIZE: [u32; 2] = [24, 16];

/// A sweep of a made clip.
pub(super) struct MadeFrame {
    pub(super) time: f64,
    pub(super) points: Vec<[f32; 3]>,
}

/// A wall of returns, eight metres ahead.
pub(super) fn wall() -> Vec<[f32; 3]> {
    (0..200_u16).map(|k| [8.0, f32::from(k % 20) * 0.5 - 5.0, f32::from(k / 20) * 0.5 - 2.5]).collect()
}

/// Frames of the wall at these times.
pub(super) fn walls(times: &[f64]) -> Vec<MadeFrame> {
    times.iter().map(|&time| MadeFrame { time, points: wall() }).collect()
}

/// Writes a clip: a `LiDAR` (x ahead, z up) and a camera that looks ahead from the same place.
pub(super) fn write(root: &Path, frames: &[MadeFrame]) -> Outcome {
    let [width, height] = SIZE;
    let ahead = [[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
    let world_from_camera = Pose::from_rows(&ahead)?;
    let mut records = Vec::new();
    for (k, made) in frames.iter().enumerate() {
        let [lidar, image] = [format!("{k}.bin"), format!("{k}.png")];
        let sweep =
            Sweep { intensities: vec![0.0; made.points.len()], points: made.points.clone(), ..Sweep::default() };
        write_sweep(&root.join(&lidar), &sweep)?;
        let data = (0..width * height * 3).map(|v| (v % 7) as f32 / 7.0).collect();
        let picture = RgbImage { width: width as usize, height: height as usize, data };
        write_png(&root.join(&image), &picture)?;
        let camera = Camera {
            name: "front".to_owned(),
            timestamp: made.time,
            width,
            height,
            intrinsics: Intrinsics { fx: 20.0, fy: 20.0, cx: 12.0, cy: 8.0 },
            distortion: None,
            readout: None,
            world_from_camera,
        };
        records.push(Frame {
            lidar: LidarRecord::new(lidar.into(), made.time, Pose::IDENTITY),
            cameras: vec![CameraRecord { file: image.into(), mask: None, depth: None, camera }],
            boxes: None,
        });
    }
    let clip = Clip { name: "tiny".to_owned(), source: "made".to_owned(), licence: "none".to_owned(), frames: records };
    Ok(write_clip(root, &clip)?)
}

/// A clip, reconstructed without a network and drawn from all of its cameras.
pub(super) struct Reconstructed {
    pub(super) scene: GaussianSet,
    pub(super) images: Vec<Rendered>,
}

/// The reconstruction of a clip directory from all of its frames.
pub(super) fn reconstructed(root: &Path, image_size: Option<ImageSize>) -> Result<Reconstructed, Failed> {
    let dir = ClipDir::open(root).map_err(failed)?;
    let selection = Selection { image_size, ..Selection::default() };
    let mut watch = Watch::new(&Silent);
    let session = Session::open(Arc::new(dir), Opening::of(selection), &mut watch).map_err(failed)?;
    let made: Reconstruction = session.run(&Run::initial(Mode::Auto.into()), &mut watch).map_err(failed)?;
    let views = session.into_views();
    let splats = to_physical(&made.scene);
    let images = views.iter().map(|view| render(&splats, &view.pinhole, [0.0; 3])).collect();
    made.scene.check_finite().map_err(failed)?;
    Ok(Reconstructed { scene: made.scene, images })
}

/// The reconstruction of a made clip, whose scene and images are finite.
pub(super) fn reconstructed_of(frames: &[MadeFrame]) -> Result<Reconstructed, Failed> {
    let place = tempfile::tempdir()?;
    write(place.path(), frames)?;
    let made = reconstructed(place.path(), None)?;
    made.images.iter().try_for_each(finite_image)?;
    Ok(made)
}

/// Fails unless colours, alphas and depths are finite, and alphas lie in 0..=1.
pub(super) fn finite_image(image: &Rendered) -> Outcome {
    all_finite("rgb", image.rgb.iter().copied())?;
    all_finite("depth", image.depth.iter().copied())?;
    all_finite("expected depth", image.expected_depth())?;
    ensure(image.alpha.iter().all(|a| (0.0..=1.0).contains(a)), || "an alpha outside 0..=1".to_owned())
}

/// A camera at the origin that looks along z.
pub(super) const AHEAD: PinholeView = PinholeView {
    width: 33,
    height: 17,
    fx: 40.0,
    fy: 50.0,
    cx: 16.5,
    cy: 8.5,
    camera_from_clip: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
    time: 0.0,
    shutter: None,
    pixel_side: 1.0,
};

/// Raw attributes of a grey, half transparent sphere of 0.25 m, four metres ahead.
pub(super) fn sphere() -> [f32; NUM_ATTRIBUTES] {
    let mut row = [0.0; NUM_ATTRIBUTES];
    row[MEAN.end - 1] = 4.0;
    row[QUAT.start] = 1.0;
    row[LOG_SCALE].fill(0.25_f32.ln());
    row
}

/// The set of rows at rest, of the time 0.
pub(super) fn set_of(rows: Vec<[f32; NUM_ATTRIBUTES]>, num_lidar: usize) -> GaussianSet {
    let n = rows.len();
    GaussianSet { attributes: rows, times: vec![0.0; n], frames: vec![0; n], velocities: vec![[0.0; 3]; n], num_lidar }
}

/// The image of a set, after it and its gradients were found to be finite.
pub(super) fn drawn(set: &GaussianSet) -> Result<Rendered, Failed> {
    let splats = to_physical(set);
    drawn_splats(&splats).map(|(image, _)| image)
}

thread_local! {
    /// Whether what a case draws is drawn on a GPU.
    static ON_GPU: Cell<bool> = const { Cell::new(false) };
}

/// What comes of a case that draws on a GPU.
pub(super) fn on_gpu(body: fn() -> Outcome) -> Outcome {
    ON_GPU.set(true);
    let outcome = body();
    ON_GPU.set(false);
    outcome
}

/// The image and the gradients of physical values, which are finite.
pub(super) fn drawn_splats(splats: &[Splat]) -> Result<(Rendered, Vec<SplatGradient>), Failed> {
    let behind = [0.25, 0.5, 0.125];
    let ones = ImageGradient {
        rgb: vec![1.0; 3 * AHEAD.num_pixels()],
        alpha: vec![1.0; AHEAD.num_pixels()],
        ..ImageGradient::default()
    };
    let (images, gradients) = if ON_GPU.get() {
        let gpu = adapter::gpu().map_err(|needed| format!("{needed:?}"))?;
        let drawn = render_and_backward(gpu, splats, &AHEAD, behind, &ones, [&[], &[]]).map_err(failed)?;
        (drawn.images, drawn.splats)
    } else {
        let state = render_for_gradient(splats, &AHEAD, behind);
        let gradients = backward(splats, &AHEAD, &state, &ones);
        (state.images, gradients)
    };
    finite_image(&images)?;
    for g in &gradients {
        all_finite("gradient", [&g.mean[..], &g.quat, &g.scale, &[g.opacity], &g.colour, &g.velocity].concat())?;
    }
    Ok((images, gradients))
}

/// A random scene of `count` Gaussians of two moments in front of a camera, the last tenth of them background, and the view of an image
/// of noise with some depths.
pub(super) fn noise(count: usize, seed: u64) -> (GaussianSet, View) {
    let mut random = Random::new(seed);
    let mut set = GaussianSet::default();
    for i in 0..count {
        let mut row = sphere();
        row[MEAN].copy_from_slice(&[
            random.uniform_single(-1.5, 1.5),
            random.uniform_single(-0.6, 0.6),
            random.uniform_single(3.0, 7.0),
        ]);
        row[LOG_SCALE].fill(random.uniform_single(-2.6, -1.6));
        row[LOGIT_COLOUR].fill(random.normal_single());
        set.attributes.push(row);
        set.times.push(if i % 2 == 0 { 0.0 } else { 0.1 });
        set.frames.push(u32::from(i % 2 == 1));
        set.velocities.push([0.0; 3]);
    }
    set.num_lidar = count - count / 10;
    let data = (0..AHEAD.num_pixels() * 3).map(|_| random.uniform_single(0.0, 1.0)).collect();
    (set, view_of(data))
}

/// The view of an image, with a depth of five metres in every seventh pixel.
pub(super) fn view_of(data: Vec<f32>) -> View {
    let depth_samples = (0..561).step_by(7).map(|pixel| DepthSample { pixel, depth: 5.0 }).collect();
    let image = RgbImage { width: AHEAD.width, height: AHEAD.height, data };
    let camera = "ahead".to_owned();
    View {
        frame: 0,
        camera,
        role: Role::Input,
        pinhole: AHEAD,
        image,
        labels: None,
        response: None,
        depth_map: None,
        depth_samples,
    }
}
