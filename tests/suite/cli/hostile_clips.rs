//! Clips that are wrong in one way each: one line that names file and field, exit code 2, `--out` untouched.

use std::fs::{self, File};
use std::path::Path;

use lgs_tests::process::{binary, run};
use lgs_tests::{Outcome, case, clips};
use libtest_mimic::Trial;
use serde_json::{Value, json};

/// One way to spoil a clip.
struct Spoilt {
    name: &'static str,
    /// What the message must hold.
    names: &'static [&'static str],
    spoil: fn(&Path) -> Outcome,
}

const LIDAR: &str = "/frames/0/lidar/file";
const IMAGE: &str = "/frames/0/cameras/0/file";

const SPOILT: [Spoilt; 21] = [
    Spoilt { name: "no_clip_json", names: &["clip.json"], spoil: |clip| Ok(fs::remove_file(clip.join("clip.json"))?) },
    Spoilt {
        name: "half_a_clip_json",
        names: &["clip.json"],
        spoil: |clip| shorten(&clip.join("clip.json"), |bytes| bytes / 2),
    },
    Spoilt {
        name: "other_format",
        names: &["clip.json", "format"],
        spoil: |clip| set(clip, "/format", json!("lgs-clip/9")),
    },
    Spoilt { name: "no_frames", names: &["clip.json", "frames"], spoil: |clip| set(clip, "/frames", json!([])) },
    Spoilt {
        name: "unknown_key",
        names: &["clip.json", "frames[0].lidar", "range_m"],
        spoil: |clip| Ok(clips::edit(clip, |v| v["frames"][0]["lidar"]["range_m"] = json!(80.0))?),
    },
    Spoilt {
        name: "missing_key",
        names: &["clip.json", "frames[0].lidar", "timestamp"],
        spoil: |clip| set(clip, "/frames/0/lidar", json!({"file": "lidar/0000.bin"})),
    },
    Spoilt {
        name: "missing_sweep",
        names: &["clip.json", "frames[0].lidar.file"],
        spoil: |clip| Ok(fs::remove_file(clips::named_file(clip, LIDAR)?)?),
    },
    Spoilt {
        name: "missing_image",
        names: &["clip.json", "frames[0].cameras[0].file"],
        spoil: |clip| Ok(fs::remove_file(clips::named_file(clip, IMAGE)?)?),
    },
    Spoilt {
        name: "truncated_sweep",
        names: &["lidar", "16"],
        spoil: |clip| shorten(&clips::named_file(clip, LIDAR)?, |bytes| bytes - 3),
    },
    Spoilt {
        name: "frame_without_points",
        names: &["lidar"],
        spoil: |clip| shorten(&clips::named_file(clip, LIDAR)?, |_| 0),
    },
    Spoilt { name: "nan_point", names: &["lidar", "NaN"], spoil: nan_point },
    Spoilt { name: "nan_pose", names: &["clip.json"], spoil: |clip| replace_number(clip, "NaN") },
    Spoilt { name: "infinite_pose", names: &["clip.json", "frames[0]"], spoil: |clip| replace_number(clip, "1e999") },
    Spoilt {
        name: "non_rigid_pose",
        names: &["clip.json", "frames[0].cameras[0].world_from_camera", "rigid"],
        spoil: |clip| set(clip, "/frames/0/cameras/0/world_from_camera/0/0", json!(2.0)),
    },
    Spoilt {
        name: "text_for_a_number",
        names: &["clip.json", "frames[0].lidar.timestamp"],
        spoil: |clip| set(clip, "/frames/0/lidar/timestamp", json!("now")),
    },
    Spoilt {
        name: "zero_size_image",
        names: &["clip.json", "frames[0].cameras[0].width", "0"],
        spoil: |clip| set(clip, "/frames/0/cameras/0/width", json!(0)),
    },
    Spoilt {
        name: "empty_image_file",
        names: &["images"],
        spoil: |clip| shorten(&clips::named_file(clip, IMAGE)?, |_| 0),
    },
    Spoilt {
        name: "half_an_image_file",
        names: &["images"],
        spoil: |clip| shorten(&clips::named_file(clip, IMAGE)?, |bytes| bytes / 2),
    },
    Spoilt { name: "image_of_another_size", names: &["images"], spoil: image_of_another_size },
    Spoilt {
        name: "path_out_of_the_clip",
        names: &["clip.json", "frames[0].lidar.file"],
        spoil: |clip| set(clip, LIDAR, json!("../0000.bin")),
    },
    Spoilt {
        name: "negative_focal_length",
        names: &["clip.json", "frames[0].cameras[0].intrinsics.fx"],
        spoil: |clip| set(clip, "/frames/0/cameras/0/intrinsics/fx", json!(-500.0)),
    },
];

