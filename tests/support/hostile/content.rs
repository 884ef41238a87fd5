//! Good folders of every target, and how each is read to its end.

use std::fs;
use std::path::{Path, PathBuf};

use lgs_formats::camera::{Camera, Distortion, Intrinsics};
use lgs_formats::camera_path;
use lgs_formats::clip::{CameraRecord, Compensation, DepthKind, DepthRecord, ReturnsRecord, SensorsRecord};
use lgs_formats::clip_dir::{ClipDir, write_clip};
use lgs_formats::cloud::SplatCloud;
use lgs_formats::image::{ImageSize, check_depth, load_depth, write_depth_metres, write_depth_png};
use lgs_formats::importers::{self, Layout, Selection};
use lgs_formats::ply::{read_ply, write_ply};
use lgs_formats::pose::Pose;
use lgs_formats::returns::{write_sensors, write_times};
use lgs_formats::targets::{
    ActionTargets, ClipCounts, ClipTargets, EncodedClip, MANIFEST_FILE, Manifest, Shard, ShardRecord, TARGETS_FORMAT,
    TargetsConfig, shard_file, write_shard,
};

/// Size that images are brought to.
const SIZE: ImageSize = ImageSize { height: 8, width: 12 };
type Said = Result<(), String>;

fn said(error: impl std::fmt::Display) -> String {
    error.to_string()
}

fn copy(from: &Path, to: &Path) -> Said {
    fs::create_dir_all(to).map_err(said)?;
    for entry in fs::read_dir(from).map_err(said)? {
        let entry = entry.map_err(said)?;
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy(&entry.path(), &target)?;
        } else {
            fs::copy(entry.path(), target).map_err(said)?;
        }
    }
    Ok(())
}

/// Panics, in the way of a fuzzer, unless a reader kept its promise.
fn promise(holds: bool, what: &str) {
    assert!(holds, "{what}");
}

/// Every sweep and image of a clip, which are finite where they can be read.
fn read_all(dir: &ClipDir) -> Said {
    for (f, frame) in dir.clip().frames.iter().enumerate() {
        let sweep = dir.load_sweep(f).map_err(said)?;
        promise(sweep.points.as_flattened().iter().all(|v| v.is_finite()), "a point that is not finite");
        promise(sweep.points.len() == sweep.intensities.len(), "points without an intensity");
        let (times, origins) = (sweep.times.unwrap_or_default(), sweep.origins.unwrap_or_default());
        let finite = times.iter().chain(origins.as_flattened()).all(|v| v.is_finite());
        promise(finite, "a time or an origin that is not finite");
        promise([times.len(), origins.len()].iter().all(|len| [0, sweep.points.len()].contains(len)), "too few times");
        for c in 0..frame.cameras.len() {
            let image = dir.load_image(f, c, Some(SIZE)).map_err(said)?;
            promise(image.rgb.data.iter().all(|v| (0.0..=1.0).contains(v)), "a colour out of range");
        }
    }
    Ok(())
}

pub(super) fn fill_clip(repository: &Path, to: &Path) -> Said {
    let source = fixture(repository, Layout::Dgp)?;
    importers::write(&importers::open_as(Layout::Dgp, &source, &Selection::default()).map_err(said)?, to)
        .map_err(said)?;
    let mut clip = ClipDir::open(to).map_err(said)?.clip().clone();
    let [times, sensors] = ["lidar/0001.times", "lidar/0001.sensors"].map(PathBuf::from);
    write_times(&to.join(&times), &[-0.05, 0.0, 0.01, 0.05]).map_err(said)?;
    write_sensors(&to.join(&sensors), &[0, 1, 1, 0]).map_err(said)?;
    clip.frames[0].lidar.returns.compensation = Compensation::To(0.02);
    clip.frames[1].lidar.returns = ReturnsRecord {
        times: Some(times),
        compensation: Compensation::None,
        sensors: Some(SensorsRecord { file: sensors, lidar_from_sensor: vec![Pose::IDENTITY; 2] }),
    };
    write_clip(to, &clip).map_err(said)
}

pub(super) fn read_clip(folder: &Path) -> Said {
    read_all(&ClipDir::open(folder).map_err(said)?)
}

/// Width and height of the depth maps.
const MAP: [u32; 2] = [12, 8];

