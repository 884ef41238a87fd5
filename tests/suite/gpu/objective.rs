//! Loss, gradient, residuals and lengths of steps over several views, on the GPU and by the CPU.

use lgs_engine::gaussians::GaussianSet;
use lgs_engine::loss::LossWeights;
use lgs_engine::objective::{Objective, Wanted, objective_with};
use lgs_engine::refine::adam::{Adam, AdamSettings};
use lgs_engine::refine::step_lengths;
use lgs_engine::render::Device;
use lgs_engine::render::gpu::open_limited;
use lgs_engine::render::reference::Gaussian;
use lgs_engine::views::{DepthSample, Role, View};
use lgs_formats::casts::to_u32;
use lgs_formats::image::{PixelLabel, RgbImage};
use lgs_tests::Outcome;
use lgs_tests::compare::same_bits;
use lgs_tests::random::Random;
use lgs_tests::scenes::{Look, pinhole, random_scene};

use super::{Case, adapter, near};

pub(super) const CASES: &[Case] = &[
    ("the_objective_is_the_cpus", the_objective_is_the_cpus),
    ("small_and_ignored_images_have_the_cpus_loss", small_and_ignored_images_have_the_cpus_loss),
    ("steps_after_a_loss_are_the_cpus", steps_after_a_loss_are_the_cpus),
    ("lengths_of_steps_are_the_cpus", lengths_of_steps_are_the_cpus),
];

const LOOK: Look = Look { num: 600, width: 101, height: 70, opacities: [0.2, 0.9] };

#[expect(clippy::cast_possible_truncation, reason = "rounding to f32 is the point")]
fn narrow(value: f64) -> f32 {
    value as f32
}

fn set_of(gaussians: &[Gaussian]) -> GaussianSet {
    let logit = |p: f64| (p / (1.0 - p)).ln();
    let row = |g: &Gaussian| {
        let mut row = [0.0; 14];
        row[..3].copy_from_slice(&g.mean.map(narrow));
        row[3..7].copy_from_slice(&g.quat.map(narrow));
        row[7..10].copy_from_slice(&g.scale.map(|s| narrow(s.ln())));
        row[10] = narrow(logit(g.opacity));
        row[11..].copy_from_slice(&g.colour.map(|c| narrow(logit(c.clamp(0.05, 0.95)))));
        row
    };
    GaussianSet {
        attributes: gaussians.iter().map(row).collect(),
        times: gaussians.iter().map(|g| narrow(g.time)).collect(),
        frames: vec![0; gaussians.len()],
        velocities: gaussians.iter().map(|g| g.velocity.map(narrow)).collect(),
        num_lidar: gaussians.len() - gaussians.len() / 4,
    }
}

/// A scene and two views of it: noise over a slope of grey, with ignored pixels and depths in the second.
fn scene(look: Look) -> (GaussianSet, [View; 2]) {
    let scene = random_scene(look, 201);
    let mut random = Random::new(202);
    let pinhole = pinhole(&scene.camera);
    let pixels = look.width * look.height;
    let mut view = |number: usize| {
        let value = |i: usize| narrow(0.2 + 0.6 * (i / 3 % look.width) as f64 / look.width as f64);
        let data = (0..3 * pixels).map(|i| value(i) + narrow(random.uniform(-0.1, 0.1))).collect();
        let label = |p: usize| {
            let inside =
                (look.width / 4..look.width / 2).contains(&(p % look.width)) && p / look.width < look.height / 2;
            if inside { PixelLabel::Ignored } else { PixelLabel::Static }
        };
        let sample = |p: usize| DepthSample { pixel: to_u32(p), depth: narrow(2.0 + (p % 90) as f64 / 9.0) };
        View {
            frame: number,
            camera: "camera".to_owned(),
            role: Role::Input,
            pinhole,
            image: RgbImage { width: look.width, height: look.height, data },
            response: None,
            labels: (number == 1).then(|| (0..pixels).map(label).collect()),
            depth_map: None,
            depth_samples: (0..pixels).step_by(7).filter(|_| number == 1).map(sample).collect(),
        }
    };
    (set_of(&scene.gaussians), [view(0), view(1)])
}

fn on_gpu() -> Result<Device, libtest_mimic::Failed> {
    Ok(Device::Gpu(adapter::gpu().map_err(|needed| format!("{needed:?}"))?))
}

fn found(set: &GaussianSet, views: &[View; 2], device: Device) -> Objective {
    let wanted = Wanted { gradient: true, mean_residuals: true, images: true, device };
    objective_with(set, &[&views[0], &views[1]], &LossWeights::default(), wanted)
}

