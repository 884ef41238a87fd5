//! `--path`: films of a scene.

use std::fs::{self, File};
use std::io::BufReader;
use std::path::Path;

use image::{AnimationDecoder, codecs::png::PngDecoder};
use lgs_tests::process::{Finished, binary, run};
use lgs_tests::{Outcome, case, clips};
use libtest_mimic::Trial;
use serde_json::{Value, json};

/// What is said of a path's file.
type Refusal = (&'static str, fn(&mut Value), &'static [&'static str]);

#[rustfmt::skip]
const REFUSED: [Refusal; 7] = [
    ("another_format", |path| path["format"] = json!("lgs-path/9"), &["path.json", "format", "lgs-path/1"]),
    ("no_pose", |path| path["poses"] = json!([]), &["path.json", "poses", "1 to 10000"]),
    ("a_pose_that_is_no_pose", |path| path["poses"][0]["world_from_camera"][0][0] = json!(9), &["path.json", "poses[0].world_from_camera", "rigid"]),
    ("a_moment_in_milliseconds", |path| path["poses"][1]["timestamp"] = json!(1.7e12), &["path.json", "poses[1].timestamp", "seconds"]),
    ("an_unknown_key", |path| path["speed"] = json!(3), &["path.json", "unknown field `speed`"]),
    ("pictures_without_end", |path| path["camera"]["width"] = json!(4_000_000_000_u32), &["path.json", "camera.width", "1 to 16384"]),
    ("a_lens_without_focal_length", |path| path["camera"]["intrinsics"]["fy"] = json!(0), &["path.json", "camera.intrinsics.fy"]),
];

pub(crate) fn cases() -> Vec<Trial> {
    let mut cases = vec![
        case("cli::film::goes_between_the_inputs", goes_between_the_inputs),
        case("cli::film::goes_where_a_file_says", goes_where_a_file_says),
        case("cli::film::half_a_file_is_refused", half_a_file_is_refused),
        case("cli::film::needs_a_way_to_go", needs_a_way_to_go),
    ];
    let refused = REFUSED.iter().map(|(name, spoil, names)| {
        case(format!("cli::film::{name}_is_refused"), || refuses(&spoilt(*spoil)?.to_string(), names))
    });
    cases.extend(refused);
    cases
}

fn infer(place: &Path, flags: &[&str]) -> Result<Finished, String> {
    let street = clips::street();
    let fixed = ["--out", "out", "--weights", "none", "--image-size", "48x80", "--background", "gaps"];
    let mut arguments = vec![street.as_os_str()];
    arguments.extend(fixed.iter().chain(flags).map(|flag| flag.as_ref() as &std::ffi::OsStr));
    run(&binary("lgs-infer")?, &arguments, place)
}

/// The pictures of the moving file, and that they are those of the numbered ones, to the byte.
fn pictures(place: &Path) -> Result<Vec<image::RgbImage>, String> {
    let failed = |e: image::ImageError| e.to_string();
    let file = File::open(place.join("out/path.png")).map_err(|e| e.to_string())?;
    let frames =
        PngDecoder::new(BufReader::new(file)).and_then(|decoder| decoder.apng()).map_err(failed)?.into_frames();
    let frames = frames.collect_frames().map_err(failed)?;
    let folder = place.join("out/path");
    let names = fs::read_dir(&folder).map_err(|e| e.to_string())?.count();
    if names != frames.len() {
        return Err(format!("{} pictures in the file, {names} in the folder", frames.len()));
    }
    let mut pictures = Vec::new();
    for (index, frame) in frames.into_iter().enumerate() {
        let moving = image::DynamicImage::from(frame.into_buffer()).into_rgb8();
        let numbered = image::open(folder.join(format!("{index:05}.png"))).map_err(failed)?.into_rgb8();
        if moving != numbered {
            return Err(format!("picture {index} is not that of its number"));
        }
        pictures.push(moving);
    }
    Ok(pictures)
}

/// Mean absolute difference of two pictures, grey levels.
fn difference(a: &image::RgbImage, b: &image::RgbImage) -> f64 {
    let sum: f64 = a.iter().zip(b.iter()).map(|(a, b)| f64::from(a.abs_diff(*b))).sum();
    sum / a.len().max(1) as f64
}

fn goes_between_the_inputs() -> Outcome {
    let place = tempfile::tempdir()?;
    infer(place.path(), &["--path", "between-inputs", "--path-frames", "9"])?.expect_success()?;
    let pictures = pictures(place.path())?;
    if pictures.len() != 9 || pictures[0].dimensions() != (80, 48) {
        return Err(format!("{} pictures of {:?}", pictures.len(), pictures[0].dimensions()).into());
    }
    // five images: every second picture stands at one of them
    let camera = clips::description(&clips::street())?["frames"][0]["cameras"][0]["name"].clone();
    for frame in 0..5 {
        let name = format!("out/views/f{frame}_{}_render.png", camera.as_str().unwrap_or_default());
        let drawn = image::open(place.path().join(name))?.into_rgb8();
        let far = difference(&drawn, &pictures[2 * frame]);
        if far > 0.05 {
            return Err(format!("picture {} differs from the view of frame {frame} by {far}", 2 * frame).into());
        }
    }
    let steps: Vec<f64> = pictures.windows(2).map(|pair| difference(&pair[0], &pair[1])).collect();
    if steps.iter().all(|&step| step > 0.2) { Ok(()) } else { Err(format!("it stands still: {steps:?}").into()) }
}

/// A path through the first camera's places of the frames 0 and 4, with a lens of its own.
fn good_path() -> Result<Value, String> {
    let clip = clips::description(&clips::street())?;
    let pose = |frame: usize| {
        let record = &clip["frames"][frame]["cameras"][0];
        json!({"timestamp": record["timestamp"], "world_from_camera": record["world_from_camera"]})
    };
    let intrinsics = json!({"fx": 40.0, "fy": 40.0, "cx": 32.0, "cy": 18.0});
    Ok(json!({
        "format": "lgs-path/1",
        "camera": {"width": 64, "height": 36, "intrinsics": intrinsics},
        "poses": [pose(0), pose(4)],
    }))
}

fn goes_where_a_file_says() -> Outcome {
    let place = tempfile::tempdir()?;
    let mut path = good_path()?;
    fs::write(place.path().join("path.json"), path.to_string())?;
    infer(place.path(), &["--path", "path.json"])?.expect_success()?;
    let poses = pictures(place.path())?;
    fs::remove_dir_all(place.path().join("out"))?;
    infer(place.path(), &["--path", "path.json", "--path-frames", "5", "--path-fps", "30"])?.expect_success()?;
    let between = pictures(place.path())?;
    let sizes = (poses.len(), between.len(), between[0].dimensions());
    if sizes != (2, 5, (64, 36)) || difference(&between[0], &poses[0]) + difference(&between[4], &poses[1]) > 0.05 {
        return Err(format!("{sizes:?}, or other ends").into());
    }
    fs::remove_dir_all(place.path().join("out"))?;
    path["camera"] = Value::Null;
    fs::write(place.path().join("path.json"), path.to_string())?;
    infer(place.path(), &["--path", "path.json", "--at-time", "0"])?.expect_success()?;
    let own = pictures(place.path())?;
    if own[0].dimensions() == (80, 48) { Ok(()) } else { Err(format!("{:?}", own[0].dimensions()).into()) }
}

fn spoilt(spoil: fn(&mut Value)) -> Result<Value, String> {
    let mut path = good_path()?;
    spoil(&mut path);
    Ok(path)
}

fn refuses(text: &str, names: &[&str]) -> Outcome {
    let place = tempfile::tempdir()?;
    fs::write(place.path().join("path.json"), text)?;
    infer(place.path(), &["--path", "path.json"])?.expect_refusal(names)?;
    if place.path().join("out").exists() { Err("the refused run left an output directory".into()) } else { Ok(()) }
}

fn half_a_file_is_refused() -> Outcome {
    let text = good_path()?.to_string();
    refuses(&text[..text.len() / 2], &["path.json"])?;
    refuses("", &["path.json"])?;
    refuses("\u{0}\u{1}", &["path.json"])
}

fn needs_a_way_to_go() -> Outcome {
    let place = tempfile::tempdir()?;
    let refused = |flags: &[&str], names: &[&str]| infer(place.path(), flags)?.expect_refusal(names);
    refused(&["--path", "between-inputs", "--frames", "0"], &["--path", "two moments"])?;
    refused(&["--path", "between-inputs", "--path-camera", "rear"], &["--path-camera", "front", "rear"])?;
    refused(&["--path", "nowhere.json"], &["nowhere.json", "read"])?;
    refused(&["--path-frames", "3"], &["--path"])
}
