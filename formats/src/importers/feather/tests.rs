use super::*;

/// 3 rows as pandas writes them: a u16, a f16 and a text column, LZ4; see the suite's fixtures for more.
fn small() -> Vec<u8> {
    include_bytes!("../../../../tests/fixtures/feather/small.feather").to_vec()
}

fn read(bytes: &[u8]) -> std::result::Result<Table, String> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("t.feather");
    std::fs::write(&path, bytes).unwrap();
    read_feather(&path).map_err(|e| e.to_string())
}

#[test]
fn a_file_of_pandas_is_read() {
    let table = read(&small()).unwrap();
    assert_eq!(table.len(), 3);
    assert_eq!(table.ints("count").unwrap(), [1, 500, 65_535]);
    assert_eq!(table.floats("half").unwrap().as_ref(), [0.5, -2.0, 65_504.0]);
    assert_eq!([0, 1, 2].map(|row| table.text("name", row).unwrap().to_owned()), ["ring", "", "größe"]);
    assert!(table.text("name", 3).is_err() && table.ints("half").is_err() && table.floats("other").is_err());
}

#[test]
fn a_file_that_ends_early_is_an_error_wherever_it_ends() {
    let good = small();
    for end in 0..good.len() {
        let message = read(&good[..end]).unwrap_err();
        assert!(message.contains("t.feather: footer: expected an Arrow file"), "{end}: {message}");
    }
}

#[test]
fn damaged_files_never_panic() {
    let good = small();
    for place in 0..good.len() {
        for flip in [0x01, 0x80, 0xff] {
            let mut bad = good.clone();
            bad[place] ^= flip;
            if let Err(message) = read(&bad) {
                assert!(!message.contains('\n') && message.len() < 2000, "{message}");
            }
        }
    }
}
