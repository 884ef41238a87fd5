//! Waymo's drives that are damaged in one way each: one line that names file and field, exit code 2, nothing written.

use std::fs;
use std::path::{Path, PathBuf};

use lgs_tests::{Outcome, case, clips};
use libtest_mimic::Trial;

use super::drive::{fixture, import};

/// Bytes before a record and behind it.
const HEAD: usize = 12;
const TAIL: usize = 4;

pub(super) fn cases() -> Vec<Trial> {
    let name = |what: &str| format!("importers::waymo::{what}");
    vec![
        case(name("a_truncated_record"), truncated),
        case(name("a_wrong_checksum"), wrong_checksum),
        case(name("frames_that_are_left_out_are_not_read"), left_out),
        case(name("lengths_that_lie"), lengths),
        case(name("what_a_frame_needs"), needs),
        case(name("a_lost_component"), lost_component),
        case(name("a_lost_column"), lost_column),
        case(name("an_unknown_compression"), compression),
        case(name("a_cut_component"), cut_component),
    ]
}

/// The content of every record of the small drive.
fn records() -> Result<Vec<Vec<u8>>, String> {
    let file = fs::read(fixture("waymo/drive.tfrecord")).map_err(|e| e.to_string())?;
    let (mut records, mut rest) = (Vec::new(), file.as_slice());
    while let Some(length) = rest.first_chunk() {
        let end = HEAD + usize::try_from(u64::from_le_bytes(*length)).map_err(|e| e.to_string())?;
        records.push(rest[HEAD..end].to_vec());
        rest = &rest[end + TAIL..];
    }
    Ok(records)
}

/// The masked CRC-32C, bit by bit.
fn checksum(bytes: &[u8]) -> [u8; 4] {
    let mut crc = u32::MAX;
    for byte in bytes {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = (crc >> 1) ^ if crc & 1 == 1 { 0x82f6_3b78 } else { 0 };
        }
    }
    (!crc).rotate_right(15).wrapping_add(0xa282_ead8).to_le_bytes()
}

fn file_of(records: &[Vec<u8>]) -> Vec<u8> {
    let record = |content: &Vec<u8>| {
        let length = (content.len() as u64).to_le_bytes();
        [&length[..], &checksum(&length), content, &checksum(content)].concat()
    };
    records.iter().flat_map(record).collect()
}

/// Fails unless a file of these bytes is refused with a line that holds `names`, and nothing is written.
fn refused(bytes: &[u8], flags: &[&str], names: &[&str]) -> Outcome {
    let place = tempfile::tempdir()?;
    let file = place.path().join("d.tfrecord");
    fs::write(&file, bytes)?;
    import(&file, place.path(), flags)?.expect_refusal(names)?;
    if place.path().join("out").exists() { Err("a refused import left a clip".into()) } else { Ok(()) }
}

fn truncated() -> Outcome {
    let good = file_of(&records()?);
    refused(&good[..good.len() - 1], &[], &["d.tfrecord: record 2", "a whole record", "truncated?"])?;
    refused(&good[..good.len() / 2], &[], &["d.tfrecord: record 1", "truncated?"])?;
    refused(&good[..5], &[], &["d.tfrecord: record 0", "5 bytes (truncated?)"])?;
    refused(b"", &[], &["d.tfrecord: frames: expected at least one frame, found none"])?;
    // Records before the damage are good.
    let place = tempfile::tempdir()?;
    fs::write(place.path().join("d.tfrecord"), &good[..good.len() - 1])?;
    import(&place.path().join("d.tfrecord"), place.path(), &["--frames", "0,1"])?.expect_success()
}

fn wrong_checksum() -> Outcome {
    let records = records()?;
    let good = file_of(&records);
    let mut bad = good.clone();
    bad[3] ^= 1; // of the first length
    refused(&bad, &[], &["d.tfrecord: record 0", "a length with the checksum behind it"])?;
    for at in [HEAD, HEAD + 999, HEAD + records[0].len() - 1, HEAD + records[0].len()] {
        let mut bad = good.clone();
        bad[at] ^= 0x40;
        refused(&bad, &[], &["d.tfrecord: record 0", "content with the masked CRC-32C", "damaged?"])?;
    }
    Ok(())
}

