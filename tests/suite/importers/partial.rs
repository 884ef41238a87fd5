//! Folders of which a part was fetched, or a part is wanted: what is not selected or optional stops nothing, what is unknown is null.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use lgs_formats::clip::Clip;
use lgs_formats::clip_dir::ClipDir;
use lgs_formats::importers::{self, Layout, Selection};
use lgs_tests::compare::{absolute, close};
use lgs_tests::layouts::foreign;
use lgs_tests::process::{Finished, binary, run};
use lgs_tests::{Needed, Outcome, case, case_if, clips, places};
use libtest_mimic::Trial;
use serde_json::{Value, json};

const DRIVE: &str = "2020_09_13/2020_09_13_drive_0001_sync";
/// Epoch of the first sweep of the fixtures, seconds.
const START: f64 = 1_600_000_000.0;

type Tried<T> = Result<T, Box<dyn std::error::Error>>;

pub(crate) fn cases() -> Vec<Trial> {
    let [part, whole] = [("foreign", "pandaset_part/002"), ("clips", "pandaset_front11")]
        .map(|(kind, name)| places::shared().join(kind).join(name));
    let needed = match Needed::path(&part, "the real foreign folders") {
        Needed::Here => Needed::path(&whole, "the real clips"),
        missing => missing,
    };
    let name = |what: &str| format!("importers::partial::{what}");
    vec![
        case_if(&needed, name("four_frames_of_a_sequence_are_those"), move || four_frames(&part, &whole)),
        case(name("the_number_of_a_file_is_the_index_of_its_pose"), numbers_are_indices),
        case(name("a_camera_that_is_left_out_may_be_broken"), left_out_cameras),
        case(name("a_camera_without_images_is_none"), cameras_without_images),
        case(name("frames_that_are_left_out_may_be_broken"), left_out_frames),
        case(name("a_clips_lost_images_stop_who_needs_them"), lost_images),
        case(name("annotations_are_optional"), no_annotations),
        case(name("no_box_at_all_is_unknown"), unknown_boxes),
        case(name("a_hole_in_poses_is_no_bridge"), holes),
        case(name("two_versions_of_a_release"), two_versions),
        case(name("every_layout_says_what_is_missing"), reasons),
    ]
}

/// A copy of the fixture of a layout.
fn copied(layout: &str, place: &Path) -> Tried<PathBuf> {
    let source = place.join("source");
    clips::copy(&foreign(layout)?.path(), &source)?;
    Ok(source)
}

fn import(layout: &str, source: &Path, flags: &[&str]) -> Tried<(Finished, PathBuf)> {
    let out = source.with_file_name("out");
    if out.exists() {
        fs::remove_dir_all(&out)?;
    }
    let arguments = ["import".as_ref(), layout.as_ref(), source.as_os_str(), "--out".as_ref(), out.as_os_str()];
    let arguments: Vec<&OsStr> = arguments.into_iter().chain(flags.iter().map(OsStr::new)).collect();
    Ok((run(&binary("lgs-clip")?, &arguments, source.parent().unwrap_or(source))?, out))
}

/// The clip that an import made.
fn imported(layout: &str, source: &Path, flags: &[&str]) -> Tried<Clip> {
    let (finished, out) = import(layout, source, flags)?;
    finished.expect_success().map_err(|e| format!("{layout} {flags:?}: {:?}", e.message()))?;
    Ok(ClipDir::open(&out)?.clip().clone())
}

fn refused(layout: &str, source: &Path, flags: &[&str], names: &[&str]) -> Outcome {
    import(layout, source, flags)?.0.expect_refusal(names)
}

fn infer(folder: &Path, flags: &[&str]) -> Result<Finished, String> {
    let place = folder.parent().unwrap_or(folder);
    let fixed = ["--out", "scene", "--weights", "none", "--background", "off"];
    let arguments: Vec<&OsStr> =
        std::iter::once(folder.as_os_str()).chain(fixed.iter().chain(flags).map(OsStr::new)).collect();
    run(&binary("lgs-infer")?, &arguments, place)
}

/// Changes a JSON file.
fn edit(file: &Path, change: impl FnOnce(&mut Value)) -> Outcome {
    let mut value = serde_json::from_slice(&fs::read(file)?)?;
    change(&mut value);
    Ok(fs::write(file, value.to_string())?)
}

fn push(list: &mut Value, item: Value) {
    list.as_array_mut().into_iter().for_each(|list| list.push(item.clone()));
}

