//! Depth maps of a clip: what they become, what they must not reach, and what is refused.

use std::fs;
use std::path::{Path, PathBuf};

use lgs_tests::process::{Finished, binary, run};
use lgs_tests::{Outcome, case, clips, metrics};
use libtest_mimic::Trial;
use serde_json::{Value, json};

/// Flags of a small procedural clip: three moments of two cameras.
const SMALL: [&str; 14] = [
    "--count",
    "1",
    "--preset",
    "street",
    "--frames",
    "3",
    "--image-size",
    "64x96",
    "--beams",
    "16",
    "--azimuths",
    "240",
    "--name",
    "clip",
];

pub(crate) fn cases() -> Vec<Trial> {
    let mut cases = vec![
        case("cli::depth_maps::relative_maps_are_brought_to_metres", relative_maps_are_brought_to_metres),
        case("cli::depth_maps::exact_maps_are_better_than_a_guess", exact_maps_are_better_than_a_guess),
        case("cli::depth_maps::maps_of_held_out_frames_are_not_read", maps_of_held_out_frames_are_not_read),
        case("cli::depth_maps::a_clip_without_maps_has_none_to_use", a_clip_without_maps_has_none_to_use),
    ];
    cases.extend(SPOILT.iter().map(|spoilt| case(format!("cli::depth_maps::{}", spoilt.name), || refuses(spoilt))));
    cases
}

/// A small clip with depth maps.
fn clip(place: &Path, depth: &str) -> Result<PathBuf, String> {
    let arguments = [&["scenes", "--out", ".", "--depth", depth], SMALL.as_slice()].concat();
    let finished = run(&binary("lgs-train")?, &arguments, place)?;
    if finished.code == Some(0) { Ok(place.join("clip")) } else { Err(finished.stderr) }
}

fn infer(clip: &Path, out: &Path, flags: &[&str]) -> Result<Finished, String> {
    let fixed = ["--weights", "none", "--hold-out", "1"];
    let mut arguments = vec![clip.as_os_str(), "--out".as_ref(), out.as_os_str()];
    arguments.extend(fixed.iter().chain(flags).map(|flag| flag.as_ref() as &std::ffi::OsStr));
    run(&binary("lgs-infer")?, &arguments, out.parent().unwrap_or(out))
}

fn relative_maps_are_brought_to_metres() -> Outcome {
    let place = tempfile::tempdir()?;
    let clip = clip(place.path(), "relative")?;
    let [auto, maps] = ["auto", "maps"].map(|name| place.path().join(name));
    let finished = infer(&clip, &auto, &["--views", "none"])?;
    finished.expect_success()?;
    let note = finished.stderr.trim_end();
    if !note.starts_with("lgs-infer: depth maps: 4 of 4 used, median error") || note.lines().count() != 1 {
        return Err(format!("standard error says {note:?}").into());
    }
    infer(&clip, &maps, &["--views", "none", "--background", "maps"])?.expect_success()?;
    if fs::read(auto.join("scene.ply"))? != fs::read(maps.join("scene.ply"))? {
        return Err("auto is not maps where the clip has some".into());
    }
    let page = metrics::read(&auto)?;
    let fits = page["depth_maps"].as_array().ok_or("metrics.json has no depth_maps")?;
    for fit in fits {
        let number = |key: &str| fit[key].as_f64().ok_or_else(|| format!("{key} of {fit}"));
        let good = fit["used"] == true && fit["kind"] == "relative" && fit["frame"] != 1;
        if !good
            || number("error")? > 0.1
            || number("inliers")? < 0.5
            || number("scale")? <= 0.0
            || number("returns")? < 100.0
        {
            return Err(format!("{fit}").into());
        }
    }
    let report = fs::read_to_string(auto.join("report.html"))?;
    if fits.len() == 4 && report.contains("4 of 4 used, median error") {
        return Ok(());
    }
    Err(format!("{} fits, or none in the report", fits.len()).into())
}

fn exact_maps_are_better_than_a_guess() -> Outcome {
    let place = tempfile::tempdir()?;
    let clip = clip(place.path(), "metric")?;
    let psnr = |background: &str| -> Result<f64, String> {
        let out = place.path().join(background);
        let finished = infer(&clip, &out, &["--views", "held-out", "--background", background])?;
        if finished.code != Some(0) {
            return Err(finished.stderr);
        }
        metrics::number(&metrics::read(&out)?, &["mean", "held_out", "psnr"])
    };
    let (maps, gaps, sky) = (psnr("maps")?, psnr("gaps")?, psnr("sky")?);
    let page = metrics::read(&place.path().join("maps"))?;
    let fit = &page["depth_maps"][0];
    if (&fit["scale"], &fit["shift"]) != (&json!(1.0), &json!(0.0)) {
        return Err(format!("a map that is right was changed: {fit}").into());
    }
    if maps > gaps && maps > sky { Ok(()) } else { Err(format!("maps {maps}, gaps {gaps}, sky {sky} dB").into()) }
}

