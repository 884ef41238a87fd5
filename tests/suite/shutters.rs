//! Rolling shutters and fisheyes on made streets, from files to figures.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use lgs_formats::camera::Distortion;
use lgs_formats::clip_dir::ClipDir;
use lgs_tests::layouts::foreign;
use lgs_tests::metrics::{self, number};
use lgs_tests::process::{binary, run};
use lgs_tests::{Needed, Outcome, case, case_if, clips, places};
use libtest_mimic::{Failed, Trial};
use serde_json::{Value, json};

/// What the readout of five cameras is worth at 15 m/s and 30 ms, decibels; measured: 1.1 at 192x320.
const WORTH: f64 = 0.4;

pub(crate) fn cases() -> Vec<Trial> {
    let rolling = Needed::path(&rolling_clip(), "the real clips");
    vec![
        case("shutters::a_readout_that_is_stated_is_worth_it", stated_readout),
        case_if(&rolling, "shutters::a_readout_that_nobody_states_is_told", unsaid_readout),
        case("shutters::a_readout_of_nothing_changes_no_bit", no_readout),
        case("shutters::a_fisheye_is_cut_into_pinholes", pinholes_of_fisheyes),
        case("shutters::a_fisheye_of_dgp_is_one", fisheye_of_dgp),
    ]
}

/// The street as five cameras see it from a car at 15 m/s.
fn street(place: &Path, name: &str, flags: &[&str]) -> Result<PathBuf, Failed> {
    let usual = ["scenes", "--preset", "street", "--split", "test", "--seed", "3", "--speed", "15", "--images", "png"];
    let mut arguments: Vec<&OsStr> = usual.iter().chain(flags).map(OsStr::new).collect();
    arguments.extend(["--name".as_ref(), OsStr::new(name), "--out".as_ref(), place.as_os_str()]);
    run(&binary("lgs-train")?, &arguments, places::repository())?.expect_success()?;
    Ok(place.join(name))
}

fn each_camera(clip: &Path, change: impl Fn(&Value) -> Vec<Value>) -> Result<(), String> {
    clips::edit(clip, |description| {
        for frame in description["frames"].as_array_mut().into_iter().flatten() {
            let cameras: Vec<Value> = frame["cameras"].as_array().into_iter().flatten().flat_map(&change).collect();
            frame["cameras"] = json!(cameras);
        }
    })
}

fn without(key: &str) -> impl Fn(&Value) -> Vec<Value> + '_ {
    move |camera| {
        let mut camera = camera.clone();
        camera.as_object_mut().map(|keys| keys.remove(key));
        vec![camera]
    }
}

/// `metrics.json` of a run with odd frames held out, written to `out`.
fn infer(clip: &Path, out: &Path, flags: &[&str]) -> Result<Value, Failed> {
    let mut arguments: Vec<&OsStr> = vec![clip.as_os_str(), "--out".as_ref(), out.as_os_str()];
    arguments.extend(["--hold-out", "odd"].iter().chain(flags).map(OsStr::new));
    run(&binary("lgs-infer")?, &arguments, places::repository())?.expect_success()?;
    Ok(metrics::read(out)?)
}

/// The shutters of Waymo's cameras go from left to right: at 15 m/s, the ends of an image of the side are seen from places half a metre apart.
fn stated_readout() -> Outcome {
    let place = tempfile::tempdir()?;
    let flags = ["--cameras", "5", "--image-size", "96x160", "--readout", "0.03:left_to_right"];
    let clip = street(place.path(), "rolling", &flags)?;
    let shown = ["--views", "held-out"];
    let stated = infer(&clip, &place.path().join("stated"), &shown)?;
    each_camera(&clip, without("readout"))?;
    let all = [&shown[..], &["--shutters", "stated", "--mounts", "stated"]].concat();
    let unsaid = infer(&clip, &place.path().join("unsaid"), &all)?;
    let psnr = |page: &Value| number(page, &["mean", "held_out", "psnr"]);
    let (stated, unsaid) = (psnr(&stated)?, psnr(&unsaid)?);
    if stated > unsaid + WORTH {
        return Ok(());
    }
    Err(format!("{unsaid} dB without the readout, {stated} dB with it").into())
}

/// A drive whose clip says nothing of its camera's shutter, which reads an image from the top down in some 40 ms.
fn rolling_clip() -> PathBuf {
    places::shared().join("clips/pandaset_front11")
}

