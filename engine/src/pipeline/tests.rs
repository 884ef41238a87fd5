//! The pipeline on a small clip: what is held out changes nothing, and cannot come in.

use std::{
    fs,
    num::NonZeroUsize,
    path::Path,
    sync::{
        Arc, Mutex,
        atomic::{AtomicUsize, Ordering},
    },
};

use glam::{DMat3, DVec3};
use lgs_formats::{
    camera::{Camera, Intrinsics},
    clip::{CameraRecord, Clip, Frame, LidarRecord},
    clip_dir::{ClipDir, write_clip},
    image::{RgbImage, write_png},
    pose::Pose,
    sweep::{Sweep, write_sweep},
};

use super::{
    Deadline, Drawing, Figures, HoldOut, Inputs, Marks, NetworkSummary, PointStep, Progress, Reconstruction, Run,
    Silent, Stage, Watch, begin, evaluate_views,
};
use crate::{
    error::{EngineError, Result},
    gaussians::{GaussianSet, LOGIT_COLOUR, background::Mode, physical::to_physical},
    recipe::Recipe,
    refine::{PixelStride, RefineSummary, adam::AdamRates},
    render::Device,
    views::{ClipFrame, Role, SelectedFrames, Selection, View, load_views},
};

const SIZE: (u32, u32) = (24, 16);
const NUM_FRAMES: u32 = 3;

/// Writes a clip of three frames: a `LiDAR` (x forward, z up) and a camera at the same place, which moves 0.2 m a frame
/// towards a wall 8 m ahead, under `shade`, the brightness of a frame.
fn write_test_clip(root: &Path, shade: fn(u32) -> f32) {
    let wall = (0..600_u16).map(|k| [8.0, f32::from(k % 30) * 0.4 - 6.0, f32::from(k / 30) * 0.4 - 4.0]);
    let wall: Vec<[f32; 3]> = wall.collect();
    let clip_from_camera = DMat3::from_cols(-DVec3::Y, -DVec3::Z, DVec3::X);
    let frames = (0..NUM_FRAMES).map(|frame| {
        let (moved, seconds) = (0.2 * f64::from(frame), 0.1 * f64::from(frame));
        let points = wall.iter().map(|&[x, y, z]| [x - 0.2 * frame as f32, y, z]).collect();
        let sweep = Sweep { points, intensities: vec![0.0; wall.len()], ..Sweep::default() };
        let [lidar, image] = [format!("{frame}.bin"), format!("{frame}.png")].map(std::path::PathBuf::from);
        write_sweep(&root.join(&lidar), &sweep).unwrap();
        let colours = (0..SIZE.0 * SIZE.1 * 3).map(|k| shade(frame) * (k % 7) as f32 / 7.0).collect();
        let rgb = RgbImage { width: SIZE.0 as usize, height: SIZE.1 as usize, data: colours };
        write_png(&root.join(&image), &rgb).unwrap();
        let at = DVec3::new(moved, 0.0, 0.0);
        let camera = Camera {
            name: "front".to_owned(),
            timestamp: seconds,
            width: SIZE.0,
            height: SIZE.1,
            intrinsics: Intrinsics { fx: 20.0, fy: 20.0, cx: 12.0, cy: 8.0 },
            distortion: None,
            readout: None,
            world_from_camera: Pose::new(clip_from_camera, at),
        };
        Frame {
            lidar: LidarRecord::new(lidar, seconds, Pose::new(DMat3::IDENTITY, at)),
            cameras: vec![CameraRecord { file: image, mask: None, depth: None, camera }],
            boxes: None,
        }
    });
    let frames = frames.collect();
    let clip = Clip { name: "wall".to_owned(), source: "a test".to_owned(), licence: "none".to_owned(), frames };
    write_clip(root, &clip).unwrap();
}

/// A clip of which frame 1 is held out.
struct Held {
    dir: Arc<ClipDir>,
    selection: Selection,
    frames: SelectedFrames,
    clip_frame: ClipFrame,
}

impl Held {
    fn open(root: &Path) -> Self {
        let dir = Arc::new(ClipDir::open(root).unwrap());
        let hold_out = HoldOut::Odd.indices(dir.clip().frames.len(), None).unwrap();
        let selection = Selection { hold_out, ..Selection::default() };
        let frames = selection.frames(dir.clip()).unwrap();
        let clip_frame = ClipFrame::of(dir.clip(), frames.input[0]);
        Self { dir, selection, frames, clip_frame }
    }

    fn views(&self, role: Role) -> Result<Vec<View>> {
        load_views(&self.dir, &self.selection, role, &self.clip_frame, &|| ())
    }

    fn inputs(&self, views: Vec<View>) -> Result<Inputs> {
        Inputs::new(Arc::clone(&self.dir), &self.frames, self.clip_frame, views)
    }