fn maps_of_held_out_frames_are_not_read() -> Outcome {
    let place = tempfile::tempdir()?;
    let clip = clip(place.path(), "metric")?;
    let [before, after] = ["before", "after"].map(|name| place.path().join(name));
    infer(&clip, &before, &["--views", "none"])?.expect_success()?;
    let map = clips::named_file(&clip, "/frames/1/cameras/0/depth/file")?;
    let mut bytes = fs::read(&map)?;
    bytes[1000..1004].copy_from_slice(&(-1.0_f32).to_le_bytes());
    fs::write(&map, bytes)?;
    infer(&clip, &after, &["--views", "none"])?.expect_success()?;
    if fs::read(before.join("scene.ply"))? == fs::read(after.join("scene.ply"))? {
        return Ok(());
    }
    Err("the map of a held-out frame changes the scene".into())
}

fn a_clip_without_maps_has_none_to_use() -> Outcome {
    let place = tempfile::tempdir()?;
    let out = place.path().join("out");
    infer(&clips::street(), &out, &["--background", "maps", "--image-size", "24x40"])?.expect_refusal(&[
        "--background",
        "`depth`",
        "clip.json",
    ])?;
    if out.exists() { Err("the refused run left an output directory".into()) } else { Ok(()) }
}

/// One way to spoil a clip with depth maps.
struct Spoilt {
    name: &'static str,
    depth: &'static str,
    /// What the message must hold.
    names: &'static [&'static str],
    spoil: fn(&mut Value, &Path) -> Result<(), String>,
}

#[rustfmt::skip]
const SPOILT: [Spoilt; 10] = [
    Spoilt { name: "half_a_png", depth: "relative", names: &["_front.png", "image"], spoil: |_, map| change(map, |bytes| bytes.truncate(bytes.len() / 2)) },
    Spoilt { name: "half_an_array", depth: "metric", names: &["_front.npy", "depth map", "truncated"], spoil: |_, map| change(map, |bytes| bytes.truncate(bytes.len() / 2)) },
    Spoilt { name: "no_content", depth: "metric", names: &["_front.npy", "image format", "PNG"], spoil: |_, map| change(map, Vec::clear) },
    Spoilt { name: "a_negative_depth", depth: "metric", names: &["_front.npy", "depth map[0][1]", "0.001", "-5"], spoil: |_, map| change(map, |bytes| bytes[132..136].copy_from_slice(&(-5.0_f32).to_le_bytes())) },
    Spoilt { name: "metres_in_a_relative_map", depth: "metric", names: &["_front.npy", "depth map", "finite values", "inf"], spoil: |camera, map| {
        camera["depth"]["kind"] = json!("relative");
        change(map, |bytes| bytes[128..132].copy_from_slice(&f32::INFINITY.to_le_bytes()))
    } },
    Spoilt { name: "an_array_of_another_version", depth: "metric", names: &["_front.npy", "depth map", "numpy header"], spoil: |_, map| change(map, |bytes| bytes[6] = 9) },
    Spoilt { name: "an_array_without_end", depth: "metric", names: &["_front.npy", "depth map", "shape [64, 96]"], spoil: |_, map| change(map, |bytes| {
        let header = b"{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999, 99999999999), }";
        bytes[10..10 + header.len()].copy_from_slice(header);
    }) },
    Spoilt { name: "another_kind", depth: "metric", names: &["clip.json", "frames[0].cameras[0].depth.kind", "disparity"], spoil: |camera, _| { camera["depth"]["kind"] = json!("disparity"); Ok(()) } },
    Spoilt { name: "a_map_out_of_the_clip", depth: "metric", names: &["clip.json", "frames[0].cameras[0].depth.file", ".."], spoil: |camera, _| { camera["depth"]["file"] = json!("../map.npy"); Ok(()) } },
    Spoilt { name: "an_image_as_a_map", depth: "relative", names: &["_front.jpg", "16-bit grey"], spoil: |camera, _| { camera["depth"]["file"] = camera["file"].clone(); Ok(()) } },
];

fn change(map: &Path, how: impl FnOnce(&mut Vec<u8>)) -> Result<(), String> {
    let failed = |e: std::io::Error| format!("{}: {e}", map.display());
    let mut bytes = fs::read(map).map_err(failed)?;
    how(&mut bytes);
    fs::write(map, bytes).map_err(failed)
}

fn refuses(spoilt: &Spoilt) -> Outcome {
    let place = tempfile::tempdir()?;
    let (clip, out) = (clip(place.path(), spoilt.depth)?, place.path().join("out"));
    let map = clips::named_file(&clip, "/frames/0/cameras/0/depth/file")?;
    let mut said = Ok(());
    clips::edit(&clip, |description| said = (spoilt.spoil)(&mut description["frames"][0]["cameras"][0], &map))?;
    said?;
    infer(&clip, &out, &[])?.expect_refusal(spoilt.names)?;
    if out.exists() { Err("the refused run left an output directory".into()) } else { Ok(()) }
}
