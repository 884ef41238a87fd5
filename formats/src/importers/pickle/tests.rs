use std::path::PathBuf;

use super::*;

/// One small frame as several versions of pandas pickle it.
const VERSIONS: [&str; 5] = ["0.25.3", "1.3.5", "2.0.3", "3.1.1", "columns_first"];

fn fixture(version: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(format!("../tests/fixtures/pandas/{version}.pkl.gz"))
}

fn read(bytes: &[u8]) -> std::result::Result<Table, String> {
    frame_of(At { file: Path::new("f.pkl"), field: "pickle" }, bytes).map_err(|e| e.to_string())
}

#[test]
fn frames_of_every_version_of_pandas_are_read() {
    for version in VERSIONS {
        let table = read_frame(&fixture(version)).unwrap();
        assert_eq!(table.len(), 3, "{version}");
        assert_eq!(table.rows(["x", "y"]).unwrap(), [[0.5, -1.0], [1.5, -2.0], [2.5, -3.0]], "{version}");
        assert_eq!(table.ints("d").unwrap(), [0, 1, 0], "{version}");
        assert_eq!(table.text("label", 1).unwrap(), "Bus", "{version}");
        assert!(table.text("label", 2).is_err(), "{version}: NaN is no text");
        assert_eq!(table.ints("stationary").unwrap(), [1, 0, 1], "{version}");
        assert!(!table.has("z"));
    }
}

#[test]
fn a_frame_that_ends_early_is_an_error_wherever_it_ends() {
    for version in VERSIONS {
        let good = decompressed(&fixture(version)).unwrap();
        for end in 0..good.len() {
            let message = read(&good[..end]).unwrap_err();
            assert!(message.contains("f.pkl: pickle: expected ") && message.len() < 400, "{version} {end}: {message}");
        }
    }
}

#[test]
fn damaged_frames_never_panic() {
    for version in VERSIONS {
        let good = decompressed(&fixture(version)).unwrap();
        for place in 0..good.len() {
            for flip in [0x01, 0x10, 0xff] {
                let mut bad = good.clone();
                bad[place] ^= flip;
                if let Err(message) = read(&bad) {
                    assert!(!message.contains('\n') && message.len() < 2000, "{message}");
                }
            }
        }
    }
}

#[test]
fn nothing_but_frames_is_looked_at() {
    let message = read(b"\x80\x02cos\nsystem\nX\x02\x00\x00\x00id\x85R.").unwrap_err();
    assert!(message.ends_with("pickle: expected only what frames of pandas need, found `os system`"), "{message}");
    let message = read(b"\x80\x04\x8c\x08builtins\x8c\x04eval\x93.").unwrap_err();
    assert!(message.ends_with("found `builtins eval`"), "{message}");
    let message = read(b"\x80\x04K\x01.").unwrap_err();
    assert!(message.ends_with("pickle: expected an object of `DataFrame`, found the number 1"), "{message}");
    // A list that holds itself, and one nested a million times: neither costs stack.
    assert!(read(b"\x80\x02]q\x00h\x00a.").is_err());
    let mut deep = b"\x80\x02)".to_vec();
    deep.extend(std::iter::repeat_n(0x85, 1_000_000));
    deep.push(b'.');
    assert!(read(&deep).unwrap_err().ends_with("found a sequence of 1"));
    let message = read(b"(lp0\n.").unwrap_err();
    assert!(message.ends_with("expected a pickle of protocol 2 to 5, found other bytes"), "{message}");
}