fn left_out() -> Outcome {
    let mut records = records()?;
    records[1] = b"no frame".to_vec();
    let mut bytes = file_of(&records);
    let last = bytes.len() - 9;
    bytes[last] ^= 1;
    refused(&bytes, &[], &["d.tfrecord: record 1"])?;
    refused(&bytes, &["--frames", "0,2"], &["d.tfrecord: record 2", "CRC-32C"])?;
    refused(&bytes, &["--frames", "2", "--cameras", "FRONT"], &["d.tfrecord: record 2", "CRC-32C"])?;
    refused(&bytes, &["--frames", "3"], &["--frames", "below 3"])?;
    let place = tempfile::tempdir()?;
    fs::write(place.path().join("d.tfrecord"), &bytes)?;
    import(&place.path().join("d.tfrecord"), place.path(), &["--frames", "0"])?.expect_success()
}

/// A field of a message: its key, its length, its content.
fn field(number: u8, content: &[u8]) -> Vec<u8> {
    let length = u8::try_from(content.len()).unwrap_or(127);
    [&[number << 3 | 2, length], content].concat()
}

fn lengths() -> Outcome {
    let refuse = |message: Vec<u8>, names: &[&str]| refused(&file_of(&[message]), &[], names);
    let names = ["d.tfrecord: record 0, byte ", "what is left of its message"];
    refuse(vec![1 << 3 | 2, 100, 1], &names)?;
    // An image that would go on behind its message.
    refuse(field(4, &[2 << 3 | 2, 50, 0xff, 0xd8]), &names)?;
    // A range image whose packed bytes end elsewhere.
    refuse(field(5, &field(2, &[2 << 3 | 2, 9])), &names)?;
    refuse(vec![0xff; 12], &["d.tfrecord: record 0, byte ", "a number of at most 64 bits"])?;
    refuse(vec![1 << 3 | 3], &["d.tfrecord: record 0, byte ", "a wire type of field 1"])?;
    refuse(field(3, &field(1, &[0; 24])), &["d.tfrecord: record 0: pose", "a rigid 4x4 pose", "3 numbers"])
}

/// The first record with the first occurrence of some bytes replaced by others of the same length.
fn changed(old: &[u8], new: &[u8]) -> Result<Vec<u8>, String> {
    let mut content = records()?.swap_remove(0);
    let at = content.windows(old.len()).position(|window| window == old).ok_or("nothing to change")?;
    content[at..at + new.len()].copy_from_slice(new);
    Ok(file_of(&[content]))
}

fn needs() -> Outcome {
    refused(&file_of(&[Vec::new()]), &[], &["d.tfrecord: record 0: timestamp_micros: expected one, found none"])?;
    let skewed = changed(&1.0_f64.to_le_bytes(), &2.0_f64.to_le_bytes())?;
    refused(&skewed, &[], &["d.tfrecord: record 0", "extrinsic", "a rigid 4x4 pose"])?;
    // A beam fewer than rows, and a range image that is no deflated one.
    let beam = [2 << 3 | 1].iter().chain(&(-0.1_f64).to_le_bytes()).copied().collect::<Vec<u8>>();
    let other = [15 << 3 | 1].iter().chain(&(-0.1_f64).to_le_bytes()).copied().collect::<Vec<u8>>();
    refused(&changed(&beam, &other)?, &[], &["d.tfrecord/frame_0000.lidar: TOP: first returns", "4 rows for 3 beams"])?;
    refused(&changed(&[0x78, 0x9c], &[0x79, 0x9c])?, &[], &["d.tfrecord", "frame_0000.lidar TOP", "zlib"])?;
    // The picture itself.
    refused(&changed(&[0xff, 0xd8], &[0xff, 0x00])?, &[], &["d.tfrecord/frame_0000_FRONT.jpg: image format"])
}

/// A copy of the components of the small drive, of which one is changed.
fn components(place: &Path, component: &str, change: impl FnOnce(&Path, Vec<u8>) -> Outcome) -> Outcome {
    let source = place.join("source");
    clips::copy(&fixture("waymo_v2"), &source)?;
    let file: PathBuf = source.join(component).join("drive.parquet");
    let bytes = fs::read(&file)?;
    change(&file, bytes)
}

