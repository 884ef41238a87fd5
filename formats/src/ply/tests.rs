//! Round trips, files of other programs, and files that are damaged.

use std::path::Path;

use proptest::prelude::*;

use super::*;
use crate::cloud::SplatCloud;

fn cloud(count: usize) -> SplatCloud {
    let value = |i: usize, k: usize| (i * 31 + k) as f32 * 0.37 - 4.0;
    let triple = |k: usize| (0..count).map(|i| [value(i, k), value(i, k + 1), value(i, k + 2)]).collect::<Vec<_>>();
    SplatCloud {
        means: triple(0),
        log_scales: triple(3),
        quats: (0..count).map(|i| [value(i, 6), value(i, 7), value(i, 8), value(i, 9)]).collect(),
        logit_opacities: (0..count).map(|i| value(i, 10)).collect(),
        sh_dc: triple(11),
        velocities: triple(14),
        times: (0..count).map(|i| value(i, 17)).collect(),
        frames: None,
        extra: vec![("score".to_owned(), (0..count).map(|i| value(i, 18)).collect())],
    }
}

fn written(cloud: &SplatCloud) -> Vec<u8> {
    write::to_bytes(Path::new("scene.ply"), cloud).unwrap()
}

fn read(bytes: &[u8]) -> std::result::Result<SplatCloud, String> {
    read::from_bytes(Path::new("scene.ply"), bytes).map_err(|e| e.to_string())
}

/// A file with these header lines (after the first two) and these bytes.
fn file(lines: &[&str], body: &[u8]) -> Vec<u8> {
    let mut bytes = b"ply\nformat binary_little_endian 1.0\n".to_vec();
    lines.iter().for_each(|line| bytes.extend([line.as_bytes(), b"\n"].concat()));
    [bytes.as_slice(), body].concat()
}

/// Header lines of the required properties, all float.
fn required(count: usize) -> Vec<String> {
    let names = POSITION.into_iter().chain(COLOUR).chain([OPACITY]).chain(SCALE).chain(ROTATION);
    let properties = names.map(|name| format!("property float {name}"));
    [format!("element vertex {count}")].into_iter().chain(properties).collect()
}

#[test]
fn the_layout_is_the_documented_one() {
    let bytes = written(&cloud(2));
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = std::str::from_utf8(&bytes[..end]).unwrap();
    let names: Vec<&str> = header.lines().filter_map(|line| line.strip_prefix("property float ")).collect();
    let want =
        "x y z nx ny nz f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3 vx vy vz t score";
    assert_eq!(names.join(" "), want);
    assert!(header.starts_with("ply\nformat binary_little_endian 1.0\nelement vertex 2\nproperty float x\n"));
    assert_eq!(bytes.len(), end + 2 * 22 * 4);
    let value = |row: usize, column: usize| {
        let at = end + (row * 22 + column) * 4;
        f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
    };
    let cloud = cloud(2);
    assert_eq!(
        [value(1, 0), value(1, 3), value(1, 6), value(1, 9)],
        [cloud.means[1][0], 0.0, cloud.sh_dc[1][0], cloud.logit_opacities[1]]
    );
    assert_eq!([value(0, 10), value(0, 13)], [cloud.log_scales[0][0], cloud.quats[0][0]]);
    assert_eq!(
        [value(1, 17), value(1, 20), value(1, 21)],
        [cloud.velocities[1][0], cloud.times[1], cloud.extra[0].1[1]]
    );
}

#[test]
fn a_file_on_disk_holds_the_same() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("scene.ply");
    write_ply(&path, &cloud(3)).unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), written(&cloud(3)));
    assert_eq!(read_ply(&path).unwrap(), cloud(3));
}

#[test]
fn frames_stand_behind_the_time_and_are_whole() {
    let cloud = SplatCloud { frames: Some(vec![7, 0]), ..cloud(2) };
    let bytes = written(&cloud);
    assert!(bytes.windows(46).any(|w| w == b"property float t\nproperty float frame\nproperty"));
    assert_eq!(read(&bytes).unwrap(), cloud);
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    for (found, text) in [(0.5_f32, "0.5"), (-1.0, "-1"), (16_777_218.0, "16777218")] {
        let mut spoilt = bytes.clone();
        spoilt[end + (23 + 21) * 4..][..4].copy_from_slice(&found.to_le_bytes());
        let want = format!("scene.ply: vertex 1 frame: expected a whole number from 0 to 16777216, found {text}");
        assert_eq!(read(&spoilt).unwrap_err(), want);
    }
    let far = SplatCloud { frames: Some(vec![7, 1 << 25]), ..cloud };
    let message = write::to_bytes(Path::new("scene.ply"), &far).unwrap_err().to_string();
    assert_eq!(message, "scene.ply: vertex 1 frame: expected a whole number from 0 to 16777216, found 33554432");
}