pub(super) fn fill_depth(_: &Path, to: &Path) -> Said {
    let [width, height] = MAP.map(|side| side as usize);
    let depths: Vec<f32> = (1_u8..=96).map(f32::from).collect();
    let values: Vec<u16> = (1..=96).map(|value| 600 * value).collect();
    for kind in KINDS {
        write_depth_metres(&to.join(format!("{}.npy", kind.word())), width, height, &depths).map_err(said)?;
        write_depth_png(&to.join(format!("{}.png", kind.word())), width, height, &values).map_err(said)?;
    }
    Ok(())
}

const KINDS: [DepthKind; 2] = [DepthKind::Metric, DepthKind::Relative];

/// A map that can be read has a value for each pixel, and a metric one no negative depth.
pub(super) fn read_depth(folder: &Path) -> Said {
    let camera = Camera {
        name: "c".to_owned(),
        timestamp: 0.0,
        width: MAP[0],
        height: MAP[1],
        intrinsics: Intrinsics { fx: 9.0, fy: 9.0, cx: 6.0, cy: 4.0 },
        distortion: Some(Distortion::BrownConrady([0.1, -0.02, 1e-3, 1e-3, 0.0])),
        readout: None,
        world_from_camera: Pose::IDENTITY,
    };
    let mut wrong = Ok(());
    for (kind, ending) in KINDS.into_iter().flat_map(|kind| [(kind, "npy"), (kind, "png")]) {
        let file = PathBuf::from(format!("{}.{ending}", kind.word()));
        let checked = check_depth(&folder.join(&file), &camera).map_err(said);
        let depth = Some(DepthRecord { file, kind });
        let record = CameraRecord { file: PathBuf::from("none"), mask: None, depth, camera: camera.clone() };
        match load_depth(folder, &record, Some(SIZE)).map_err(said) {
            Ok(map) => {
                let values = map.map(|map| map.inverse).unwrap_or_default();
                promise(values.len() == SIZE.width * SIZE.height, "a map of another size");
                promise(
                    kind == DepthKind::Relative || values.iter().all(|v| v.is_nan() || *v >= 0.0),
                    "a negative depth",
                );
                promise(values.iter().all(|v| !v.is_infinite()), "an infinite value");
            }
            error => wrong = error.map(drop),
        }
        wrong = wrong.and(checked);
    }
    wrong
}

pub(super) fn fill_path(_: &Path, to: &Path) -> Said {
    let text = r#"{"format": "lgs-path/1",
 "camera": {"width": 64, "height": 36, "intrinsics": {"fx": 40.0, "fy": 41.5, "cx": 32.0, "cy": 18.0}},
 "poses": [{"timestamp": 1.5e9, "world_from_camera": [[1, 0, 0, 5.0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]},
           {"timestamp": 1500000000.5, "world_from_camera": [[0, -1, 0, 6.5], [1, 0, 0, 2e3], [0, 0, 1, 0], [0, 0, 0, 1]]}]}"#;
    fs::write(to.join("path.json"), text).map_err(said)
}

/// A path that can be read has places that are finite.
pub(super) fn read_path(folder: &Path) -> Said {
    let path = camera_path::read_path(&folder.join("path.json")).map_err(said)?;
    promise(!path.keys.is_empty(), "a path of no place");
    for key in &path.keys {
        let rows = key.world_from_camera.rows();
        promise(
            key.timestamp.is_finite() && rows.as_flattened().iter().all(|v| v.is_finite()),
            "a place that is not finite",
        );
    }
    Ok(())
}

pub(super) fn fill_ply(_: &Path, to: &Path) -> Said {
    let n = 3;
    let cloud = SplatCloud {
        means: vec![[1.0, 2.0, 3.0]; n],
        log_scales: vec![[-1.0; 3]; n],
        quats: vec![[1.0, 0.0, 0.0, 0.0]; n],
        logit_opacities: vec![0.5; n],
        sh_dc: vec![[0.25; 3]; n],
        velocities: vec![[0.0; 3]; n],
        times: vec![0.1; n],
        frames: Some(vec![0, 1, 1]),
        extra: vec![("p_add".to_owned(), vec![0.5; n])],
    };
    write_ply(&to.join("scene.ply"), &cloud).map_err(said)
}