fn four_frames(part: &Path, whole: &Path) -> Outcome {
    let lidars = Some(vec!["main_pandar64".to_owned()]);
    let selection = Selection { lidars, ..Selection::default() };
    let (got_dir, want_dir) = (importers::open_as(Layout::PandaSet, part, &selection)?, ClipDir::open(whole)?);
    let (got, want) = (got_dir.clip(), want_dir.clip());
    if got.frames.len() != 4 || got.frames.iter().any(|frame| frame.cameras.len() != 2 || frame.boxes.is_none()) {
        return Err(format!("{} frames, want 4 with two images each", got.frames.len()).into());
    }
    for (f, (a, b)) in got.frames.iter().zip(&want.frames).enumerate() {
        close("time", &[a.lidar.timestamp], &[b.lidar.timestamp], absolute(1e-6))?;
        let rows = |pose: lgs_formats::pose::Pose| pose.rows().as_flattened().to_vec();
        close("sweep", &rows(a.lidar.world_from_lidar), &rows(b.lidar.world_from_lidar), absolute(1e-6))?;
        let front = a.cameras.iter().find(|record| record.camera.name == "front_camera").ok_or("no front camera")?;
        let wanted = &b.cameras[0].camera;
        close("camera", &rows(front.camera.world_from_camera), &rows(wanted.world_from_camera), absolute(1e-6))?;
        close("time", &[front.camera.timestamp], &[wanted.timestamp], absolute(1e-6))?;
        let (a, b) = (got_dir.load_sweep(f)?.points.len(), want_dir.load_sweep(f)?.points.len());
        if a != b {
            return Err(format!("frame {f}: {a} returns, want {b}").into());
        }
    }
    Ok(())
}

/// One sweep of three with all poses, in each layout whose files are numbered.
fn numbers_are_indices() -> Outcome {
    let lists: [(&str, &[&str]); 2] = [
        (
            "pandaset",
            &["lidar/00.pkl.gz", "lidar/01.pkl.gz", "camera/front_camera/00.jpg", "camera/front_camera/01.jpg"],
        ),
        ("kitti-raw", &["velodyne_points/data/0000000000.bin", "velodyne_points/data/0000000001.bin"]),
    ];
    for (layout, lost) in lists {
        let place = tempfile::tempdir()?;
        let source = copied(layout, place.path())?;
        let below = if layout == "kitti-raw" { source.join(DRIVE) } else { source.clone() };
        lost.iter().try_for_each(|file| fs::remove_file(below.join(file)))?;
        let clip = imported(layout, &source, &[])?;
        let [frame] = clip.frames.as_slice() else {
            return Err(format!("{layout}: {} frames", clip.frames.len()).into());
        };
        close("time", &[frame.lidar.timestamp - START], &[0.2], absolute(2e-6))?;
        close("place", &[frame.lidar.world_from_lidar.translation().x], &[1002.0 + 0.2_f64.cos()], absolute(2e-6))?;
        if frame.cameras.len() != 1 || frame.boxes.as_ref().map(Vec::len) != Some(1) {
            return Err(format!("{layout}: {} images, boxes {:?}", frame.cameras.len(), frame.boxes).into());
        }
    }
    Ok(())
}

/// Adds to a folder a second camera whose calibration is missing, and says what the importer misses then.
fn add_broken_camera(layout: &str, source: &Path) -> Tried<(&'static str, &'static str)> {
    let copy = |from: &Path, to: &Path| clips::copy(from, to);
    match layout {
        "dgp" => {
            edit(&source.join("scene_0.json"), |scene| {
                let image = |datum: &&Value| datum["datum"]["image"].is_object();
                let mut datum =
                    scene["data"].as_array().and_then(|d| d.iter().find(image)).cloned().unwrap_or_default();
                datum["key"] = json!("second");
                datum["id"]["name"] = json!("CAMERA_05");
                push(&mut scene["data"], datum);
                push(&mut scene["samples"][0]["datum_keys"], json!("second"));
            })
            .map_err(|e| format!("{:?}", e.message()))?;
            Ok(("CAMERA_05", "cal.json"))
        }
        "kitti-raw" => {
            copy(&source.join(DRIVE).join("image_02"), &source.join(DRIVE).join("image_05"))?;
            Ok(("image_05", "P_rect_05"))
        }
        "av2" => {
            let cameras = source.join("sensors/cameras");
            copy(&cameras.join("ring_front_center"), &cameras.join("stereo_front_left"))?;
            Ok(("stereo_front_left", "intrinsics.feather"))
        }
        "pandaset" => {
            copy(&source.join("camera/front_camera"), &source.join("camera/left_camera"))?;
            fs::remove_file(source.join("camera/left_camera/intrinsics.json"))?;
            Ok(("left_camera", "intrinsics.json"))
        }
        _ => {
            let tables = source.join("v1.0-mini");
            let second = |name: &str, of: &dyn Fn(&Value) -> bool, change: &dyn Fn(&mut Value)| {
                edit(&tables.join(name), |rows| {
                    let mut row = rows.as_array().and_then(|r| r.iter().find(|r| of(r))).cloned().unwrap_or_default();
                    change(&mut row);
                    push(rows, row);
                })
                .map_err(|e| format!("{:?}", e.message()))
            };
            second("sensor.json", &|row| row["modality"] == "camera", &|row| {
                row["token"] = json!("second");
                row["channel"] = json!("CAM_BACK");
            })?;
            second("calibrated_sensor.json", &|row| row["camera_intrinsic"] != json!([]), &|row| {
                row["token"] = json!("second mount");
                row["sensor_token"] = json!("second");
                row["camera_intrinsic"] = json!([]);
            })?;
            let is_image = |row: &Value| row["filename"].as_str().is_some_and(|name| name.contains("CAM_FRONT"));
            second("sample_data.json", &is_image, &|row| {
                row["token"] = json!("second image");
                row["calibrated_sensor_token"] = json!("second mount");
            })?;
            Ok(("CAM_BACK", "camera_intrinsic"))
        }
    }
}