#[test]
fn no_splats_are_a_legal_scene() {
    assert!(read(&written(&SplatCloud::default())).unwrap().is_empty());
    assert_eq!(read(&written(&cloud(3))).unwrap().len(), 3);
}

proptest! {
    #[test]
    fn what_is_written_is_read_back_to_the_same_bits(
        rows in prop::collection::vec(prop::array::uniform19(prop::num::f32::NORMAL | prop::num::f32::SUBNORMAL | prop::num::f32::ZERO), 0..20),
    ) {
        let three = |k: usize| rows.iter().map(|r| [r[k], r[k + 1], r[k + 2]]).collect::<Vec<_>>();
        let one = |k: usize| rows.iter().map(|r| r[k]).collect::<Vec<_>>();
        let cloud = SplatCloud {
            means: three(0),
            log_scales: three(3),
            quats: rows.iter().map(|r| [r[6], r[7], r[8], r[9]]).collect(),
            logit_opacities: one(10),
            sh_dc: three(11),
            velocities: three(14),
            times: one(17),
            frames: Some((0..).take(rows.len()).collect()),
            extra: vec![("p_add".to_owned(), one(18)), ("background".to_owned(), one(0))],
        };
        let bytes = written(&cloud);
        let back = read(&bytes).unwrap();
        prop_assert_eq!(&back, &cloud);
        prop_assert_eq!(written(&back), bytes); // tells -0 from 0, which `==` does not
    }

    #[test]
    fn damaged_bytes_never_panic(place in any::<prop::sample::Index>(), byte: u8, end in any::<prop::sample::Index>()) {
        let mut bytes = written(&cloud(3));
        let place = place.index(bytes.len());
        bytes[place] = byte;
        bytes.truncate(end.index(bytes.len()) + 1);
        if let Err(message) = read(&bytes) {
            prop_assert!(message.starts_with("scene.ply: ") && !message.contains('\n'), "{}", message);
        }
    }
}

#[test]
fn properties_are_found_by_name_in_any_order_and_type() {
    let mut lines = required(1);
    lines[1..].reverse(); // rot_3 first, x last
    lines.insert(1, "property uchar red".to_owned());
    lines.insert(2, "property float f_rest_0".to_owned());
    lines.insert(1, "comment made elsewhere".to_owned());
    let last = lines.len() - 1;
    lines[last] = "property double x".to_owned();
    lines.extend(
        ["property short s", "element face 0", "property list uchar int vertex_indices", "end_header"]
            .map(str::to_owned),
    );
    let lines: Vec<&str> = lines.iter().map(String::as_str).collect();
    let mut body = vec![200_u8];
    body.extend(f32::NAN.to_le_bytes()); // f_rest_0, which is not read
    (0..13).for_each(|k| body.extend((k as f32).to_le_bytes()));
    body.extend(0.1_f64.to_le_bytes());
    body.extend((-3_i16).to_le_bytes());
    let cloud = read(&file(&lines, &body)).unwrap();
    assert_eq!(cloud.means, [[0.1, 12.0, 11.0]]);
    assert_eq!(cloud.sh_dc, [[10.0, 9.0, 8.0]]);
    assert_eq!(cloud.logit_opacities, [7.0]);
    assert_eq!(cloud.log_scales, [[6.0, 5.0, 4.0]]);
    assert_eq!(cloud.quats, [[3.0, 2.0, 1.0, 0.0]]);
    assert_eq!((cloud.velocities, cloud.times), (vec![[0.0; 3]], vec![0.0]));
    assert_eq!(cloud.extra, [("red".to_owned(), vec![200.0]), ("s".to_owned(), vec![-3.0])]);
}