    fn reconstruct(&self) -> Reconstruction {
        let inputs = self.inputs(self.views(Role::Input).unwrap()).unwrap();
        let mut watch = Watch::new(&Silent);
        begin(&inputs, &mut watch)
            .unwrap()
            .run(&Run::initial(Mode::Auto.into()), &mut watch, &[], &mut |_, _| ())
            .unwrap()
    }
}

#[test]
fn held_out_files_change_nothing_and_are_not_even_read() {
    let place = tempfile::tempdir().unwrap();
    write_test_clip(place.path(), |_| 0.8);
    let before = Held::open(place.path()).reconstruct();
    assert!(before.counts.initial > 100, "{:?}", before.counts);
    let (lidar, background) = before.scene.frames.split_at(before.scene.num_lidar);
    for part in [lidar, background] {
        assert!([0, 2].iter().all(|frame| part.contains(frame)) && !part.contains(&1), "frames of inputs alone");
    }

    let far = Sweep { points: vec![[1.0, 0.5, 0.0]; 50], intensities: vec![0.0; 50], ..Sweep::default() };
    write_sweep(&place.path().join("1.bin"), &far).unwrap();
    let whole = fs::read(place.path().join("1.png")).unwrap();
    fs::write(place.path().join("1.png"), &whole[..whole.len() / 2]).unwrap();
    let held = Held::open(place.path());
    let after = held.reconstruct();
    assert_eq!((&before.scene, before.counts), (&after.scene, after.counts));
    assert!(held.views(Role::HeldOut).unwrap_err().to_string().contains("1.png"));

    write_test_clip(place.path(), |frame| if frame == 0 { 0.3 } else { 0.8 });
    assert_ne!(Held::open(place.path()).reconstruct().scene, before.scene, "an input image must count");
}

/// Notes the steps that it is told of.
#[derive(Default)]
struct Steps {
    announced: AtomicUsize,
    told: Mutex<Vec<PointStep>>,
}

impl Progress for Steps {
    fn begin(&self, stage: Stage, steps: usize) {
        self.announced.fetch_add(if stage == Stage::Points { steps } else { 0 }, Ordering::Relaxed);
    }

    fn step(&self, _: Stage) {}

    fn point_step(&self, step: PointStep) {
        self.told.lock().unwrap().push(step);
    }

    fn end(&self, _: Stage) {}
}

#[test]
fn every_step_of_the_points_is_announced_and_told_in_its_order() {
    let place = tempfile::tempdir().unwrap();
    write_test_clip(place.path(), |_| 0.8);
    let held = Held::open(place.path());
    let inputs = held.inputs(held.views(Role::Input).unwrap()).unwrap();
    let steps = Steps::default();
    let mut watch = Watch::new(&steps);
    begin(&inputs, &mut watch).unwrap().run(&Run::initial(Mode::Off.into()), &mut watch, &[], &mut |_, _| ()).unwrap();
    assert_eq!(*steps.told.lock().unwrap(), PointStep::ALL);
    assert_eq!(steps.announced.load(Ordering::Relaxed), PointStep::ALL.len());
}

#[test]
fn views_that_are_held_out_cannot_become_inputs() {
    let place = tempfile::tempdir().unwrap();
    write_test_clip(place.path(), |_| 0.8);
    let held = Held::open(place.path());
    let mut views = held.views(Role::Input).unwrap();
    views.extend(held.views(Role::HeldOut).unwrap());
    assert_eq!(views.iter().map(|view| view.frame).collect::<Vec<_>>(), [0, 2, 1]);
    let leaks = |views| matches!(held.inputs(views), Err(EngineError::Leak { frame: 1 }));
    assert!(leaks(views.clone()));
    views[2].role = Role::Input; // a false label does not help: its frame is held out
    assert!(leaks(views.clone()));
    views.truncate(2);
    assert!(!leaks(views));
}

#[test]
fn views_come_back_in_order_with_figures_only_where_there_is_truth() {
    let place = tempfile::tempdir().unwrap();
    write_test_clip(place.path(), |frame| 0.4 + 0.2 * frame as f32);
    let held = Held::open(place.path());
    let reconstruction = held.reconstruct();
    let splats = to_physical(&reconstruction.scene);
    let loaded = held.views(Role::Input).unwrap();
    let views: Vec<&View> = (0..5).flat_map(|_| &loaded).collect(); // more than one batch
    let mut watch = Watch::new(&Silent);
    let truth = Figures::OfTruth { clip: held.dir.clip(), frame: &held.clip_frame, lpips: None };
    let mut draw = |figures| {
        let keep = |drawn: super::RenderedView<'_>| {
            Result::Ok((drawn.view.frame, drawn.figures.map(|f| f.psnr), drawn.rendered.clone()))
        };
        evaluate_views(
            Drawing { scene: &splats, scores: None, device: Device::Cpu },
            &views,
            figures,
            &mut watch,
            &keep,
        )
        .unwrap()
    };
    let (measured, moved) = (draw(truth), draw(Figures::AtTime(0.3)));
    assert_eq!(measured.iter().map(|view| view.0).collect::<Vec<_>>(), [0, 2, 0, 2, 0, 2, 0, 2, 0, 2]);
    assert!(measured.iter().all(|view| view.1.flatten().is_some_and(f64::is_finite)));
    assert!(moved.iter().all(|view| view.1.is_none()));
    // nothing moves in this scene, so another moment looks the same
    assert!(measured.iter().zip(&moved).all(|(a, b)| a.2 == b.2));
    assert!(watch.times.get(Stage::Render) > 0.0 && watch.times.get(Stage::Evaluate) > 0.0);
}