fn left_out_cameras() -> Outcome {
    for layout in ["dgp", "kitti-raw", "av2", "pandaset", "nuscenes"] {
        let place = tempfile::tempdir()?;
        let source = copied(layout, place.path())?;
        let (broken, missing) = add_broken_camera(layout, &source)?;
        let own = foreign(layout)?.camera;
        let clip = imported(layout, &source, &["--cameras", own])?;
        if clip.frames.len() != 3 || clip.frames.iter().any(|frame| frame.cameras.len() != 1) {
            return Err(format!("{layout}: {} frames, or other images", clip.frames.len()).into());
        }
        infer(&source, &["--cameras", own, "--views", "none"])?.expect_success()?;
        refused(layout, &source, &[], &[missing])?;
        refused(layout, &source, &["--cameras", broken], &[missing])?;
        refused(layout, &source, &["--cameras", "other"], &["--cameras", own, broken, "`other`"])?;
    }
    Ok(())
}

/// A folder of a camera that nobody has filled needs no calibration.
fn cameras_without_images() -> Outcome {
    let folders = [
        ("kitti-raw", format!("{DRIVE}/image_03/data")),
        ("av2", "sensors/cameras/stereo_front_left".to_owned()),
        ("pandaset", "camera/left_camera".to_owned()),
    ];
    for (layout, folder) in folders {
        let place = tempfile::tempdir()?;
        let source = copied(layout, place.path())?;
        fs::create_dir_all(source.join(folder))?;
        let clip = imported(layout, &source, &[])?;
        if clip.frames.iter().any(|frame| frame.cameras.len() != 1) {
            return Err(format!("{layout}: other images").into());
        }
    }
    Ok(())
}

/// A sweep without a pose, a lost sweep and a lost image of frames that nobody asks for.
fn left_out_frames() -> Outcome {
    let place = tempfile::tempdir()?;
    let source = copied("kitti-raw", place.path())?;
    late(&source, 2, "10.0")?;
    let no_pose = ["oxts", "expected a pose within 0.2 s"];
    refused("kitti-raw", &source, &[], &no_pose)?;
    infer(&source, &["--views", "none"])?.expect_refusal(&no_pose)?;
    let clip = imported("kitti-raw", &source, &["--frames", "0..1"])?;
    if clip.frames.len() != 2 {
        return Err("not the two frames that were asked for".into());
    }
    infer(&source, &["--frames", "0..1", "--hold-out", "1"])?.expect_success()?;
    let lost = [
        ("dgp", "rgb/CAMERA_01/2.png"),
        ("dgp", "point_cloud/LIDAR/2.npz"),
        ("nuscenes", "samples/CAM_FRONT/n__CAM_FRONT__1600000000180000.jpg"),
    ];
    for (layout, file) in lost {
        let place = tempfile::tempdir()?;
        let source = copied(layout, place.path())?;
        fs::remove_file(source.join(file))?;
        refused(layout, &source, &[], &["frames[2]"])?;
        imported(layout, &source, &["--frames", "0,1"])?;
        infer(&source, &["--frames", "0,1", "--views", "none"])?.expect_success()?;
    }
    Ok(())
}