#[test]
fn malformed_headers_are_named_by_their_line() {
    let good = required(0);
    let good: Vec<&str> = good.iter().map(String::as_str).chain(["end_header"]).collect();
    assert!(read(&file(&good, &[])).is_ok());
    let cases: [(&[&str], &str); 11] = [
        (&["end_header"], "header line 3: expected an element `vertex` before"),
        (&["property float x"], "header line 3: expected an element, a property of the element `vertex`"),
        (&["element vertex -1"], "header line 3: expected a number of entries, found `element vertex -1`"),
        (&["element vertex 99999999999999999999999"], "header line 3: expected a number of entries"),
        (&["element vertex 1", "element vertex 1"], "header line 4: expected one element `vertex`"),
        (&["element face 1"], "header line 3: expected one element `vertex` and no other with entries"),
        (
            &["element vertex 1", "property float x", "property int x"],
            "header line 5: expected a property that occurs once",
        ),
        (&["element vertex 1", "property half x"], "header line 4: expected a scalar type"),
        (&["element vertex 1", "property list uchar int x"], "header line 4: expected a scalar property"),
        (&["element vertex 1", "nonsense"], "header line 4: expected an element"),
        (&["element vertex 0", "property float x", "end_header"], "header: expected a property `y`, found `x`"),
    ];
    for (lines, expected) in cases {
        let message = read(&file(lines, &[])).unwrap_err();
        assert!(message.contains(expected), "{message}\nwant {expected}");
    }
    let text = read(b"ply\nformat ascii 1.0\nelement vertex 0\nend_header\n").unwrap_err();
    assert!(text.ends_with("header line 2: expected `format binary_little_endian 1.0` (the only kind that is read), found `format ascii 1.0`"), "{text}");
    assert!(read(b"").unwrap_err().contains("header line 1: expected `ply`, found an empty file"));
    assert!(read(b"\x1f\x8b\x08\x00").unwrap_err().contains("found compressed data, as SPZ files are"));
    assert!(read(b"\x00\xff\n").unwrap_err().ends_with("found other bytes"));
    assert!(read(b"plx\n").unwrap_err().contains("header line 1: expected `ply`, found `plx`"));
    assert!(
        read(&[b"ply\n".as_slice(), &[b'a'; 100_000]].concat())
            .unwrap_err()
            .contains("found none in the first 65536 bytes")
    );
}

#[test]
fn a_count_is_compared_with_the_length_before_anything_is_allocated() {
    let bytes = written(&cloud(3));
    for end in bytes.len() - 3 * 22 * 4..bytes.len() {
        let message = read(&bytes[..end]).unwrap_err();
        assert!(
            message.contains("length of the data: expected 264 bytes (3 vertices of 88 bytes), found"),
            "{message}"
        );
    }
    assert!(read(&[bytes.as_slice(), b"\n"].concat()).unwrap_err().ends_with("found 265 bytes"));
    let mut lines = required(0);
    lines[0] = format!("element vertex {}", u64::MAX);
    lines.push("end_header".to_owned());
    let lines: Vec<&str> = lines.iter().map(String::as_str).collect();
    let expected = format!("expected {} bytes", u128::from(u64::MAX) * 56);
    assert!(read(&file(&lines, &[0; 56])).unwrap_err().contains(&expected));
    assert!(read(&file(&["element vertex 5", "end_header"], &[])).unwrap_err().contains("5 vertices of 0 bytes"));
}

#[test]
fn values_that_are_not_finite_are_named() {
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let mut bytes = written(&cloud(3));
        let at = bytes.len() - 2 * 22 * 4 + 9 * 4; // the opacity of vertex 1
        bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
        let message = read(&bytes).unwrap_err();
        assert!(message.ends_with(&format!("vertex 1 opacity: expected a finite f32, found {value}")), "{message}");
        let mut bad = cloud(3);
        bad.extra[0].1[2] = value;
        let message = write_ply(Path::new("no/scene.ply"), &bad).unwrap_err().to_string();
        assert!(message.ends_with(&format!("vertex 2 score: expected a finite f32, found {value}")), "{message}");
    }
}

#[test]
fn clouds_that_could_not_be_read_back_are_not_written() {
    let path = Path::new("no/scene.ply");
    let message = |cloud: &SplatCloud| write_ply(path, cloud).unwrap_err().to_string();
    let mut short = cloud(3);
    short.times.pop();
    assert_eq!(message(&short), "no/scene.ply: times: expected 3 values as means, found 2");
    for name in ["", "two words", "x", "vx", "nx", "f_rest_3", "t", "score", "\u{fc}", "end\nheader"] {
        let mut bad = cloud(3);
        bad.extra.push((name.to_owned(), vec![0.0; 3]));
        assert!(message(&bad).starts_with("no/scene.ply: extra[1]: expected a free name"), "{}", message(&bad));
    }
    let mut many = cloud(0);
    many.extra = (0..5000).map(|i| (format!("column_{i}"), vec![])).collect();
    assert!(message(&many).contains("extra: expected names of 65536 bytes in all"), "{}", message(&many));
}
