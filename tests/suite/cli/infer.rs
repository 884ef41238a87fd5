//! `lgs-infer` on the clip that the repository ships.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use lgs_formats::ply::read_ply;
use lgs_tests::compare::{absolute, close};
use lgs_tests::metrics::{self, FIGURES};
use lgs_tests::process::{binary, run};
use lgs_tests::{Outcome, case, clips, places};
use libtest_mimic::Trial;
use serde_json::Value;

use crate::street::HALF_SIZE;

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("cli::infer::writes_what_it_promises", writes_what_it_promises),
        case("cli::infer::metrics_have_exactly_the_promised_keys", metrics_have_exactly_the_promised_keys),
        case("cli::infer::same_bytes_for_any_number_of_threads", same_bytes_for_any_number_of_threads),
        case("cli::infer::views_can_be_left_out", views_can_be_left_out),
        case("cli::infer::frames_and_cameras_can_be_chosen", frames_and_cameras_can_be_chosen),
        case("cli::infer::a_moment_can_be_chosen", a_moment_can_be_chosen),
        case("cli::infer::held_out_files_do_not_reach_the_scene", held_out_files_do_not_reach_the_scene),
        case("cli::infer::epochs_and_map_coordinates_do_not_matter", epochs_and_map_coordinates_do_not_matter),
        case("cli::infer::json_goes_to_stdout", json_goes_to_stdout),
    ]
}

/// Runs on a clip and returns what it says on stdout.
fn infer(clip: &Path, out: &Path, flags: &[&str]) -> Result<String, libtest_mimic::Failed> {
    let mut arguments =
        vec![clip.as_os_str(), "--out".as_ref(), out.as_os_str(), "--weights".as_ref(), "none".as_ref()];
    arguments.extend(flags.iter().map(|flag| flag.as_ref() as &std::ffi::OsStr));
    let finished = run(&binary("lgs-infer")?, &arguments, places::repository())?;
    finished.expect_success()?;
    Ok(finished.stdout)
}

/// Every file under a directory, relative to it, sorted.
pub(super) fn files(root: &Path) -> Result<Vec<PathBuf>, String> {
    lgs_tests::sources::all_files(root).map(|mut files| {
        files.sort();
        files
    })
}

fn writes_what_it_promises() -> Outcome {
    let place = tempfile::tempdir()?;
    let out = place.path().join("a/new/out");
    infer(&clips::street(), &out, &["--hold-out", "odd"])?;
    let mut want: Vec<PathBuf> = ["metrics.json", "report.html", "scene.ply"].map(PathBuf::from).to_vec();
    let clip = clips::description(&clips::street())?;
    for (frame, content) in clip["frames"].as_array().into_iter().flatten().enumerate() {
        for camera in content["cameras"].as_array().into_iter().flatten() {
            let name = camera["name"].as_str().unwrap_or_default();
            want.extend(
                ["render", "truth", "error", "depth"].map(|kind| format!("views/f{frame}_{name}_{kind}.png").into()),
            );
        }
    }
    want.sort();
    let got = files(&out)?;
    if got != want {
        return Err(format!("got {got:#?}, want {want:#?}").into());
    }
    for picture in got.iter().filter(|path| path.extension().is_some_and(|e| e == "png")) {
        image::open(out.join(picture)).map_err(|e| format!("{}: {e}", picture.display()))?;
    }
    report_stands_alone(&fs::read_to_string(out.join("report.html"))?)
}

/// A page that shows its pictures without any other file and without a network.
fn report_stands_alone(page: &str) -> Outcome {
    for (attribute, inline) in [("src=\"", "data:"), ("href=\"", "#")] {
        for (at, _) in page.match_indices(attribute) {
            let target: String = page[at + attribute.len()..].chars().take(60).collect();
            if !target.starts_with(inline) {
                return Err(format!("report.html loads {target}").into());
            }
        }
    }
    let num_pictures = page.matches("src=\"data:image/").count();
    if num_pictures == 0 { Err("report.html shows no picture".into()) } else { Ok(()) }
}