/// Gives a sweep of the KITTI drive another moment, seconds after the first.
fn late(source: &Path, sweep: usize, seconds: &str) -> Outcome {
    let file = source.join(DRIVE).join("velodyne_points/timestamps.txt");
    let text = fs::read_to_string(&file)?;
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let minute = lines[0].rsplit_once(':').ok_or("no moment")?;
    let second: f64 = minute.1.trim().parse()?;
    lines[sweep] = format!("{}:{:09.6}", minute.0, second + seconds.parse::<f64>()?);
    Ok(fs::write(file, lines.join("\n"))?)
}

fn lost_images() -> Outcome {
    let place = tempfile::tempdir()?;
    let clip = place.path().join("clip");
    clips::copy(&clips::street(), &clip)?;
    fs::remove_file(clips::named_file(&clip, "/frames/3/cameras/0/file")?)?;
    fs::remove_file(clips::named_file(&clip, "/frames/4/lidar/file")?)?;
    let flags = ["--views", "none", "--frames", "0,1"];
    infer(&clip, &flags)?.expect_success()?;
    infer(&clip, &["--views", "none", "--frames", "1,3", "--cameras", "front_left"])?.expect_success()?;
    infer(&clip, &["--views", "none", "--frames", "1,3"])?.expect_refusal(&["frames[3].cameras[0].file"])?;
    infer(&clip, &["--views", "none", "--frames", "1,4"])?.expect_refusal(&["frames[4].lidar.file"])?;
    infer(&clip, &["--views", "none", "--frames", "1,9"])?.expect_refusal(&["--frames", "9"])
}

fn no_annotations() -> Outcome {
    let lost: [(&str, &[&str], Option<&str>); 7] = [
        ("dgp", &["bounding_box_3d"], None),
        ("dgp", &["ontology"], Some("class ")),
        ("kitti-raw", &["2020_09_13/2020_09_13_drive_0001_sync/tracklet_labels.xml"], None),
        ("av2", &["annotations.feather"], None),
        ("pandaset", &["annotations"], None),
        ("nuscenes", &["v1.0-mini/sample_annotation.json"], None),
        ("nuscenes", &["v1.0-mini/instance.json", "v1.0-mini/category.json"], Some("unknown")),
    ];
    for (layout, files, category) in lost {
        let place = tempfile::tempdir()?;
        let source = copied(layout, place.path())?;
        for file in files {
            let path = source.join(file);
            if path.is_dir() { fs::remove_dir_all(path)? } else { fs::remove_file(path)? }
        }
        let clip = imported(layout, &source, &[])?;
        let fits = clip.frames.iter().all(|frame| match (&frame.boxes, category) {
            (Some(boxes), Some(category)) => boxes.len() == 1 && boxes[0].category.starts_with(category),
            (boxes, category) => boxes.is_none() && category.is_none(),
        });
        if !fits {
            return Err(format!("{layout} without {files:?}: {:?}", clip.frames[0].boxes).into());
        }
    }
    Ok(())
}

/// Tables of annotations without one: null in the clip, no figure of moving or static pixels.
fn unknown_boxes() -> Outcome {
    let empty: [(&str, &[&str], &str); 3] = [
        ("nuscenes", &["v1.0-mini/sample_annotation.json"], "[]"),
        (
            "dgp",
            &["bounding_box_3d/LIDAR/0.json", "bounding_box_3d/LIDAR/1.json", "bounding_box_3d/LIDAR/2.json"],
            "{}",
        ),
        (
            "kitti-raw",
            &["2020_09_13/2020_09_13_drive_0001_sync/tracklet_labels.xml"],
            "<boost_serialization><tracklets><count>0</count></tracklets></boost_serialization>",
        ),
    ];
    for (layout, files, text) in empty {
        let place = tempfile::tempdir()?;
        let source = copied(layout, place.path())?;
        files.iter().try_for_each(|file| fs::write(source.join(file), text))?;
        let (finished, out) = import(layout, &source, &[])?;
        finished.expect_success()?;
        if !finished.stdout.contains("boxes unknown") || clips::description(&out)?["frames"][0].get("boxes").is_some() {
            return Err(format!("{layout}: {}", finished.stdout).into());
        }
        infer(&source, &["--hold-out", "1"])?.expect_success()?;
        let metrics: Value = serde_json::from_slice(&fs::read(place.path().join("scene/metrics.json"))?)?;
        let mean = &metrics["mean"]["held_out"];
        if !mean["psnr_static"].is_null() || !mean["psnr_dynamic"].is_null() || !mean["psnr"].is_number() {
            return Err(format!("{layout}: {mean}").into());
        }
    }
    // One frame whose boxes were not fetched.
    let place = tempfile::tempdir()?;
    let source = copied("pandaset", place.path())?;
    fs::remove_file(source.join("annotations/cuboids/01.pkl.gz"))?;
    let boxes: Vec<Option<usize>> =
        imported("pandaset", &source, &[])?.frames.iter().map(|frame| frame.boxes.as_ref().map(Vec::len)).collect();
    if boxes == [Some(1), None, Some(1)] { Ok(()) } else { Err(format!("boxes {boxes:?}").into()) }
}

