//! Foreign folders that are wrong in one way each: one line that names file and field, exit code 2, nothing written.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use lgs_tests::layouts::{FOREIGN, Foreign, foreign};
use lgs_tests::process::{Finished, binary, run};
use lgs_tests::sources::all_files;
use lgs_tests::{Outcome, case, clips};
use libtest_mimic::Trial;

/// One way to spoil a folder.
struct Spoilt {
    layout: &'static str,
    name: &'static str,
    /// The file, relative to the folder, and what becomes of it.
    file: &'static str,
    change: Change,
    /// What the message must hold.
    names: &'static [&'static str],
}

enum Change {
    Remove,
    /// Keep the first half.
    Half,
    /// Put the second text where the first one is.
    Text(&'static str, &'static str),
    Bytes(&'static [u8]),
    /// Put another file of the folder in its place.
    Other(&'static str),
}

const SWEEP: &str = "sensors/lidar/1600000000000000000.feather";
const CUBOIDS: &str = "annotations/cuboids/00.pkl.gz";

use Change::{Bytes, Half, Other, Remove, Text};

#[rustfmt::skip]
const SPOILT: [Spoilt; 34] = [
    Spoilt { layout: "dgp", name: "half_a_scene", file: "scene_0.json", change: Half, names: &["scene_0.json", "line"] },
    Spoilt { layout: "dgp", name: "no_scene", file: "scene_0.json", change: Remove, names: &["scene", "expected", "found 0"] },
    Spoilt { layout: "dgp", name: "another_format", file: "scene_0.json", change: Bytes(b"{\"version\": 9}"), names: &["scene_0.json", "missing field `data`"] },
    Spoilt { layout: "dgp", name: "another_key", file: "scene_0.json", change: Text("\"l1\",\n\"c1\"", "\"lost\""), names: &["scene_0.json", "samples[1].datum_keys", "lost"] },
    Spoilt { layout: "dgp", name: "no_moment", file: "scene_0.json", change: Text("2020-09-13T", "13.9.2020 "), names: &["scene_0.json", "timestamp", "13.9.2020"] },
    Spoilt { layout: "dgp", name: "a_path_out_of_the_folder", file: "scene_0.json", change: Text("rgb/CAMERA_01/0.png", "../../etc/0.png"), names: &["scene_0.json", "CAMERA_01", "..", "expected"] },
    Spoilt { layout: "dgp", name: "a_fisheye", file: "calibration/cal.json", change: Text("\"skew\": 0.0\n}\n]", "\"skew\": 0.0, \"fisheye\": 3\n}\n]"), names: &["cal.json", "intrinsics[1].fisheye", "expected 0", "found 3"] },
    Spoilt { layout: "dgp", name: "no_such_camera", file: "calibration/cal.json", change: Text("CAMERA_01", "CAMERA_99"), names: &["cal.json", "CAMERA_01", "CAMERA_99"] },
    Spoilt { layout: "dgp", name: "half_a_sweep", file: "point_cloud/LIDAR/1.npz", change: Half, names: &["1.npz", "archive"] },
    Spoilt { layout: "dgp", name: "fields_that_the_sweep_has_not", file: "scene_0.json", change: Text("\"INTENSITY\"", "\"INTENSITY\", \"RING\""), names: &["0.npz", "data", "RING", "shape [4, 4]"] },
    Spoilt { layout: "dgp", name: "half_an_image", file: "rgb/CAMERA_01/2.png", change: Half, names: &["2.png", "image"] },
    Spoilt { layout: "dgp", name: "no_image", file: "rgb/CAMERA_01/2.png", change: Remove, names: &["frames[2].cameras[0].file", "2.png"] },
    Spoilt { layout: "kitti-raw", name: "no_calibration_of_the_camera", file: "2020_09_13/calib_cam_to_cam.txt", change: Text("P_rect_02", "P_rect_03"), names: &["calib_cam_to_cam.txt", "P_rect_02", "12 numbers"] },
    Spoilt { layout: "kitti-raw", name: "nan_in_a_calibration", file: "2020_09_13/calib_velo_to_cam.txt", change: Text("T: ", "T: nan "), names: &["calib_velo_to_cam.txt", "T", "3 numbers", "nan"] },
    Spoilt { layout: "kitti-raw", name: "half_a_sweep", file: "2020_09_13/2020_09_13_drive_0001_sync/velodyne_points/data/0000000001.bin", change: Bytes(&[0; 24]), names: &["0000000001.bin", "file size", "8 too many"] },
    Spoilt { layout: "kitti-raw", name: "fewer_moments", file: "2020_09_13/2020_09_13_drive_0001_sync/image_02/timestamps.txt", change: Bytes(b""), names: &["timestamps.txt", "line 1", "expected a moment"] },
    Spoilt { layout: "kitti-raw", name: "measurements_of_another_kind", file: "2020_09_13/2020_09_13_drive_0001_sync/oxts/data/0000000001.txt", change: Bytes(b"1 2 3"), names: &["0000000001.txt", "30 numbers", "1 2 3"] },
    Spoilt { layout: "kitti-raw", name: "half_the_tracklets", file: "2020_09_13/2020_09_13_drive_0001_sync/tracklet_labels.xml", change: Half, names: &["tracklet_labels.xml", "document"] },
    Spoilt { layout: "kitti-raw", name: "an_endless_box", file: "2020_09_13/2020_09_13_drive_0001_sync/tracklet_labels.xml", change: Text("<h>1.6</h>", "<h>inf</h>"), names: &["tracklet_labels.xml", "tracklet 0: h", "inf"] },
    Spoilt { layout: "av2", name: "half_the_poses", file: "city_SE3_egovehicle.feather", change: Half, names: &["city_SE3_egovehicle.feather", "footer", "ARROW1"] },
    Spoilt { layout: "av2", name: "feather_version_1", file: SWEEP, change: Bytes(b"FEA1\0\0\0\0\0\0\0\0\0\0\0\0FEA1"), names: &["1600000000000000000.feather", "feather version 1"] },
    Spoilt { layout: "av2", name: "another_table", file: "calibration/egovehicle_SE3_sensor.feather", change: Other("calibration/intrinsics.feather"), names: &["egovehicle_SE3_sensor.feather", "columns", "`qw`", "fx_px"] },
    Spoilt { layout: "av2", name: "no_sweep_but_poses", file: SWEEP, change: Other("city_SE3_egovehicle.feather"), names: &["1600000000000000000.feather", "columns", "`x`"] },
    Spoilt { layout: "av2", name: "half_an_image", file: "sensors/cameras/ring_front_center/1599999999980000000.png", change: Half, names: &["1599999999980000000.png", "image"] },
    Spoilt { layout: "pandaset", name: "half_a_sweep", file: "lidar/01.pkl.gz", change: Half, names: &["01.pkl.gz", "gzip", "truncated"] },
    Spoilt { layout: "pandaset", name: "a_call_to_the_system", file: CUBOIDS, change: Bytes(b"\x80\x02cos\nsystem\nX\x02\x00\x00\x00id\x85R."), names: &["00.pkl.gz", "pickle", "`os system`"] },
    Spoilt { layout: "pandaset", name: "another_frame", file: CUBOIDS, change: Other("lidar/00.pkl.gz"), names: &["00.pkl.gz", "columns", "position.x"] },
    Spoilt { layout: "pandaset", name: "fewer_poses", file: "lidar/poses.json", change: Bytes(b"[]"), names: &["poses.json", "entries", "3 files", "found 0"] },
    Spoilt { layout: "pandaset", name: "no_rotation", file: "camera/front_camera/poses.json", change: Text("\"w\": ", "\"w\": 7"), names: &["camera/front_camera/poses.json", "[0]", "unit quaternion"] },
    Spoilt { layout: "nuscenes", name: "half_a_table", file: "v1.0-mini/sample_data.json", change: Half, names: &["sample_data.json", "row 3"] },
    Spoilt { layout: "nuscenes", name: "a_token_of_nothing", file: "v1.0-mini/calibrated_sensor.json", change: Text("\"mCAM_FRONT\"", "\"lost\""), names: &["sample_data.json", "calibrated_sensor_token", "mCAM_FRONT"] },
    Spoilt { layout: "nuscenes", name: "another_schema", file: "v1.0-mini/ego_pose.json", change: Text("\"rotation\"", "\"heading\""), names: &["ego_pose.json", "row 0", "missing field `rotation`"] },
    Spoilt { layout: "nuscenes", name: "half_a_sweep", file: "samples/LIDAR_TOP/n__LIDAR_TOP__1600000000000000.pcd.bin", change: Bytes(&[0; 30]), names: &["1600000000000000.pcd.bin", "20 bytes", "truncated"] },
    Spoilt { layout: "nuscenes", name: "several_scenes", file: "v1.0-mini/scene.json", change: Text("[", "[{\"token\": \"o\", \"name\": \"scene-0002\"},"), names: &["scene.json", "--scene", "scene-0002", "scene-0001"] },
];

pub(crate) fn cases() -> Vec<Trial> {
    let name = |layout: &str, what: &str| format!("importers::hostile::{}_{what}", layout.replace('-', "_"));
    let mut cases: Vec<Trial> =
        SPOILT.iter().map(|spoilt| case(name(spoilt.layout, spoilt.name), || refuses(spoilt))).collect();
    let damaged = |foreign: Foreign| case(name(foreign.folder, "any_file_damaged"), move || never_panics(foreign));
    cases.extend(FOREIGN.into_iter().map(damaged));
    cases.push(case("importers::hostile::another_layout", another_layout));
    cases.push(case("importers::hostile::what_is_there_is_kept", what_is_there_is_kept));
    cases
}

fn import(layout: &str, source: &Path, out: &Path) -> Result<Finished, String> {
    let arguments: [&OsStr; 5] =
        ["import".as_ref(), layout.as_ref(), source.as_os_str(), "--out".as_ref(), out.as_os_str()];
    run(&binary("lgs-clip")?, &arguments, out.parent().unwrap_or(out))
}

/// Fails unless the folder holds nothing but the copied `source`.
fn nothing_written(place: &Path) -> Outcome {
    let names: Vec<_> = fs::read_dir(place)?.flatten().map(|entry| entry.file_name()).collect();
    if names == ["source"] { Ok(()) } else { Err(format!("the refused import left {names:?}").into()) }
}

fn refuses(spoilt: &Spoilt) -> Outcome {
    let place = tempfile::tempdir()?;
    let source = place.path().join("source");
    clips::copy(&foreign(spoilt.layout)?.path(), &source)?;
    let file = source.join(spoilt.file);
    match spoilt.change {
        Remove => fs::remove_file(&file)?,
        Half => {
            let bytes = fs::read(&file)?;
            fs::write(&file, &bytes[..bytes.len() / 2])?;
        }
        Text(old, new) => {
            let text = fs::read_to_string(&file)?;
            if !text.contains(old) {
                return Err(format!("{} holds no {old:?}", spoilt.file).into());
            }
            fs::write(&file, text.replacen(old, new, 1))?;
        }
        Bytes(bytes) => fs::write(&file, bytes)?,
        Other(other) => drop(fs::copy(source.join(other), &file)?),
    }
    import(spoilt.layout, &source, &place.path().join("out"))?.expect_refusal(spoilt.names)?;
    nothing_written(place.path())
}

/// Each file of a folder in turn emptied, halved and filled with other bytes: done or refused, never anything else.
fn never_panics(foreign: Foreign) -> Outcome {
    let place = tempfile::tempdir()?;
    let source = place.path().join("source");
    clips::copy(&foreign.path(), &source)?;
    let files: Vec<PathBuf> = all_files(&source)?;
    for file in files {
        let path = source.join(&file);
        let good = fs::read(&path)?;
        let noise: Vec<u8> =
            good.iter().enumerate().map(|(i, byte)| if i % 7 == 3 { byte ^ 0x5a } else { *byte }).collect();
        for bad in [&[], &good[..good.len() / 2], noise.as_slice()] {
            fs::write(&path, bad)?;
            let out = place.path().join("out");
            let finished = import(foreign.layout, &source, &out)?;
            match finished.code {
                Some(0) => fs::remove_dir_all(&out)?,
                _ => finished
                    .expect_refusal(&[])
                    .map_err(|e| format!("{} of {} bytes: {:?}", file.display(), bad.len(), e.message()))?,
            }
            nothing_written(place.path())?;
        }
        fs::write(&path, good)?;
    }
    Ok(())
}

/// Each folder as another layout, and a folder of none.
fn another_layout() -> Outcome {
    let place = tempfile::tempdir()?;
    for own in FOREIGN {
        for other in FOREIGN.into_iter().filter(|other| other.layout != own.layout) {
            let source = place.path().join("source");
            clips::copy(&own.path(), &source)?;
            import(other.layout, &source, &place.path().join("out"))?.expect_refusal(&["source"])?;
            nothing_written(place.path())?;
            fs::remove_dir_all(&source)?;
        }
    }
    let nothing = place.path().join("source/some");
    fs::create_dir_all(&nothing)?;
    let arguments: [&OsStr; 2] = ["inspect".as_ref(), nothing.as_os_str()];
    let finished = run(&binary("lgs-clip")?, &arguments, place.path())?;
    finished.expect_refusal(&["layout", "clip.json", "dgp, kitti-raw, av2, pandaset, nuscenes, waymo"])
}

fn what_is_there_is_kept() -> Outcome {
    let place = tempfile::tempdir()?;
    let out = place.path().join("out");
    fs::create_dir(&out)?;
    fs::write(out.join("mine"), "mine")?;
    import("dgp", &foreign("dgp")?.path(), &out)?.expect_refusal(&["out", "--out", "empty folder"])?;
    if fs::read_dir(&out)?.count() != 1 || fs::read_to_string(out.join("mine"))? != "mine" {
        return Err("the refused import changed the folder".into());
    }
    fs::remove_file(out.join("mine"))?;
    import("dgp", &foreign("dgp")?.path(), &out)?.expect_success()?;
    if out.join("clip.json").is_file() { Ok(()) } else { Err("no clip in the empty folder".into()) }
}
