//! Density of the whole scene: splitting that changes no picture, and pruning by exact effects.

use std::ffi::OsStr;
use std::fs;
use std::path::Path;
use std::sync::Arc;

use lgs_engine::densify::{Change, Limit, Scope, change};
use lgs_engine::evidence::survivors;
use lgs_engine::gaussians::GaussianSet;
use lgs_engine::gaussians::background::Mode;
use lgs_engine::gaussians::physical::to_physical;
use lgs_engine::pipeline::{Opening, Pruning, Run, Session, Silent, Watch};
use lgs_engine::refine::{LastStep, RefineSettings, refine};
use lgs_engine::render::{Device, longest_axes, render};
use lgs_engine::views::{Selection, View};
use lgs_formats::clip_dir::ClipDir;
use lgs_tests::metrics::{self, number};
use lgs_tests::process::{binary, run};
use lgs_tests::weights::{Heads, SMALL, Weights};
use lgs_tests::{Outcome, case, clips};
use libtest_mimic::{Failed, Trial};
use serde_json::Value;

/// What splitting may cost an input view, decibels.
const SPLIT_COST: f64 = 0.15;

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("density::splitting_everything_costs_input_views_little", splitting),
        case("density::pruning_comes_a_step_ahead", a_step_ahead),
        case("density::exact_pruning_meets_its_limit_in_both_branches", limit),
        case("density::exact_pruning_of_half_is_better_than_chance", better_than_chance),
        case("density::exact_pruning_gives_the_same_bytes_for_any_number_of_threads", threads),
        case("density::a_front_has_the_figures_of_inference", front),
    ]
}

/// A scene is refined by one step, and its effects then tell who stays; no step is taken where none is to follow, or where all stay.
fn a_step_ahead() -> Outcome {
    let selection = Selection { frames: Some(vec![0, 1]), ..Selection::default() };
    let mut watch = Watch::new(&Silent);
    let session = Session::open(Arc::new(ClipDir::open(&clips::street())?), Opening::of(selection), &mut watch)?;
    let scene = session.run(&Run::initial(Mode::Auto.into()), &mut watch)?.scene;
    let views: Vec<&View> = session.inputs().views().iter().collect();
    let model = Weights::seeded(SMALL, 7, Heads { residuals: 0.05, scores: 0.0 })?.model()?;
    let limit = Some(Limit::Percent(70));
    let told = |steps: usize, limit: Option<Limit>| -> Result<(Vec<usize>, usize, GaussianSet), Failed> {
        let pruning = Pruning { scope: Scope::All, limit, refine: steps.into() };
        let (mut parts, mut pruned) = (0, scene.clone());
        let rows = pruning.prune(&mut pruned, &views, &model, &mut || parts += 1)?;
        if parts != pruning.parts(&scene) {
            return Err(format!("{parts} parts of {} were told", pruning.parts(&scene)).into());
        }
        Ok((rows, parts, pruned))
    };
    let left = |scene: &GaussianSet| survivors(scene, &views, (Scope::All, limit), Device::Cpu, &mut || ());
    let mut ahead = scene.clone();
    refine(&mut ahead, &views, &model, RefineSettings { last: LastStep::Kept, ..1.into() }, || ())?;
    let (usual, beyond) = (left(&scene), left(&ahead));
    let all: Vec<usize> = (0..scene.len()).collect();
    if usual == beyond {
        return Err("the step changes nobody's effects".into());
    }
    for (steps, limit, want) in [
        (0, limit, (usual, 1, scene.clone())),
        (1, limit, (beyond.clone(), 2, ahead.clone())),
        (3, limit, (beyond, 2, ahead)),
        (3, Some(Limit::Percent(100)), (all, 0, scene.clone())),
    ] {
        if told(steps, limit)? != want {
            return Err(format!("{steps} steps, {limit:?}: others stay").into());
        }
    }
    Ok(())
}

