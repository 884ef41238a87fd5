//! Figures, parts, failures, refusals.

use std::fs;
use std::path::Path;

use lgs_tests::process::{binary, run};
use lgs_tests::{Outcome, case, clips, layouts, metrics, places};
use libtest_mimic::Trial;
use serde_json::Value;

use super::{SMALL, eval, evaluation, same_product};

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("eval::job::figures_are_those_of_inference", figures_are_those_of_inference),
        case("eval::job::parts_threads_and_whole_are_the_same_bytes", parts_and_whole),
        case("eval::job::failed_snippets_are_listed_and_the_others_are_none_the_worse", failures),
        case("eval::job::foreign_layouts_and_the_protocol_of_waymo", foreign),
        case("eval::job::scenes_of_a_release_are_drives", scenes_of_a_release),
        case("eval::job::a_drive_without_snippets_has_an_item_of_its_own", item_of_its_own),
        case("eval::job::presets_are_evaluated_on_every_snippet", presets),
        case("eval::job::scenes_of_a_whole_log_need_no_targets", scenes_alone),
        case("eval::job::refusals", refusals),
    ]
}

fn street() -> String {
    clips::street().display().to_string()
}

fn figures_are_those_of_inference() -> Outcome {
    let place = tempfile::tempdir()?;
    let shared = ["--weights", "none", "--image-size", "48x80"];
    let own = ["--protocol", "own", "--snippet-frames", "5", "--out", "evaluated"];
    eval(place.path(), &[&[street().as_str()], own.as_slice(), &shared].concat())?.expect_success()?;
    let street = street();
    let views = [street.as_str(), "--hold-out", "odd", "--views", "held-out", "--out", "inferred"];
    run(&binary("lgs-infer")?, &[views.as_slice(), &shared].concat(), place.path())?.expect_success()?;
    let (found, inferred) =
        (evaluation(&place.path().join("evaluated"))?, metrics::read(&place.path().join("inferred"))?);
    let mean = &found["means"][0]["image"];
    for key in ["psnr", "psnr_copying", "ssim", "dmae", "psnr_dynamic", "ssim_static"] {
        let (got, want) = (&mean[key], &inferred["mean"]["held_out"][key]);
        if got != want || !got.is_number() {
            return Err(format!("{key}: got {got}, lgs-infer says {want}").into());
        }
    }
    // Things move in the clip, and returns lie on them.
    let dynamic = metrics::number(mean, &["dmae_dynamic"])?;
    if dynamic > 0.0 && found["means"][0]["images"]["dmae_dynamic"] == 4 && mean["lpips"].is_null() {
        Ok(())
    } else {
        Err(format!("{}", found["means"][0]).into())
    }
}

fn parts_and_whole() -> Outcome {
    let place = tempfile::tempdir()?;
    let (street, kept) = (street(), ["--scenes", "--viewer"]);
    let go = |more: &[&str]| -> Outcome {
        eval(place.path(), &[&[street.as_str()], SMALL.as_slice(), &kept, more].concat())?.expect_success()
    };
    go(&["--out", "whole", "--threads", "1"])?;
    for part in ["3/3", "1/3", "2/3"] {
        go(&["--out", "parts", "--part", part, "--threads", "2"])?;
    }
    go(&["--out", "apart", "--part", "1/2"])?;
    eval(place.path(), &["merge", "apart", "--out", "nothing"])?.expect_refusal(&["part-2-of-2.json"])?;
    eval(place.path(), &["merge", "parts"])?.expect_success()?;
    fs::remove_file(place.path().join("parts/shares.json")).or_else(|e| match e.kind() {
        std::io::ErrorKind::NotFound => Ok(()),
        _ => Err(e),
    })?;
    same_product(&place.path().join("parts"), &place.path().join("whole"))?;
    if !fs::read_to_string(place.path().join("parts/times.csv"))?.contains("street-00002,") {
        return Err("the times of the parts are lost".into());
    }
    // What is done is not done again, and under other flags it is another job.
    let again = eval(place.path(), &[&[street.as_str()], SMALL.as_slice(), &kept, &["--out", "whole"]].concat())?;
    again.expect_one_line_at_the_end(&["--resume"])?;
    let other = eval(place.path(), &[&[street.as_str()], SMALL.as_slice(), &["--out", "whole", "--resume"]].concat())?;
    other.expect_one_line_at_the_end(&["key"])?;
    go(&["--out", "whole", "--resume"])
}