pub(crate) fn cases() -> Vec<Trial> {
    let mut cases: Vec<Trial> =
        SPOILT.iter().map(|s| case(format!("cli::hostile::{}", s.name), || refuses(s))).collect();
    cases.push(case("cli::hostile::not_a_directory", || refuses_path("clip.json")));
    cases.push(case("cli::hostile::no_such_directory", || refuses_path("nowhere")));
    cases.push(case("cli::hostile::out_keeps_its_files", out_keeps_its_files));
    cases
}

fn refuses(spoilt: &Spoilt) -> Outcome {
    let place = tempfile::tempdir()?;
    let (clip, out) = (place.path().join("clip"), place.path().join("out"));
    clips::copy(&clips::street(), &clip)?;
    (spoilt.spoil)(&clip)?;
    infer(&clip, &out)?.expect_refusal(spoilt.names)?;
    if out.exists() { Err("the refused run left an output directory".into()) } else { Ok(()) }
}

fn infer(clip: &Path, out: &Path) -> Result<lgs_tests::process::Finished, String> {
    let arguments = [clip.as_os_str(), "--out".as_ref(), out.as_os_str(), "--weights".as_ref(), "none".as_ref()];
    run(&binary("lgs-infer")?, &arguments, out.parent().unwrap_or(out))
}

/// A clip directory that is a file of the clip, or is not there.
fn refuses_path(name: &str) -> Outcome {
    let place = tempfile::tempdir()?;
    let out = place.path().join("out");
    infer(&clips::street().join(name), &out)?.expect_refusal(&[name])?;
    if out.exists() { Err("the refused run left an output directory".into()) } else { Ok(()) }
}

fn out_keeps_its_files() -> Outcome {
    let place = tempfile::tempdir()?;
    let (clip, out) = (place.path().join("clip"), place.path().join("out"));
    clips::copy(&clips::street(), &clip)?;
    fs::create_dir(&out)?;
    fs::write(out.join("metrics.json"), "mine")?;
    fs::remove_file(clips::named_file(&clip, LIDAR)?)?;
    infer(&clip, &out)?.expect_refusal(&[])?;
    let names: Vec<_> = fs::read_dir(&out)?.flatten().map(|entry| entry.file_name()).collect();
    if names == ["metrics.json"] && fs::read_to_string(out.join("metrics.json"))? == "mine" {
        return Ok(());
    }
    Err(format!("the refused run changed the output directory: {names:?}").into())
}

fn set(clip: &Path, pointer: &str, value: Value) -> Outcome {
    let mut found = false;
    clips::edit(clip, |description| {
        if let Some(place) = description.pointer_mut(pointer) {
            *place = value;
            found = true;
        }
    })?;
    if found { Ok(()) } else { Err(format!("clip.json has no {pointer}").into()) }
}

/// Puts a word where JSON wants a number: the first entry of the first sweep's pose.
fn replace_number(clip: &Path, word: &str) -> Outcome {
    set(clip, "/frames/0/lidar/world_from_lidar/0/0", json!("PLACE"))?;
    let path = clip.join("clip.json");
    let text = fs::read_to_string(&path)?;
    Ok(fs::write(&path, text.replace("\"PLACE\"", word))?)
}

fn shorten(path: &Path, length: fn(u64) -> u64) -> Outcome {
    let bytes = fs::metadata(path)?.len();
    Ok(File::options().write(true).open(path)?.set_len(length(bytes))?)
}

fn nan_point(clip: &Path) -> Outcome {
    let path = clips::named_file(clip, LIDAR)?;
    let mut bytes = fs::read(&path)?;
    bytes[16..20].copy_from_slice(&f32::NAN.to_le_bytes());
    Ok(fs::write(&path, bytes)?)
}

fn image_of_another_size(clip: &Path) -> Outcome {
    let path = clips::named_file(clip, IMAGE)?;
    let picture = image::open(&path)?;
    Ok(picture.crop_imm(0, 0, picture.width() - 1, picture.height()).save(&path)?)
}