/// Every Gaussian of both branches gives way to its halves.
fn splitting() -> Outcome {
    let selection = Selection { frames: Some(vec![0, 1]), ..Selection::default() };
    let mut watch = Watch::new(&Silent);
    let session = Session::open(Arc::new(ClipDir::open(&clips::street())?), Opening::of(selection), &mut watch)?;
    let scene = session.run(&Run::initial(Mode::Auto.into()), &mut watch)?.scene;
    let views: Vec<&View> = session.inputs().views().iter().collect();
    let pinholes: Vec<_> = views.iter().map(|view| &view.pinhole).collect();
    let axes = longest_axes(&to_physical(&scene), &pinholes);
    let split = change(&scene, &vec![Change::Split; scene.len()], &axes);
    if (split.len(), split.num_lidar) != (2 * scene.len(), 2 * scene.num_lidar) {
        return Err(format!("{} Gaussians, {} of the LiDAR", split.len(), split.num_lidar).into());
    }
    for view in views {
        let psnr = |set| {
            let rendered = render(&to_physical(set), &view.pinhole, [0.0; 3]).rgb;
            let squares = rendered.iter().zip(&view.image.data).map(|(r, t)| f64::from(r - t).powi(2));
            -10.0 * (squares.sum::<f64>() / rendered.len() as f64).log10()
        };
        let (before, after) = (psnr(&scene), psnr(&split));
        if after < before - SPLIT_COST {
            return Err(format!("{} of frame {}: {before:.2} dB, {after:.2} dB", view.camera, view.frame).into());
        }
    }
    Ok(())
}

/// `metrics.json` of a run at a small size with the weights that `place` holds.
fn infer(place: &Path, out: &str, flags: &[&str]) -> Result<Value, Failed> {
    let weights = place.join("w.safetensors");
    if !weights.exists() {
        Weights::seeded(SMALL, 2, Heads { residuals: 0.0, scores: 1.5 })?.write(&weights)?;
    }
    let street = clips::street();
    let mut arguments = vec![street.as_os_str()];
    let common = ["--out", out, "--weights", "w.safetensors", "--image-size", "48x80", "--frames", "0..3"];
    let rest = ["--hold-out", "1", "--refine-steps", "0"];
    arguments.extend(common.iter().chain(&rest).chain(flags).map(|flag| OsStr::new(*flag)));
    run(&binary("lgs-infer")?, &arguments, place)?.expect_success()?;
    Ok(metrics::read(&place.join(out))?)
}

fn count(page: &Value, key: &str) -> Result<u64, Failed> {
    Ok(page["gaussians"][key].as_u64().ok_or(format!("no count of {key}"))?)
}

fn limit() -> Outcome {
    let place = tempfile::tempdir()?;
    let off = infer(place.path(), "off", &["--density", "off"])?;
    let (lidar, behind) = (count(&off, "final")?, count(&off, "background")?);
    for (flags, want) in [
        (["--max-gaussians", "50%"].as_slice(), (lidar + behind) / 2),
        (&["--max-gaussians", "1000"], 1000),
        (&["--max-gaussians", "1000", "--density-scope", "lidar"], 1000 + behind),
        (&["--max-gaussians", "30%", "--density-scope", "lidar"], lidar * 30 / 100 + behind),
    ] {
        let page = infer(place.path(), "out", &[["--density", "exact"].as_slice(), flags].concat())?;
        metrics::expect_network_keys(&page)?;
        let (last, left) = (count(&page, "final")?, count(&page, "background")?);
        let pruned = (count(&page, "pruned")?, count(&page, "background_pruned")?);
        if last + left != want || (lidar - last, behind - left) != pruned {
            return Err(format!("{flags:?}: expected {want} of {lidar} + {behind}, found {}", page["gaussians"]).into());
        }
        let both = pruned.0 > 0 && (pruned.1 > 0) != flags.contains(&"lidar");
        if !both || page["config"]["density"] != "exact" {
            return Err(format!("{flags:?}: {} {}", page["gaussians"], page["config"]).into());
        }
    }
    let street = clips::street();
    let unfit = [street.as_os_str(), "--weights".as_ref(), "none".as_ref(), "--density".as_ref(), "exact".as_ref()];
    run(&binary("lgs-infer")?, &unfit, place.path())?.expect_refusal(&["--density exact", "--weights none"])?;
    let usual = infer(place.path(), "usual", &[])?;
    let left = count(&usual, "final")? + count(&usual, "background")?;
    if left != (lidar + behind) * 70 / 100 || usual["config"]["max_gaussians"] != "70%" {
        return Err(format!("where nobody names a limit: {}", usual["gaussians"]).into());
    }
    let free = infer(place.path(), "free", &["--density", "exact", "--max-gaussians", "none"])?;
    let pruned = count(&free, "pruned")? + count(&free, "background_pruned")?;
    if pruned == 0 || 3 * pruned > lidar + behind {
        return Err(format!("without a limit: {}", free["gaussians"]).into());
    }
    Ok(())
}