fn metrics_have_exactly_the_promised_keys() -> Outcome {
    let place = tempfile::tempdir()?;
    let out = place.path().join("out");
    infer(&clips::street(), &out, &["--hold-out", "1", "--seed", "7", "--threads", "2"])?;
    let page = metrics::read(&out)?;
    metrics::expect_promised_keys(&page)?;
    let got = [&page["format"], &page["weights"], &page["threads"], &page["seed"]].map(Value::to_string);
    let want = ["\"lgs-metrics/1\"", "null", "2", "7"];
    if got != want {
        return Err(format!("format, weights, threads, seed: got {got:?}, want {want:?}").into());
    }
    let count = |key: &str| page["gaussians"][key].as_u64().ok_or(format!("gaussians.{key} is no count"));
    let added_up = count("initial")? - count("pruned")? + count("added")?;
    let saved = u64::try_from(read_ply(&out.join("scene.ply"))?.len())?;
    if count("final")? != added_up || saved != count("final")? + count("background")? {
        return Err(format!("{} do not add up to the {saved} of scene.ply", page["gaussians"]).into());
    }
    let mean = |figure: &str| metrics::number(&page, &["mean", "held_out", figure]);
    let (psnr, copying) = (mean("psnr")?, mean("psnr_copying")?);
    if psnr > copying { Ok(()) } else { Err(format!("held-out PSNR {psnr} dB, copying {copying} dB").into()) }
}

fn same_bytes_for_any_number_of_threads() -> Outcome {
    let place = tempfile::tempdir()?;
    let [one, two] = ["1", "2"].map(|threads| place.path().join(threads));
    for (threads, out) in [("1", &one), ("2", &two)] {
        infer(&clips::street(), out, &[&HALF_SIZE[..], &["--hold-out", "odd", "--threads", threads]].concat())?;
    }
    same_results(&one, &two)
}

/// Fails unless two output directories hold the same bytes, but for times, memory and the number of threads.
pub(super) fn same_results(one: &Path, two: &Path) -> Outcome {
    let names = files(one)?;
    if names != files(two)? {
        return Err(format!("different files: {names:?}, {:?}", files(two)?).into());
    }
    for name in names.iter().filter(|name| !["metrics.json", "report.html"].iter().any(|n| name.ends_with(n))) {
        if fs::read(one.join(name))? != fs::read(two.join(name))? {
            return Err(format!("{} differs", name.display()).into());
        }
    }
    let [one, two] = [metrics::without_costs(&metrics::read(one)?), metrics::without_costs(&metrics::read(two)?)];
    if one == two { Ok(()) } else { Err(format!("metrics.json differs: {one:#}, {two:#}").into()) }
}

fn views_can_be_left_out() -> Outcome {
    let place = tempfile::tempdir()?;
    let [none, held_out] = ["none", "held-out"].map(|views| place.path().join(views));
    infer(&clips::street(), &none, &[&HALF_SIZE[..], &["--views", "none", "--hold-out", "1"]].concat())?;
    if files(&none)?.iter().any(|path| path.starts_with("views")) {
        return Err("--views none wrote views".into());
    }
    infer(&clips::street(), &held_out, &[&HALF_SIZE[..], &["--views", "held-out", "--hold-out", "1"]].concat())?;
    let pictures: Vec<_> = files(&held_out)?.into_iter().filter(|path| path.starts_with("views")).collect();
    let of_frame = |path: &PathBuf| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("f1_"));
    if pictures.is_empty() || !pictures.iter().all(of_frame) {
        return Err(format!("--views held-out --hold-out 1 wrote {pictures:?}").into());
    }
    Ok(())
}

fn frames_and_cameras_can_be_chosen() -> Outcome {
    let place = tempfile::tempdir()?;
    let out = place.path().join("out");
    let clip = clips::description(&clips::street())?;
    let camera = clip["frames"][0]["cameras"][0]["name"].as_str().unwrap_or_default().to_owned();
    infer(
        &clips::street(),
        &out,
        &["--frames", "0,1", "--hold-out", "1", "--cameras", &camera, "--image-size", "60x100"],
    )?;
    let page = metrics::read(&out)?;
    let seen: BTreeSet<String> = page["views"]
        .as_array()
        .into_iter()
        .flatten()
        .map(|view| format!("{} {} {}", view["frame"], view["camera"], view["role"]))
        .collect();
    let want = BTreeSet::from([format!("0 \"{camera}\" \"input\""), format!("1 \"{camera}\" \"held-out\"")]);
    if seen != want {
        return Err(format!("views {seen:?}, want {want:?}").into());
    }
    let picture = image::open(out.join(format!("views/f1_{camera}_render.png")))?;
    let size = (picture.height(), picture.width());
    if size == (60, 100) { Ok(()) } else { Err(format!("rendered at {size:?}, want (60, 100)").into()) }
}

