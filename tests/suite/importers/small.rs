//! Small things that people meet: what is printed, what other programs ask for.

use std::ffi::OsStr;
use std::fs;
use std::path::Path;
use std::process::Command;

use lgs_tests::process::{Finished, binary, run};
use lgs_tests::{Needed, Outcome, case, case_if, clips, places};
use libtest_mimic::Trial;
use serde_json::json;

/// The page that tells of other programs.
const VIEWERS: &str = "docs/viewers.md";

pub(crate) fn cases() -> Vec<Trial> {
    let ffmpeg = match Command::new("ffmpeg").arg("-version").output() {
        Ok(output) if output.status.success() => Needed::Here,
        _ => Needed::Missing("ffmpeg".to_owned()),
    };
    let name = |what: &str| format!("importers::small::{what}");
    vec![
        case(name("a_standing_car_has_driven_nothing"), standing_car),
        case(name("images_of_several_sizes_are_said"), sizes),
        case(name("a_compressed_scene_is_no_ply"), no_ply),
        case(name("depth_maps_of_f64"), wide_depth),
        case(name("columns_that_other_programs_ask_for"), f_rest),
        case(name("the_page_on_viewers_says_it"), page_on_viewers),
        case_if(&ffmpeg, name("a_film_of_an_odd_height"), film),
    ]
}

fn clip_program(arguments: &[&str], place: &Path) -> Result<Finished, String> {
    run(&binary("lgs-clip")?, &arguments.iter().map(OsStr::new).collect::<Vec<_>>(), place)
}

fn standing_car() -> Outcome {
    let place = tempfile::tempdir()?;
    clips::short(&place.path().join("clip"), 1)?;
    let text = clip_program(&["inspect", "clip"], place.path())?.stdout;
    let report = clip_program(&["inspect", "clip", "--json"], place.path())?.stdout;
    if text.contains(", 0.0 m driven") && !report.contains("-0.0") { Ok(()) } else { Err((text + &report).into()) }
}

fn sizes() -> Outcome {
    let place = tempfile::tempdir()?;
    let clip = place.path().join("clip");
    clips::short(&clip, 3)?;
    let file = clips::named_file(&clip, "/frames/1/cameras/0/file")?;
    let whole = image::open(&file)?;
    let (width, height) = (whole.width(), whole.height());
    whole.crop_imm(0, 0, width - 1, height - 1).save(&file)?;
    clips::edit(&clip, |description| {
        description["frames"][1]["cameras"][0]["width"] = json!(width - 1);
        description["frames"][1]["cameras"][0]["height"] = json!(height - 1);
    })?;
    let text = clip_program(&["inspect", "clip"], place.path())?.stdout;
    let want = format!("3 images of {}x{} and {height}x{width}", height - 1, width - 1);
    let report = clip_program(&["inspect", "clip", "--json"], place.path())?.stdout;
    if text.contains(&want) && report.contains("\"sizes\"") { Ok(()) } else { Err((text + &report).into()) }
}

fn no_ply() -> Outcome {
    let place = tempfile::tempdir()?;
    clips::short(&place.path().join("clip"), 2)?;
    let flags =
        ["clip", "--weights", "none", "--views", "none", "--background", "off", "--spz", "--viewer", "--out", "scene"];
    run(&binary("lgs-infer")?, &flags, place.path())?.expect_success()?;
    for (file, kind) in [
        ("scene.spz", "compressed data, as SPZ files are"),
        ("viewer.html", "found `<!"),
        ("metrics.json", "found `{`"),
    ] {
        let finished = clip_program(&["view", &format!("scene/{file}")], place.path())?;
        finished.expect_refusal(&[file, "expected `ply`", kind])?;
        if finished.stderr.trim_end().contains(char::is_control) || finished.stderr.contains('\u{fffd}') {
            return Err(format!("bytes of the file: {:?}", finished.stderr).into());
        }
    }
    Ok(())
}