fn better_than_chance() -> Outcome {
    let place = tempfile::tempdir()?;
    let half = ["--max-gaussians", "50%"];
    let psnr = |out: &str, flags: &[&str]| -> Result<f64, Failed> {
        Ok(number(&infer(place.path(), out, &[half.as_slice(), flags].concat())?, &["mean", "held_out", "psnr"])?)
    };
    let exact = psnr("exact", &["--density", "exact", "--density-scope", "lidar"])?;
    let chance = psnr("chance", &["--density", "random", "--theta-prune", "1", "--theta-add", "1"])?;
    if exact > chance { Ok(()) } else { Err(format!("held out {exact} dB, {chance} dB by chance").into()) }
}

fn threads() -> Outcome {
    let place = tempfile::tempdir()?;
    let scene = |threads: &str| -> Result<Vec<u8>, Failed> {
        let flags = ["--density", "exact", "--max-gaussians", "40%", "--threads", threads];
        infer(place.path(), threads, &flags)?;
        Ok(fs::read(place.path().join(threads).join("scene.ply"))?)
    };
    if scene("1")? == scene("2")? { Ok(()) } else { Err("another scene on two threads".into()) }
}

/// `lgs-sweep density` against `lgs-infer`; a second time it measures nothing.
fn front() -> Outcome {
    let place = tempfile::tempdir()?;
    let flags = |limit| ["--density", "exact", "--max-gaussians", limit];
    let want = [infer(place.path(), "half", &flags("50%"))?, infer(place.path(), "all", &flags("100%"))?];
    let clip = format!("{};image-size=48x80;frames=4;hold-out=1", clips::street().display());
    let sweep = |more: &[&str]| {
        let mut arguments = vec!["density", &clip, "--weights", "w.safetensors", "--out", "front", "--adam", "1"];
        arguments.extend(["--percents", "50", "--refine-steps", "0"].iter().chain(more));
        run(&binary("lgs-sweep")?, &arguments.into_iter().map(OsStr::new).collect::<Vec<_>>(), place.path())
    };
    sweep(&["--signals", "exact,chance"])?.expect_success()?;
    let read = || fs::read_to_string(place.path().join("front/density.json"));
    let text = read()?;
    let page: Value = serde_json::from_str(&text)?;
    let points = page["clips"][0]["points"].as_array().ok_or("no points")?;
    let psnr = |of: &Value, keys: &[&str]| number(of, keys);
    let found = [psnr(&points[1], &["learned", "psnr"])?, psnr(&points[0], &["learned", "psnr"])?];
    for (page, found) in want.iter().zip(found) {
        let want = psnr(page, &["mean", "held_out", "psnr"])?;
        if found != want {
            return Err(format!("{found} dB, lgs-infer says {want}").into());
        }
    }
    let counts: Vec<&Value> = points.iter().map(|point| &point["gaussians"]).collect();
    if points.len() != 3 || counts[1] != counts[2] || page["comparisons"].as_array().is_none_or(Vec::is_empty) {
        return Err(format!("{page:#}").into());
    }
    let kept = place.path().join("front/clips");
    let record = fs::read_dir(&kept)?.next().ok_or("no record")??.path();
    let made = fs::metadata(&record)?.modified()?;
    sweep(&["--signals", "exact,chance"])?.expect_success()?;
    if read()? != text || fs::metadata(&record)?.modified()? != made {
        return Err("what was measured is measured again".into());
    }
    sweep(&["--signals", "best"])?.expect_refusal(&["--signals", "best"])?;
    run(
        &binary("lgs-sweep")?,
        &["density", clip.as_str(), "--percents", "100", "--out", "other"].map(OsStr::new),
        place.path(),
    )?
    .expect_refusal(&["--percents", "1 to 99"])
}