fn unsaid_readout() -> Outcome {
    let place = tempfile::tempdir()?;
    let usual = ["--image-size", "135x240", "--refine-steps", "0", "--views", "none"];
    let told = infer(&rolling_clip(), &place.path().join("told"), &usual)?;
    let readout = &told["calibration"][0]["readout"];
    let seconds = readout["seconds"].as_f64().unwrap_or(0.0);
    if readout["direction"] != json!("top_to_bottom") || !(0.015..0.06).contains(&seconds) {
        return Err(format!("told {}", told["calibration"]).into());
    }
    let stated =
        infer(&rolling_clip(), &place.path().join("stated"), &[&usual[..], &["--shutters", "stated"]].concat())?;
    let none = stated["calibration"].as_array().into_iter().flatten().all(|camera| camera["readout"].is_null());
    if none { Ok(()) } else { Err(format!("where shutters are as stated: {}", stated["calibration"]).into()) }
}

fn no_readout() -> Outcome {
    let place = tempfile::tempdir()?;
    let flags = ["--image-size", "96x160", "--readout", "0.0:bottom_to_top"];
    let clip = street(place.path(), "at_once", &flags)?;
    let outs = ["stated", "unsaid"].map(|name| place.path().join(name));
    let few = ["--frames", "0..3", "--views", "held-out"];
    infer(&clip, &outs[0], &few)?;
    each_camera(&clip, without("readout"))?;
    infer(&clip, &outs[1], &few)?;
    for file in ["scene.ply", "views/f1_front_render.png"] {
        let [stated, unsaid] = [&outs[0], &outs[1]].map(|out| std::fs::read(out.join(file)));
        if stated? != unsaid? {
            return Err(format!("{file} differs by a readout of 0 s").into());
        }
    }
    Ok(())
}

/// Cameras of 150 degrees, each as two pinholes that look 30 degrees to the left and to the right.
fn pinholes_of_fisheyes() -> Outcome {
    let place = tempfile::tempdir()?;
    let clip = street(place.path(), "wide", &["--image-size", "96x160", "--fisheye", "150"])?;
    each_camera(&clip, |camera| {
        let pinhole = |(side, degrees): (&str, f64)| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let mut own = camera.clone();
            own["name"] = json!(format!("{}_{side}", camera["name"].as_str().unwrap_or_default()));
            own["pinhole"] = json!({
                "width": 96, "height": 80, "intrinsics": {"fx": 65.0, "fy": 65.0, "cx": 48.0, "cy": 40.0},
                "fisheye_from_pinhole": [[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]],
            });
            own
        };
        [("left", -30.0), ("right", 30.0)].map(pinhole).to_vec()
    })?;
    let shown = ["--views", "held-out"];
    let cut = infer(&clip, &place.path().join("cut"), &shown)?;
    let mean = |page: &Value, key: &str| number(page, &["mean", "held_out", key]);
    let (psnr, copying) = (mean(&cut, "psnr")?, mean(&cut, "psnr_copying")?);
    each_camera(&clip, |camera| without("pinhole")(&without("fisheye")(camera)[0]))?;
    let bent = infer(&clip, &place.path().join("bent"), &shown)?;
    let bent = mean(&bent, "psnr")?;
    if psnr > copying + 3.0 && psnr > bent + 2.0 {
        return Ok(());
    }
    Err(format!("{psnr} dB, copying {copying} dB, as if there were no lens {bent} dB").into())
}

fn fisheye_of_dgp() -> Outcome {
    let place = tempfile::tempdir()?;
    let folder = place.path().join("dgp");
    clips::copy(&foreign("dgp")?.path(), &folder)?;
    let file = folder.join("calibration/cal.json");
    let text = std::fs::read_to_string(&file)?;
    std::fs::write(&file, text.replace("\"skew\": 0.0", "\"skew\": 0.0, \"fisheye\": 1, \"k4\": 0.001"))?;
    let out = place.path().join("clip");
    let arguments: [&OsStr; 5] =
        ["import".as_ref(), "dgp".as_ref(), folder.as_os_str(), "--out".as_ref(), out.as_os_str()];
    run(&binary("lgs-clip")?, &arguments, places::repository())?.expect_success()?;
    match ClipDir::open(&out)?.clip().frames[0].cameras[0].camera.distortion {
        Some(Distortion::Fisheye(lens)) if lens.coefficients[3] == 0.001 => Ok(()),
        other => Err(format!("{other:?}").into()),
    }
}