fn failures() -> Outcome {
    let place = tempfile::tempdir()?;
    for name in ["good", "spoilt"] {
        clips::short(&place.path().join(name), 5)?;
    }
    fs::create_dir(place.path().join("empty"))?;
    fs::write(place.path().join("empty/clip.json"), "{}")?;
    let image = clips::named_file(&place.path().join("spoilt"), "/frames/4/cameras/0/file")?;
    fs::write(&image, "no image")?;
    fs::write(place.path().join("list"), "good\nspoilt\nempty\n")?;
    let finished = eval(place.path(), &[&["list"], SMALL.as_slice(), &["--out", "out"]].concat())?;
    let found = evaluation(&place.path().join("out"))?;
    let names: Vec<&str> =
        found["failed"].as_array().into_iter().flatten().filter_map(|failed| failed["item"].as_str()).collect();
    if finished.code != Some(1) || names != ["spoilt-00002", "empty"] || found["counts"]["snippets"] != 5 {
        return Err(format!("exit {:?}, failed {names:?}, {}", finished.code, found["counts"]).into());
    }
    let name = image.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    if !finished.stderr.contains(&name) || !fs::read_to_string(place.path().join("out/report.html"))?.contains(&name) {
        return Err(format!("nothing says what is wrong with {name}: {}", finished.stderr).into());
    }
    // Snippets of the drive that cannot be opened as a whole are what those of the good one are.
    let figures = |snippet: &str| -> Option<Value> {
        let all = found["snippets"].as_array()?;
        Some(all.iter().find(|other| other["snippet"] == snippet)?["runs"].clone())
    };
    if figures("spoilt-00000").is_none() || figures("spoilt-00000") != figures("good-00000") {
        return Err("a snippet before the spoilt frame has other figures than without that frame".into());
    }
    // What is mended is done, and nothing else.
    let mended = place.path().join("mended");
    clips::short(&mended, 5)?;
    fs::copy(clips::named_file(&mended, "/frames/4/cameras/0/file")?, &image)?;
    fs::remove_dir_all(place.path().join("empty"))?;
    fs::rename(&mended, place.path().join("empty"))?;
    let resumed = eval(place.path(), &[&["list"], SMALL.as_slice(), &["--out", "out", "--resume"]].concat())?;
    resumed.expect_success()?;
    let (found, told) = (evaluation(&place.path().join("out"))?, "4 snippets to do, 5 done before");
    if found["counts"]["snippets"] == 9 && resumed.stderr.contains(told) {
        Ok(())
    } else {
        Err(format!("{}: {}", found["counts"], resumed.stderr).into())
    }
}

fn foreign() -> Outcome {
    let place = tempfile::tempdir()?;
    for found in layouts::FOREIGN {
        let (drive, layout) = (found.path().display().to_string(), found.folder);
        let out = format!("out-{layout}");
        eval(place.path(), &[&[drive.as_str()], SMALL.as_slice(), &["--out", &out]].concat())?.expect_success()?;
        if !metrics::number(&evaluation(&place.path().join(out))?["means"][0], &["image", "psnr"])?.is_finite() {
            return Err(format!("{layout}: no PSNR").into());
        }
    }
    let drive = places::repository().join("tests/fixtures/waymo_drive/synthetic.tfrecord").display().to_string();
    let finished = eval(place.path(), &[&drive, "--protocol", "waymo", "--weights", "none", "--out", "waymo"])?;
    finished.expect_success()?;
    let found = evaluation(&place.path().join("waymo"))?;
    let (snippet, images) = (&found["snippets"][0], &found["counts"]["images"]);
    let right = snippet["inputs"] == serde_json::json!([7, 8, 10]) && snippet["targets"] == serde_json::json!([9]);
    let marked = finished.stdout.contains("paper, other data than here: Waymo") && finished.stdout.contains("28.04");
    if right && marked && *images == 3 && found["counts"]["snippets"] == 1 {
        Ok(())
    } else {
        Err(format!("{snippet} {images}\n{}", finished.stdout).into())
    }
}