fn compare(set: &GaussianSet, views: &[View; 2]) -> Outcome {
    let (got, want) = (found(set, views, on_gpu()?), found(set, views, Device::Cpu));
    let terms = |o: &Objective| [o.loss, o.terms.l1, o.terms.dissimilarity, o.terms.depth, o.terms.speed];
    for (k, (got, want)) in terms(&got).into_iter().zip(terms(&want)).enumerate() {
        if (got - want).abs() > 2e-5 * want.abs() {
            return Err(format!("term {k}: {got} on the GPU, {want} by the CPU").into());
        }
    }
    if got.seen != want.seen {
        return Err("other Gaussians are seen".into());
    }
    near("images", &got.images.concat(), &want.images.concat(), 1e-5)?;
    let columns = [("mean", 0..3), ("quat", 3..7), ("scale", 7..10), ("opacity", 10..11), ("colour", 11..14)];
    for (what, got, want) in [
        ("gradient", &got.gradient, &want.gradient),
        ("residual", &got.mean_residuals.gradient, &want.mean_residuals.gradient),
    ] {
        for (part, columns) in columns.clone() {
            let column = |rows: &[[f32; 14]]| rows.iter().flat_map(|r| r[columns.clone()].to_vec()).collect::<Vec<_>>();
            near(&format!("{what} by {part}"), &column(&got.attributes), &column(&want.attributes), 2e-3)?;
        }
        near(&format!("{what} by velocity"), got.velocities.as_flattened(), want.velocities.as_flattened(), 2e-3)?;
    }
    near("weights", &got.mean_residuals.weights, &want.mean_residuals.weights, 1e-5)?;
    near("errors", &got.mean_residuals.errors, &want.mean_residuals.errors, 1e-5)
}

fn the_objective_is_the_cpus() -> Outcome {
    let (set, views) = scene(LOOK);
    compare(&set, &views)?;
    let device = on_gpu()?;
    let runs = [(); 5].map(|()| found(&set, &views, device));
    for other in &runs[1..] {
        if other.loss.to_bits() != runs[0].loss.to_bits() {
            return Err(format!("losses {} and {}", other.loss, runs[0].loss).into());
        }
        let rows = |o: &Objective| o.gradient.attributes.as_flattened().to_vec();
        same_bits("gradients", &rows(other), &rows(&runs[0]))?;
    }
    Ok(())
}

fn small_and_ignored_images_have_the_cpus_loss() -> Outcome {
    for (width, height) in [(10, 40), (11, 11), (40, 12)] {
        let (set, views) = scene(Look { num: 60, width, height, opacities: [0.2, 0.9] });
        compare(&set, &views)?;
    }
    let (set, mut views) = scene(Look { num: 60, width: 30, height: 20, opacities: [0.2, 0.9] });
    views[1].labels = Some(vec![PixelLabel::Ignored; 600]);
    compare(&set, &views)
}

/// The GPU stops between two steps of an optimisation, which goes on from where it was.
fn steps_after_a_loss_are_the_cpus() -> Outcome {
    let (set, views) = scene(Look { num: 200, ..LOOK });
    let views = [&views[0], &views[1]];
    let gpu = open_limited(adapter::gpu().map_err(|needed| format!("{needed:?}"))?.adapter().index, u64::MAX)?;
    let run = |device: Device| {
        let (mut set, mut adam) =
            (set.clone(), Adam::new(set.len(), AdamSettings { device, ..AdamSettings::default() }));
        for step in 0..4 {
            if step == 2 && device != Device::Cpu {
                gpu.stop();
            }
            adam.step(&mut set, &views);
        }
        adam.into_summary().losses
    };
    let (got, want) = (run(Device::Gpu(gpu)), run(Device::Cpu));
    if got.iter().zip(&want).any(|(got, want)| (got - want).abs() > 1e-4 * want) || got[3] >= got[0] {
        return Err(format!("losses {got:?}, by the CPU alone {want:?}").into());
    }
    let refused = Device::Gpu(gpu).drawn_on().refused;
    if refused.len() == 1 { Ok(()) } else { Err(format!("reasons: {refused:?}").into()) }
}

fn lengths_of_steps_are_the_cpus() -> Outcome {
    let (set, views) = scene(LOOK);
    let views = [&views[0], &views[1]];
    let wanted = Wanted { images: true, ..Wanted::default() };
    let before = objective_with(&set, &views, &LossWeights::default(), wanted).images;
    let mut after = set;
    let mut random = Random::new(203);
    after
        .attributes
        .iter_mut()
        .for_each(|row| row[11..].iter_mut().for_each(|c| *c += narrow(random.uniform(-0.5, 0.7))));
    let lengths = |device: Device| step_lengths(device, &before, &after, &views);
    let (got, want) = (lengths(on_gpu()?), lengths(Device::Cpu));
    if !want.iter().any(|&length| length > 0.6 && length < 0.9) {
        return Err("every length is at a limit".into());
    }
    near("lengths", &got, &want, 1e-4)
}
