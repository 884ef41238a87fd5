use std::path::PathBuf;

use super::*;
use crate::{
    camera::{Distortion, Intrinsics},
    clip::DepthRecord,
    pose::Pose,
};

const WIDTH: usize = 6;
const HEIGHT: usize = 4;

fn record(file: &str, kind: DepthKind) -> CameraRecord {
    let camera = Camera {
        name: "c".to_owned(),
        timestamp: 0.0,
        width: 6,
        height: 4,
        intrinsics: Intrinsics { fx: 5.0, fy: 5.0, cx: 3.0, cy: 2.0 },
        distortion: None,
        readout: None,
        world_from_camera: Pose::IDENTITY,
    };
    let depth = Some(DepthRecord { file: PathBuf::from(file), kind });
    CameraRecord { file: PathBuf::from("none.png"), mask: None, depth, camera }
}

/// Left half near, right half far.
fn step() -> Vec<f32> {
    (0..WIDTH * HEIGHT).map(|i| if i % WIDTH < 3 { 2.0 } else { 50.0 }).collect()
}

#[test]
fn a_png_holds_millimetres_or_anything_that_is_larger_nearer() {
    let place = tempfile::tempdir().unwrap();
    let mut values: Vec<u16> = vec![2000; WIDTH * HEIGHT];
    (values[0], values[1], values[2]) = (0, u16::MAX, 1);
    write_depth_png(&place.path().join("d.png"), WIDTH, HEIGHT, &values).unwrap();
    let metric = load_depth(place.path(), &record("d.png", DepthKind::Metric), None).unwrap().unwrap();
    assert!(metric.inverse[0].is_nan());
    assert_eq!(metric.inverse[1..4], [0.0, 1000.0, 0.5]);
    let relative = load_depth(place.path(), &record("d.png", DepthKind::Relative), None).unwrap().unwrap();
    assert_eq!(relative.inverse[..4], [0.0, 65535.0, 1.0, 2000.0]);
    let without = CameraRecord { depth: None, ..record("", DepthKind::Metric) };
    assert_eq!(load_depth(place.path(), &without, None).unwrap(), None);
}

#[test]
fn an_array_holds_metres() {
    let place = tempfile::tempdir().unwrap();
    let mut depths = step();
    (depths[0], depths[1], depths[2]) = (f32::NAN, f32::INFINITY, 0.0);
    let path = place.path().join("d.npy");
    write_depth_metres(&path, WIDTH, HEIGHT, &depths).unwrap();
    assert_eq!(std::fs::read(&path).unwrap().len() % 32, 0, "the header is padded");
    let map = load_depth(place.path(), &record("d.npy", DepthKind::Metric), None).unwrap().unwrap();
    assert!(map.inverse[0].is_nan() && map.inverse[2].is_nan());
    assert_eq!((map.inverse[1], map.inverse[3], map.inverse[6]), (0.0, 0.02, 0.5));
    check_depth(&path, &record("d.npy", DepthKind::Metric).camera).unwrap();
}

#[test]
fn edges_stay_edges_at_every_size_and_through_a_lens() {
    let place = tempfile::tempdir().unwrap();
    write_depth_metres(&place.path().join("d.npy"), WIDTH, HEIGHT, &step()).unwrap();
    let mut record = record("d.npy", DepthKind::Metric);
    for (height, width) in [(2, 2), (3, 5), (4, 6), (9, 13)] {
        let map = load_depth(place.path(), &record, Some(ImageSize { height, width })).unwrap().unwrap();
        assert_eq!(map.inverse.len(), width * height);
        for (i, &inverse) in map.inverse.iter().enumerate() {
            let left = (i % width) as f32 + 0.5 < 0.5 * width as f32;
            assert_eq!(inverse, if left { 0.5 } else { 0.02 }, "pixel {i} of {width} x {height}");
        }
    }
    record.camera.distortion = Some(Distortion::BrownConrady([1.0, 0.0, 0.0, 0.0, 0.0]));
    let map = load_depth(place.path(), &record, None).unwrap().unwrap();
    assert!(map.inverse[0].is_nan(), "the corner lies outside the file");
    assert!(map.inverse.iter().all(|&w| w.is_nan() || w == 0.5 || w == 0.02), "{:?}", map.inverse);
}

#[test]
fn what_is_no_depth_map_is_refused_by_name() {
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("d");
    let refused = |bytes: &[u8], kind: DepthKind, names: &str| {
        std::fs::write(&path, bytes).unwrap();
        let message = load_depth(place.path(), &record("d", kind), None).unwrap_err().to_string();
        assert!(message.contains(names) && !message.contains('\n'), "{message}");
    };
    let array = |depths: &[f32]| {
        write_depth_metres(&path, WIDTH, HEIGHT, depths).unwrap();
        std::fs::read(&path).unwrap()
    };
    for bad in [-1.0, 1e-4, f32::NEG_INFINITY] {
        let mut depths = step();
        depths[8] = bad;
        refused(&array(&depths), DepthKind::Metric, "depth map[1][2]: expected metres from 0.001 to infinity");
    }
    let mut depths = step();
    depths[23] = f32::INFINITY;
    refused(&array(&depths), DepthKind::Relative, "depth map[3][5]: expected finite values");
    let good = array(&step());
    for end in 0..good.len() {
        std::fs::write(&path, &good[..end]).unwrap();
        let record = record("d", DepthKind::Metric);
        assert!(
            load_depth(place.path(), &record, None).is_err() && check_depth(&path, &record.camera).is_err(),
            "{end}"
        );
    }
    refused(&[good.as_slice(), &[0]].concat(), DepthKind::Metric, "expected 96 bytes of values");
    let other = |from: &str, to: &str, bytes: usize| [changed_header(from, to), vec![0; bytes]].concat();
    let shape = "expected shape [4, 6] as declared, found [6, 4]";
    refused(&other("(4, 6,)", "(6, 4,)", 96), DepthKind::Metric, shape);
    refused(&other("<f4", "<i8", 192), DepthKind::Metric, "an array of floating-point numbers (`<f4`, `<f8` or `<f2`)");
    std::fs::write(&path, other("<f4", "<f8", 192)).unwrap();
    assert!(load_depth(place.path(), &record("d", DepthKind::Metric), None).is_ok());
    write_depth_png(&path, WIDTH - 1, HEIGHT, &[1; 20]).unwrap();
    let small = std::fs::read(&path).unwrap();
    refused(&small, DepthKind::Metric, "image size: expected width 6 and height 4");
    super::super::write_grey(&path, WIDTH, HEIGHT, &[0.5; WIDTH * HEIGHT]).unwrap();
    refused(&std::fs::read(&path).unwrap(), DepthKind::Metric, "expected L16 Png (16-bit grey), found L8 Png");
    refused(b"depth", DepthKind::Metric, "image format: expected PNG or JPEG");
}

/// The header of a map with one part replaced by another of the same length.
fn changed_header(from: &str, to: &str) -> Vec<u8> {
    let mut header = crate::numpy::header_of(&[HEIGHT, WIDTH]);
    let at = header.windows(from.len()).position(|part| part == from.as_bytes()).unwrap();
    header[at..at + from.len()].copy_from_slice(to.as_bytes());
    header
}