/// A release of two scenes, which are the same but for their names.
fn scenes_of_a_release() -> Outcome {
    let place = tempfile::tempdir()?;
    let release = place.path().join("release");
    copy_tree(&places::repository().join("tests/fixtures/nuscenes"), &release)?;
    let small = [SMALL.as_slice(), &["--out", "one"]].concat();
    eval(place.path(), &[&["release"], small.as_slice()].concat())?.expect_success()?;
    let double = |table: &str, keys: &[&str]| -> Outcome {
        let file = release.join("v1.0-mini").join(table);
        let mut rows: Vec<Value> = serde_json::from_str(&fs::read_to_string(&file)?)?;
        let more: Vec<Value> = rows.iter().map(|row| again(row, keys)).collect();
        rows.extend(more);
        Ok(fs::write(&file, serde_json::to_string(&rows)?)?)
    };
    double("scene.json", &["token", "name"])?;
    double("sample.json", &["token", "scene_token", "prev", "next"])?;
    double("sample_data.json", &["token", "sample_token", "prev", "next"])?;
    double("sample_annotation.json", &["token", "sample_token", "prev", "next", "instance_token"])?;
    double("instance.json", &["token"])?;
    eval(place.path(), &[&["release"], SMALL.as_slice(), &["--out", "both"]].concat())?.expect_success()?;
    let (one, both) = (evaluation(&place.path().join("one"))?, evaluation(&place.path().join("both"))?);
    let snippets = both["snippets"].as_array().cloned().unwrap_or_default();
    let runs_of = |log: &str| -> Vec<Value> {
        snippets.iter().filter(|snippet| snippet["log"] == log).map(|snippet| snippet["runs"].clone()).collect()
    };
    let (first, second) = (runs_of("scene-0001"), runs_of("scene-0001b"));
    if first.is_empty() || first != second || one["means"][0]["image"] != both["means"][0]["image"] {
        return Err(format!("{} snippets: {} and {}", snippets.len(), first.len(), second.len()).into());
    }
    let some = ["release", "--logs", "scene-0001b", "--out", "some"];
    eval(place.path(), &[some.as_slice(), &SMALL].concat())?.expect_success()?;
    let none = ["release", "--logs", "scene-0007", "--out", "none"];
    eval(place.path(), &[none.as_slice(), &SMALL].concat())?.expect_one_line_at_the_end(&["--logs", "2 drives"])
}

/// A row with another value of some keys that have one.
fn again(row: &Value, keys: &[&str]) -> Value {
    let mut row = row.clone();
    for key in keys {
        if let Some(value) = row[*key].as_str().filter(|value| !value.is_empty()).map(|value| format!("{value}b")) {
            row[*key] = value.into();
        }
    }
    row
}

fn copy_tree(from: &Path, to: &Path) -> Outcome {
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy_tree(&entry.path(), &target)?;
        } else {
            fs::copy(entry.path(), &target)?;
        }
    }
    Ok(())
}

/// A drive that cannot be opened, and whose name a snippet of another drive has too.
fn item_of_its_own() -> Outcome {
    let place = tempfile::tempdir()?;
    clips::short(&place.path().join("good"), 5)?;
    fs::create_dir(place.path().join("good-00000"))?;
    fs::write(place.path().join("good-00000/clip.json"), "{}")?;
    fs::write(place.path().join("list"), "good\ngood-00000\n")?;
    let finished = eval(place.path(), &[&["list"], SMALL.as_slice(), &["--out", "out"]].concat())?;
    let found = evaluation(&place.path().join("out"))?;
    let failed = &found["failed"][0]["item"];
    if finished.code == Some(1) && failed == "good-00000~" && found["counts"]["snippets"] == 3 {
        Ok(())
    } else {
        Err(format!("{}, failed {failed}: {}", found["counts"], finished.stderr).into())
    }
}