/// At a moment of its own a view has no truth: pictures, but no figures.
fn a_moment_can_be_chosen() -> Outcome {
    let place = tempfile::tempdir()?;
    let out = place.path().join("out");
    infer(&clips::street(), &out, &["--at-time", "0.05", "--frames", "0"])?;
    let page = metrics::read(&out)?;
    metrics::expect_promised_keys(&page)?;
    let measured = FIGURES.iter().find(|figure| !page["views"][0][**figure].is_null());
    if let Some(figure) = measured {
        return Err(format!("{figure} of a view that has no truth: {}", page["views"][0]).into());
    }
    let has_render = files(&out)?.iter().any(|path| path.to_string_lossy().ends_with("_render.png"));
    if has_render { Ok(()) } else { Err("no picture at the moment that was asked for".into()) }
}

/// A held-out frame may change its own figures and nothing else.
fn held_out_files_do_not_reach_the_scene() -> Outcome {
    let place = tempfile::tempdir()?;
    let [clean, other, clip] = ["clean", "other", "clip"].map(|name| place.path().join(name));
    clips::copy(&clips::street(), &clip)?;
    let [own_sweep, next_sweep] =
        [clips::named_file(&clip, "/frames/1/lidar/file")?, clips::named_file(&clip, "/frames/2/lidar/file")?];
    fs::copy(next_sweep, own_sweep)?;
    let image_file = clips::named_file(&clip, "/frames/1/cameras/0/file")?;
    let mut picture = image::open(&image_file)?.to_rgb8();
    picture.iter_mut().for_each(|byte| *byte = 255 - *byte);
    picture.save(&image_file)?;
    let flags = [&HALF_SIZE[..], &["--hold-out", "1", "--views", "none"]].concat();
    infer(&clips::street(), &clean, &flags)?;
    infer(&clip, &other, &flags)?;
    if fs::read(clean.join("scene.ply"))? == fs::read(other.join("scene.ply"))? {
        return Ok(());
    }
    Err("the files of a held-out frame change the scene".into())
}

/// The same clip with epoch seconds and map coordinates gives the same figures.
fn epochs_and_map_coordinates_do_not_matter() -> Outcome {
    const EPOCH: f64 = 1_600_000_000.0;
    const SHIFT: [f64; 3] = [512_000.0, 5_400_000.0, 300.0];
    let place = tempfile::tempdir()?;
    let [near, far, clip] = ["near", "far", "clip"].map(|name| place.path().join(name));
    clips::copy(&clips::street(), &clip)?;
    clips::edit(&clip, |description| clips::shift(description, EPOCH, SHIFT))?;
    let flags = [&HALF_SIZE[..], &["--hold-out", "1", "--views", "held-out"]].concat();
    infer(&clips::street(), &near, &flags)?;
    infer(&clip, &far, &flags)?;
    let figures = |out: &Path| -> Result<Vec<f64>, String> {
        let page = metrics::read(out)?;
        let defined = FIGURES.iter().filter(|figure| !page["mean"]["held_out"][**figure].is_null());
        defined.map(|figure| metrics::number(&page, &["mean", "held_out", figure])).collect()
    };
    close("mean held-out figures", &figures(&far)?, &figures(&near)?, absolute(2e-3))
}

fn json_goes_to_stdout() -> Outcome {
    let place = tempfile::tempdir()?;
    let out = place.path().join("out");
    let printed = infer(&clips::street(), &out, &[&HALF_SIZE[..], &["--views", "none", "--json"]].concat())?;
    let printed: Value = serde_json::from_str(&printed).map_err(|e| format!("stdout is no JSON: {e}: {printed}"))?;
    let written = metrics::read(&out)?;
    if printed == written { Ok(()) } else { Err(format!("stdout says {printed:#}, the file {written:#}").into()) }
}