/// Fails unless components of which one is changed are refused.
fn refused_components(component: &str, names: &[&str], change: impl FnOnce(&Path, Vec<u8>) -> Outcome) -> Outcome {
    let place = tempfile::tempdir()?;
    components(place.path(), component, change)?;
    import(&place.path().join("source"), place.path(), &[])?.expect_refusal(names)?;
    if place.path().join("out").exists() { Err("a refused import left a clip".into()) } else { Ok(()) }
}

fn lost_component() -> Outcome {
    let remove = |file: &Path, _: Vec<u8>| Ok(fs::remove_file(file)?);
    for component in ["lidar_calibration", "vehicle_pose"] {
        refused_components(component, &[component, "drive.parquet"], remove)?;
    }
    refused_components("camera_calibration", &["lidar/drive.parquet", "camera_calibrations", "one of FRONT"], remove)?;
    refused_components("lidar", &["drive", "lidar/*.parquet"], remove)?;
    for (component, what) in [("lidar_box", "boxes unknown"), ("camera_image", "0 images")] {
        let place = tempfile::tempdir()?;
        components(place.path(), component, remove)?;
        let finished = import(&place.path().join("source"), place.path(), &[])?;
        finished.expect_success()?;
        if !finished.stdout.contains(what) {
            return Err(finished.stdout.into());
        }
    }
    Ok(())
}

/// Puts other bytes of the same length in the place of every occurrence.
fn replaced(mut bytes: Vec<u8>, old: &[u8], new: &[u8]) -> Result<Vec<u8>, String> {
    let places: Vec<usize> = (0..=bytes.len() - old.len()).filter(|&at| bytes[at..].starts_with(old)).collect();
    if places.is_empty() {
        return Err("nothing to replace".to_owned());
    }
    places.into_iter().for_each(|at| bytes[at..at + new.len()].copy_from_slice(new));
    Ok(bytes)
}

fn lost_column() -> Outcome {
    let rename = |old: &'static str, new: &'static str| {
        move |file: &Path, bytes: Vec<u8>| Ok(fs::write(file, replaced(bytes, old.as_bytes(), new.as_bytes())?)?)
    };
    let names = |component: &'static str, column: &'static str| [component, "columns", column];
    let change = rename("intrinsic.k3", "intrinsic.k9");
    refused_components("camera_calibration", &names("camera_calibration/drive.parquet", "intrinsic.k3"), change)?;
    let change = rename("range_image_return1.values", "range_image_return9.values");
    refused_components("lidar", &names("lidar/drive.parquet", "range_image_return1.values"), change)?;
    let change = rename("key.frame_timestamp_micros", "key.frame_timestamp_nanos_");
    refused_components("vehicle_pose", &names("vehicle_pose/drive.parquet", "key.frame_timestamp_micros"), change)
}

/// The codec of the columns, field 4 of their description, is Snappy (1): a zigzag 2 behind the type of a field of 32 bits.
fn compression() -> Outcome {
    refused_components(
        "vehicle_pose",
        &["vehicle_pose/drive.parquet", "compression 0 (none), 1 (Snappy)", "found 7"],
        |file, bytes| {
            // After the path of the timestamp's column: 0x15 0x02, which becomes 7.
            let path = b"key.frame_timestamp_micros\x15\x02";
            let other = b"key.frame_timestamp_micros\x15\x0e";
            Ok(fs::write(file, replaced(bytes, path, other)?)?)
        },
    )
}

fn cut_component() -> Outcome {
    for component in ["lidar", "camera_image", "lidar_pose"] {
        let name = format!("{component}/drive.parquet");
        refused_components(component, &[&name, "footer", "`PAR1` at the end"], |file, bytes| {
            Ok(fs::write(file, &bytes[..bytes.len() - 5])?)
        })?;
        refused_components(component, &[&name, "footer", "a Parquet file"], |file, bytes| {
            Ok(fs::write(file, &bytes[..9])?)
        })?;
    }
    Ok(())
}