/// So many passes of per-scene optimisation.
fn adam(adam_passes: usize, pixel_stride: PixelStride, deadline: Option<Deadline>) -> Run<'static> {
    let initial = Run::initial(Mode::Auto.into());
    Run { recipe: Recipe { adam_passes, pixel_stride, ..initial.recipe }, deadline, ..initial }
}

fn optimise(made: &mut Reconstruction, inputs: &Inputs, run: &Run<'_>) {
    let marks = Marks { steps: &[], done: &mut |_, _| () };
    made.optimise(inputs, run, AdamRates::default(), &mut Watch::new(&Silent), marks).unwrap();
}

#[test]
fn a_scene_is_optimised_gently_where_learned_steps_have_refined_it() {
    let place = tempfile::tempdir().unwrap();
    write_test_clip(place.path(), |_| 0.8);
    let held = Held::open(place.path());
    let inputs = held.inputs(held.views(Role::Input).unwrap()).unwrap();
    let rates = |learned_steps: Option<usize>| {
        let mut made = held.reconstruct();
        let refined = |steps| RefineSummary { steps, ..RefineSummary::default() };
        made.network = learned_steps.map(|k| NetworkSummary { refine: refined(k), ..NetworkSummary::default() });
        let before = made.scene.clone();
        let mut run = adam(1, PixelStride::ALL, None);
        run.recipe.refine_views = NonZeroUsize::new(inputs.views().len());
        optimise(&mut made, &inputs, &run);
        let colours = |scene: &GaussianSet| -> Vec<f32> {
            scene.attributes.iter().flat_map(|row| row[LOGIT_COLOUR].to_vec()).collect()
        };
        let moved = colours(&before).into_iter().zip(colours(&made.scene)).map(|(a, b)| f64::from((a - b).abs()));
        moved.fold(0.0, f64::max) / AdamRates::default().logit_colour
    };
    for (learned_steps, expected) in [(None, 1.0), (Some(0), 1.0), (Some(2), 0.49)] {
        let found = rates(learned_steps);
        assert!((found - expected).abs() < 0.01, "{learned_steps:?}: {found}");
    }
}

#[test]
fn every_pass_looks_at_every_view_by_one_step_each_or_by_as_many_as_are_asked_for() {
    let place = tempfile::tempdir().unwrap();
    write_test_clip(place.path(), |_| 0.8);
    let held = Held::open(place.path());
    let inputs = held.inputs(held.views(Role::Input).unwrap()).unwrap();
    let num_views = inputs.views().len();
    assert!(num_views > 1);
    let optimised = |refine_views: Option<usize>, seed: u64| {
        let mut made = held.reconstruct();
        let mut run = Run { seed, ..adam(3, PixelStride::ALL, None) };
        run.recipe.refine_views = refine_views.and_then(NonZeroUsize::new);
        optimise(&mut made, &inputs, &run);
        (made.scene, made.optimisation.unwrap().losses)
    };
    let (one, all) = (optimised(None, 0), optimised(Some(num_views), 0));
    assert_eq!([one.1.len(), all.1.len()], [3, 3]);
    assert!([&one.1, &all.1].iter().all(|losses| losses.is_sorted_by(|a, b| a > b)), "{one:?}");
    // With as many drawings, more steps go farther.
    assert!(one.1[2] < all.1[2], "{:?} {:?}", one.1, all.1);
    assert!(one == optimised(Some(1), 0) && one == optimised(None, 0));
    // The order of the views is the seed's, unless a step looks at all of them.
    assert_ne!(one, (1..9).map(|seed| optimised(None, seed)).find(|other| *other != one).unwrap());
    assert_eq!(all, optimised(Some(num_views), 1));
}

#[test]
fn no_pass_begins_without_time_for_it() {
    let place = tempfile::tempdir().unwrap();
    write_test_clip(place.path(), |_| 0.8);
    let held = Held::open(place.path());
    let inputs = held.inputs(held.views(Role::Input).unwrap()).unwrap();
    let mut made = held.reconstruct();
    let deadline = Some(Deadline { until: std::time::Instant::now(), adam_passes: 9, adam_pass_s: 1.0 });
    optimise(&mut made, &inputs, &adam(0, PixelStride::ALL, deadline));
    assert!(made.optimisation.is_none() && made.scene == held.reconstruct().scene);
}