/// What can be read can be written and is then the same.
pub(super) fn read_scene(folder: &Path) -> Said {
    let cloud = read_ply(&folder.join("scene.ply")).map_err(said)?;
    let numbers =
        [cloud.means.as_flattened(), cloud.log_scales.as_flattened(), cloud.quats.as_flattened(), &cloud.times];
    promise(numbers.concat().iter().all(|v| v.is_finite()), "a value that is not finite");
    let again = folder.join("scene.ply");
    if write_ply(&again, &cloud).is_ok() {
        promise(read_ply(&again).map_err(said)? == cloud, "another cloud than was written");
    }
    Ok(())
}

pub(super) fn fill_targets(_: &Path, to: &Path) -> Said {
    let action = ActionTargets { y: vec![0.25, 0.5], delta: vec![1.0, 0.0], mask: vec![true, false] };
    let targets = ClipTargets {
        index: vec![0, 2],
        samples: vec![1, 2],
        prune: action.clone(),
        add: action,
        moments: [[0.0, 1.0]; 2],
        gaussians: vec![[0.5; 14]; 3],
        times: vec![0.0; 3],
        frames: Some(vec![0, 0, 1]),
        velocities: vec![[0.0; 3]; 3],
        features: None,
    };
    let config =
        TargetsConfig { rounds: 1, rho: 0.5, neighbours: 2, image_size: Some([8, 12]), ..TargetsConfig::default() };
    let encoded = EncodedClip::new(to, &targets).map_err(said)?;
    let file = shard_file(0);
    write_shard(&to.join(&file), &config, &[("a", encoded.dims)], |_| Ok(encoded.clone())).map_err(said)?;
    let clip = ClipCounts { clip: "a".to_owned(), primitives: 3, sampled: 2, valid_prune: 1, valid_add: 1 };
    let shard = ShardRecord::of(to, file, vec![clip]).map_err(said)?;
    let manifest = Manifest {
        format: TARGETS_FORMAT.to_owned(),
        part: None,
        config,
        clips: vec!["a".to_owned()],
        shards: vec![shard],
        failed: Vec::new(),
    };
    manifest.write(&to.join(MANIFEST_FILE)).map_err(said)
}

pub(super) fn read_targets(folder: &Path) -> Said {
    let manifest = Manifest::read(&folder.join(MANIFEST_FILE)).map_err(said);
    let shard = Shard::read(&folder.join(shard_file(0))).map_err(said);
    if let Ok(shard) = &shard {
        for name in shard.names() {
            let clip = shard.clip(name).map_err(said)?;
            promise(clip.gaussians.as_flattened().iter().all(|v| v.is_finite()), "a value that is not finite");
            promise(clip.prune.y.iter().chain(&clip.add.y).all(|y| (0.0..=1.0).contains(y)), "a target out of range");
        }
    }
    manifest?.verify(folder).map_err(said)?;
    shard.map(drop)
}

fn fixture(repository: &Path, layout: Layout) -> Result<std::path::PathBuf, String> {
    let name = match layout {
        Layout::Dgp => "dgp",
        Layout::KittiRaw => "kitti",
        Layout::Argoverse2 => "av2",
        Layout::PandaSet => "pandaset",
        Layout::NuScenes => "nuscenes",
        Layout::Waymo => "waymo",
    };
    in_fixtures(repository, name)
}

fn in_fixtures(repository: &Path, name: &str) -> Result<std::path::PathBuf, String> {
    let path = repository.join("tests/fixtures").join(name);
    if path.is_dir() { Ok(path) } else { Err(format!("{}: missing", path.display())) }
}

fn read_foreign(layout: Layout, folder: &Path) -> Said {
    read_all(&importers::open_as(layout, folder, &Selection::default()).map_err(said)?)
}

macro_rules! foreign {
    ($fill:ident, $read:ident, $layout:expr) => {
        pub(super) fn $fill(repository: &Path, to: &Path) -> Said {
            copy(&fixture(repository, $layout)?, to)
        }

        pub(super) fn $read(folder: &Path) -> Said {
            read_foreign($layout, folder)
        }
    };
}

foreign!(fill_dgp, read_dgp, Layout::Dgp);
foreign!(fill_av2, read_av2, Layout::Argoverse2);
foreign!(fill_pandaset, read_pandaset, Layout::PandaSet);
foreign!(fill_nuscenes, read_nuscenes, Layout::NuScenes);
foreign!(fill_kitti, read_kitti, Layout::KittiRaw);
foreign!(fill_waymo, read_waymo, Layout::Waymo);

pub(super) fn fill_waymo_v2(repository: &Path, to: &Path) -> Said {
    copy(&in_fixtures(repository, "waymo_v2")?, to)
}