/// Two seconds without measurements, a sweep in the middle of them.
fn holes() -> Outcome {
    let place = tempfile::tempdir()?;
    let source = copied("kitti-raw", place.path())?;
    late(&source, 1, "1.1")?;
    let drive = source.join(DRIVE);
    let times = drive.join("oxts/timestamps.txt");
    let text = fs::read_to_string(&times)?;
    let minute = text.lines().next().and_then(|line| line.rsplit_once(':')).ok_or("no moment")?.0;
    let at = |seconds: f64| format!("{minute}:{seconds:09.6}");
    let first: f64 = text.lines().next().and_then(|line| line.rsplit_once(':')).ok_or("no moment")?.1.trim().parse()?;
    fs::write(&times, [first, first + 0.1, first + 2.2].map(at).join("\n"))?;
    refused("kitti-raw", &source, &[], &["oxts", "poses", "expected a pose within 0.2 s", "none between"])?;
    // Beside the hole the motion goes on.
    late(&source, 1, "0.25")?;
    let clip = imported("kitti-raw", &source, &["--frames", "0,1"])?;
    let x =
        clip.frames[1].lidar.world_from_lidar.translation().x - clip.frames[0].lidar.world_from_lidar.translation().x;
    close("driven", &[x], &[2.5 + 0.25_f64.cos() - 1.0], absolute(1e-3))
}

fn two_versions() -> Outcome {
    let place = tempfile::tempdir()?;
    let source = copied("nuscenes", place.path())?;
    let other = source.join("v1.0-trainval");
    clips::copy(&source.join("v1.0-mini"), &other)?;
    edit(&other.join("scene.json"), |rows| {
        let mut second = rows[0].clone();
        second["token"] = json!("other");
        second["name"] = json!("scene-0002");
        push(rows, second);
    })?;
    let both = ["--scene", "v1.0-mini/scene-0001", "v1.0-trainval/scene-0001", "v1.0-trainval/scene-0002"];
    refused("nuscenes", &source, &[], &both)?;
    infer(&source, &[])?.expect_refusal(&[&["lgs-clip"], &both[1..]].concat())?;
    refused("nuscenes", &source, &["--scene", "scene-0009"], &["`scene-0009`", "v1.0-mini/scene-0001"])?;
    refused("nuscenes", &source, &["--scene", "v1.0-mini/scene-0002"], &["`v1.0-mini/scene-0002`"])?;
    for (scene, version) in [("scene-0001", "v1.0-mini"), ("v1.0-trainval/scene-0001", "v1.0-trainval")] {
        let clip = imported("nuscenes", &source, &["--scene", scene])?;
        if clip.frames.len() != 3 || !clip.source.contains(version) {
            return Err(format!("{scene}: {}", clip.source).into());
        }
    }
    Ok(())
}

/// `lgs-infer DIR` of a folder that lacks one thing says which.
fn reasons() -> Outcome {
    let lost: [(&str, &str, &[&str]); 6] = [
        ("dgp", "scene_0.json", &["scene_*.json", "found 0"]),
        ("kitti-raw", "2020_09_13/calib_cam_to_cam.txt", &["calib_cam_to_cam.txt"]),
        ("av2", "city_SE3_egovehicle.feather", &["city_SE3_egovehicle.feather"]),
        ("pandaset", "lidar/poses.json", &["poses.json"]),
        ("nuscenes", "v1.0-mini/sample_data.json", &["folder of tables"]),
        ("nuscenes", "v1.0-mini/ego_pose.json", &["ego_pose.json"]),
    ];
    for (layout, file, names) in lost {
        let place = tempfile::tempdir()?;
        let source = copied(layout, place.path())?;
        fs::remove_file(source.join(file))?;
        let folder = if layout == "kitti-raw" { source.join(DRIVE) } else { source };
        infer(&folder, &[])?.expect_refusal(names)?;
    }
    Ok(())
}