/// The same depths as numpy writes them by default, in single and in half precision.
fn wide_depth() -> Outcome {
    let source = places::repository().join("tests/fixtures/dgp");
    let array = |descr: &str, value: &[u8]| {
        let mut header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': (12, 16), }}");
        header += &" ".repeat(63 - (10 + header.len()) % 64);
        header.push('\n');
        let length = u16::try_from(header.len()).unwrap_or(0).to_le_bytes();
        [b"\x93NUMPY\x01\x00", length.as_slice(), header.as_bytes(), &value.repeat(12 * 16)].concat()
    };
    let kinds =
        [("<f8", 4.0_f64.to_le_bytes().to_vec()), ("<f4", 4.0_f32.to_le_bytes().to_vec()), ("<f2", vec![0x00, 0x44])];
    for (descr, value) in kinds {
        let place = tempfile::tempdir()?;
        fs::create_dir(place.path().join("own"))?;
        fs::write(place.path().join("own/0000_CAMERA_01.npy"), array(descr, &value))?;
        let from = source.to_string_lossy();
        let flags = ["import", "dgp", &from, "--out", "clip", "--depth", "own", "--depth-kind", "metric"];
        clip_program(&flags, place.path())?.expect_success()?;
        let map = lgs_formats::clip_dir::ClipDir::open(&place.path().join("clip"))?.load_depth(0, 0, None)?;
        if !map.is_some_and(|map| map.inverse.iter().all(|&inverse| inverse == 0.25)) {
            return Err(format!("{descr}: another depth than 4 m").into());
        }
    }
    let place = tempfile::tempdir()?;
    fs::create_dir(place.path().join("own"))?;
    fs::write(place.path().join("own/0000_CAMERA_01.npy"), array("<i4", &[4, 0, 0, 0]))?;
    let from = source.to_string_lossy();
    let flags = ["import", "dgp", &from, "--out", "clip", "--depth", "own", "--depth-kind", "metric"];
    clip_program(&flags, place.path())?.expect_refusal(&["0000_CAMERA_01.npy", "floating-point", "<f8", "Int(4)"])
}

/// The 62 properties of 3D Gaussian Splatting in their order, and the same scene as without the flag.
fn f_rest() -> Outcome {
    let place = tempfile::tempdir()?;
    clips::short(&place.path().join("clip"), 2)?;
    let scene = |flag: &str| -> Result<Vec<u8>, Box<dyn std::error::Error>> {
        let flags = ["clip", "--weights", "none", "--views", "none", "--background", "off", flag, "--out", "scene"];
        run(&binary("lgs-infer")?, &flags, place.path())?.expect_success().map_err(|e| format!("{:?}", e.message()))?;
        Ok(fs::read(place.path().join("scene/scene.ply"))?)
    };
    let (plain, full) = (scene("--plain")?, scene("--f-rest")?);
    let rest: Vec<String> = (0..45).map(|k| format!("f_rest_{k}")).collect();
    let words = |text: &str| text.split(' ').map(str::to_owned).collect::<Vec<_>>();
    let before = words("x y z nx ny nz f_dc_0 f_dc_1 f_dc_2");
    let behind = words("opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3");
    let want: Vec<String> = [before, rest, behind].concat();
    let split = |bytes: &[u8]| -> Option<(Vec<String>, Vec<[u8; 4]>)> {
        let end = bytes.windows(11).position(|window| window == b"end_header\n")? + 11;
        let header = std::str::from_utf8(&bytes[..end]).ok()?;
        let names = header.lines().filter_map(|line| line.strip_prefix("property float ")).map(str::to_owned).collect();
        Some((names, bytes[end..].as_chunks::<4>().0.to_vec()))
    };
    let ((short, a), (names, b)) = (split(&plain).ok_or("no header")?, split(&full).ok_or("no header")?);
    if names != want || short.len() != 17 {
        return Err(format!("properties {names:?}, {short:?}").into());
    }
    let same = a
        .chunks_exact(17)
        .zip(b.chunks_exact(62))
        .all(|(a, b)| a[..9] == b[..9] && a[9..] == b[54..] && b[9..54].iter().all(|value| *value == [0; 4]));
    if same && a.len() / 17 == b.len() / 62 && !a.is_empty() { Ok(()) } else { Err("other values".into()) }
}

fn page_on_viewers() -> Outcome {
    let text = fs::read_to_string(places::repository().join(VIEWERS))?;
    for words in ["z is up", "--f-rest", "pad=ceil(iw/2)*2:ceil(ih/2)*2"] {
        if !text.contains(words) {
            return Err(format!("{VIEWERS} does not say {words}").into());
        }
    }
    Ok(())
}

/// The page's own line on pictures of odd sides.
fn film() -> Outcome {
    let text = fs::read_to_string(places::repository().join(VIEWERS))?;
    let line = text.split('`').find(|code| code.starts_with("ffmpeg ")).ok_or("no line for ffmpeg")?;
    let place = tempfile::tempdir()?;
    let pictures = place.path().join("out/street_film/path");
    fs::create_dir_all(&pictures)?;
    for k in 0..3 {
        image::RgbImage::from_pixel(125, 37, image::Rgb([90; 3])).save(pictures.join(format!("{k:05}.png")))?;
    }
    let output = Command::new("sh").args(["-c", line]).current_dir(place.path()).output()?;
    let film = fs::metadata(place.path().join("film.mp4"));
    if output.status.success() && film.is_ok_and(|film| film.len() > 0) {
        return Ok(());
    }
    Err(String::from_utf8_lossy(&output.stderr).into_owned().into())
}