fn presets() -> Outcome {
    let place = tempfile::tempdir()?;
    let flags = ["--max-snippets", "2", "--sweep-presets", "--scenes", "--out", "out"];
    let finished = eval(place.path(), &[&[street().as_str()], SMALL.as_slice(), &flags].concat())?;
    finished.expect_success()?;
    let found = evaluation(&place.path().join("out"))?;
    let names: Vec<&str> =
        found["means"].as_array().into_iter().flatten().filter_map(|m| m["recipe"].as_str()).collect();
    if names != ["fast", "balanced", "accurate"] || found["counts"]["snippets"] != 2 {
        return Err(format!("{names:?}: {}", found["counts"]).into());
    }
    let csv = fs::read_to_string(place.path().join("out/times.csv"))?;
    let scene = place.path().join("out/items/street-00001/scene-accurate.ply");
    if csv.lines().count() == 7 && scene.exists() && finished.stdout.contains("balanced") {
        Ok(())
    } else {
        Err(format!("{csv}\n{}", finished.stdout).into())
    }
}

fn scenes_alone() -> Outcome {
    let place = tempfile::tempdir()?;
    let flags = ["--hold-out", "none", "--scenes", "--viewer", "--out", "out"];
    eval(place.path(), &[&[street().as_str()], SMALL.as_slice(), &flags].concat())?.expect_success()?;
    let out = place.path().join("out");
    let found = evaluation(&out)?;
    let scenes = (0..3).filter(|k| out.join(format!("items/street-0000{k}/scene.ply")).exists()).count();
    let none = found["means"][0]["image"]["psnr"].is_null() && found["counts"]["images"] == 0;
    if scenes == 3
        && none
        && out.join("play-street.html").exists()
        && found["snippets"][0]["inputs"] == serde_json::json!([0, 1, 2])
    {
        Ok(())
    } else {
        Err(format!("{scenes} scenes, {}", found["counts"]).into())
    }
}

fn refusals() -> Outcome {
    let place = tempfile::tempdir()?;
    let street = street();
    let refused = |arguments: &[&str], names: &[&str]| -> Outcome {
        eval(place.path(), &[arguments, &["--out", "out"]].concat())?.expect_refusal(names)?;
        if place.path().join("out").exists() {
            Err(format!("{arguments:?}: the output was begun").into())
        } else {
            Ok(())
        }
    };
    let own = [street.as_str(), "--protocol", "own"];
    refused(&["nowhere", "--protocol", "own"], &["nowhere"])?;
    refused(&[&street, "--protocol", "pandaset"], &["street", "at least 11 frames", "found 5"])?;
    refused(&[&street, "--protocol", "waymo", "--stride", "3"], &["--stride", "--protocol own"])?;
    refused(&[own.as_slice(), &["--snippet-frames", "3", "--hold-out", "3"]].concat(), &["--hold-out"])?;
    refused(&[own.as_slice(), &["--sweep-presets", "--refine-steps", "2"]].concat(), &["--refine-steps"])?;
    refused(&[own.as_slice(), &["--weights", "none", "--density", "exact"]].concat(), &["--density exact"])?;
    refused(&[own.as_slice(), &["--lpips-weights", "no_such"]].concat(), &["no_such"])?;
    refused(&["--protocol", "own", &place.path().display().to_string()], &["DRIVES"])?;
    eval(place.path(), &["merge", "nowhere"])?.expect_refusal(&["nowhere"])?;
    fs::write(place.path().join("out"), "a file")?;
    let onto = eval(place.path(), &[own.as_slice(), &SMALL[2..], &["--out", "out"]].concat())?;
    onto.expect_one_line_at_the_end(&["out"])
}
