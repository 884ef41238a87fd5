//! Loss, gradient, residuals and lengths of steps over several views, on the GPU and by the CPU.

use std::num::NonZeroUsize;

use lgs_engine::evidence::Evidence;
use lgs_engine::gaussians::GaussianSet;
use lgs_engine::loss::LossWeights;
use lgs_engine::objective::{Objective, Wanted, objective_with};
use lgs_engine::refine::adam::{Adam, AdamSettings};
use lgs_engine::refine::{ViewSchedule, step_lengths};
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
    ("costs_of_removals_are_the_cpus", costs_of_removals_are_the_cpus),
    ("steps_of_adam_are_those_of_its_formula", steps_of_adam_are_those_of_its_formula),
    (
        "steps_of_adam_repeat_to_the_bit_and_end_where_the_cpus_do",
        steps_of_adam_repeat_to_the_bit_and_end_where_the_cpus_do,
    ),
    ("steps_that_fit_no_more_are_the_cpus", steps_that_fit_no_more_are_the_cpus),
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

/// At opacities at which nothing ends a pixel, and at which pixels are opaque many times over.
fn costs_of_removals_are_the_cpus() -> Outcome {
    for opacities in [[0.05, 0.4], [0.9, 1.0]] {
        let (set, views) = scene(Look { opacities, ..LOOK });
        let costs =
            |device: Device| Evidence::removal_costs(device, &set, &[&views[0], &views[1]], &LossWeights::default());
        let (device, want) = (on_gpu()?, costs(Device::Cpu));
        let [got, again] = [(); 2].map(|()| costs(device));
        if got != again {
            return Err("costs differ from run to run".into());
        }
        lgs_tests::compare::close_l2("costs", &got, &want, 1e-4, 0.0)?;
    }
    Ok(())
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

/// The GPU stops between two steps of an optimisation, which goes on from where it was: whether the scene was read after every step or stayed there.
fn steps_after_a_loss_are_the_cpus() -> Outcome {
    let (set, views) = scene(Look { num: 200, ..LOOK });
    let views = [&views[0], &views[1]];
    let index = adapter::gpu().map_err(|needed| format!("{needed:?}"))?.adapter().index;
    for stays in [false, true] {
        let gpu = open_limited(index, u64::MAX)?;
        let run = |device: Device| {
            let (mut set, mut adam) =
                (set.clone(), Adam::new(set.len(), AdamSettings { device, ..AdamSettings::default() }));
            for step in 0..4 {
                if step == 2 && device != Device::Cpu {
                    gpu.stop();
                }
                if stays {
                    adam.pass_ahead(&mut set, &views)
                } else {
                    adam.pass(&mut set, &views)
                };
            }
            adam.settle(&mut set);
            (set, adam.into_summary().losses)
        };
        let ((got_set, got), (want_set, want)) = (run(Device::Gpu(gpu)), run(Device::Cpu));
        if got.iter().zip(&want).any(|(got, want)| (got - want).abs() > 1e-4 * want) || got[3] >= got[0] {
            return Err(format!("losses {got:?}, by the CPU alone {want:?}").into());
        }
        // What stayed there was lost, and done again here.
        if stays && got_set != want_set {
            return Err("another scene than the CPU's".into());
        }
        let refused = Device::Gpu(gpu).drawn_on().refused;
        if refused.len() != 1 {
            return Err(format!("reasons: {refused:?}").into());
        }
    }
    Ok(())
}

/// Values of a scene's Gaussian: 14 parameters and its velocity.
fn values(set: &GaussianSet, i: usize) -> Vec<f64> {
    set.attributes[i].iter().chain(&set.velocities[i]).map(|&value| f64::from(value)).collect()
}

/// Adam's formula in f64 with the gradients that the GPU finds, beside the steps that are made there.
fn steps_of_adam_are_those_of_its_formula() -> Outcome {
    let (mut set, views) = scene(LOOK);
    let (views, device) = ([&views[0], &views[1]], on_gpu()?);
    let mut adam = Adam::new(set.len(), AdamSettings { device, ..AdamSettings::default() });
    let rates = [[4e-3; 3].as_slice(), &[3e-3; 4], &[0.25; 3], &[0.2], &[4e-2; 3], &[5e-3; 3]].concat();
    let (mut moments, mut counts) = (vec![[[0.0_f64; 2]; 17]; set.len()], vec![0; set.len()]);
    for step in 1..=3 {
        let wanted = Wanted { gradient: true, device, ..Wanted::default() };
        let gradient = objective_with(&set, &views, &LossWeights::default(), wanted).gradient;
        let before = set.clone();
        adam.pass(&mut set, &views);
        let (mut got, mut want) = (Vec::new(), Vec::new());
        for (i, moments) in moments.iter_mut().enumerate() {
            let slopes = gradient.attributes[i].iter().chain(&gradient.velocities[i]);
            let (old, new) = (values(&before, i), values(&set, i));
            // What nobody sees stays, and counts no step.
            if gradient.attributes[i].iter().all(|&slope| slope == 0.0) {
                got.extend(new.iter().zip(&old).map(|(new, old)| new - old));
                want.extend([0.0; 17]);
                continue;
            }
            counts[i] += 1;
            let step: i32 = counts[i];
            for (k, &slope) in slopes.enumerate() {
                let [first, second] = &mut moments[k];
                *first = 0.9 * *first + 0.1 * f64::from(slope);
                *second = 0.999 * *second + 0.001 * f64::from(slope).powi(2);
                let unbiased = [*first / (1.0 - 0.9_f64.powi(step)), *second / (1.0 - 0.999_f64.powi(step))];
                let rate = rates[k] / (1.0 + f64::from(step - 1) / 40.0).sqrt();
                let length = if unbiased[1] > 0.0 { rate * unbiased[0] / (unbiased[1].sqrt() + 1e-15) } else { 0.0 };
                got.push((new[k] - old[k]) / rates[k]);
                // A value has so many digits, and a step that is taken from it no more.
                want.push((f64::from(narrow(old[k] - length)) - old[k]) / rates[k]);
            }
        }
        lgs_tests::compare::close_l2(&format!("step {step}"), &got, &want, 1e-5, 0.0)?;
    }
    Ok(())
}

/// So many passes, with a step for each of the views.
fn optimised(set: &GaussianSet, views: &[View; 2], device: Device, passes: usize) -> (GaussianSet, Vec<f64>) {
    let (mut set, views) = (set.clone(), [&views[0], &views[1]]);
    let schedule = ViewSchedule { views_per_step: NonZeroUsize::new(1), seed: 7 };
    let mut adam = Adam::new(set.len(), AdamSettings { device, schedule, ..AdamSettings::default() });
    (0..passes).for_each(|_| {
        adam.pass_ahead(&mut set, &views);
    });
    adam.settle(&mut set);
    (set, adam.into_summary().losses)
}

fn steps_of_adam_repeat_to_the_bit_and_end_where_the_cpus_do() -> Outcome {
    let (set, views) = scene(LOOK);
    let runs: Vec<_> =
        (0..3).map(|_| Ok(optimised(&set, &views, on_gpu()?, 6))).collect::<Result<_, libtest_mimic::Failed>>()?;
    for (other, losses) in &runs[1..] {
        same_bits("parameters", other.attributes.as_flattened(), runs[0].0.attributes.as_flattened())?;
        same_bits("velocities", other.velocities.as_flattened(), runs[0].0.velocities.as_flattened())?;
        if losses.iter().zip(&runs[0].1).any(|(a, b)| a.to_bits() != b.to_bits()) {
            return Err(format!("losses {losses:?} and {:?}", runs[0].1).into());
        }
    }
    let (got, (_, want)) = (&runs[0].1, optimised(&set, &views, Device::Cpu, 6));
    if got.iter().zip(&want).any(|(got, want)| (got - want).abs() > 1e-5 * want) || want[5] > 0.97 * want[0] {
        return Err(format!("losses {got:?}, by the CPU {want:?}").into());
    }
    Ok(())
}

/// Where the GPU may hold too little for what Adam keeps there, or for any view, steps end where they would, and it says why.
fn steps_that_fit_no_more_are_the_cpus() -> Outcome {
    let (set, views) = scene(LOOK);
    let index = adapter::gpu().map_err(|needed| format!("{needed:?}"))?.adapter().index;
    let whole = optimised(&set, &views, Device::Gpu(open_limited(index, u64::MAX)?), 3);
    let by_cpu = optimised(&set, &views, Device::Cpu, 3);
    for (bytes, want, refuses) in [(100_000, &by_cpu, true), (64_000_000, &whole, false)] {
        let gpu = open_limited(index, u64::MAX)?;
        gpu.limit_memory(bytes);
        let got = optimised(&set, &views, Device::Gpu(gpu), 3);
        let refused = Device::Gpu(gpu).drawn_on().refused;
        if &got != want || refused.is_empty() == refuses {
            return Err(format!("{bytes} bytes: losses {:?} and {:?}, refused {refused:?}", got.1, want.1).into());
        }
        if refused.iter().any(|reason| !reason.contains("coarseness")) {
            return Err(format!("{refused:?} say not what to lower").into());
        }
    }
    Ok(())
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
