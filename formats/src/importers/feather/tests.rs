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

/// 300 rows in two batches of every kind of column, as pyarrow writes them; `tests/fixtures/feather/make.py` says what they hold.
const KINDS: [&[u8]; 3] = [
    include_bytes!("../../../../tests/fixtures/feather/uncompressed.feather"),
    include_bytes!("../../../../tests/fixtures/feather/lz4.feather"),
    include_bytes!("../../../../tests/fixtures/feather/zstd.feather"),
];

#[test]
fn every_kind_and_every_codec_is_read() {
    for bytes in KINDS {
        let table = read(bytes).unwrap();
        assert_eq!(table.len(), 300);
        let rows = || 0..300_i64;
        assert_eq!(table.ints("i8").unwrap(), rows().map(|k| -(k % 100)).collect::<Vec<_>>());
        assert_eq!(table.ints("u32").unwrap(), rows().map(|k| 4_294_967_295 - k).collect::<Vec<_>>());
        assert_eq!(table.ints("i64").unwrap(), rows().map(|k| k * 1_000_000_000_000_000).collect::<Vec<_>>());
        assert_eq!(table.floats("f32").unwrap(), rows().map(|k| k as f64 / 4.0).collect::<Vec<_>>());
        assert_eq!(table.floats("f64").unwrap(), rows().map(|k| k as f64 / 8.0).collect::<Vec<_>>());
        for row in 0..300 {
            let want = (row % 7 != 0).then(|| format!("row {row}"));
            assert_eq!(table.text("text", row).ok(), want.as_deref());
            assert_eq!(table.text("long", row).unwrap(), format!("größe {row}"));
        }
        for (name, kind) in
            [("flag", "Bool"), ("code", "dictionary codes"), ("nothing", "Null"), ("moment", "Timestamp")]
        {
            let message = table.floats(name).unwrap_err().to_string();
            assert!(message.ends_with(&format!("{name}: expected numbers, found {kind}")), "{message}");
        }
    }
}

#[test]
fn tables_without_rows_and_tables_that_no_importer_reads() {
    let empty = read(include_bytes!("../../../../tests/fixtures/feather/empty.feather")).unwrap();
    assert_eq!((empty.len(), empty.ints("x").unwrap().len(), empty.has("t")), (0, 0, true));
    let list = read(include_bytes!("../../../../tests/fixtures/feather/list.feather")).unwrap_err();
    assert!(list.ends_with("footer: expected flat columns, found `x` of columns"), "{list}");
    let missing = read(include_bytes!("../../../../tests/fixtures/feather/missing.feather")).unwrap_err();
    assert!(missing.ends_with("batch 0: x: expected a value in every row, found rows without"), "{missing}");
}

#[test]
fn batches_that_share_their_bytes_are_refused() {
    // the offset, the head and the body of the first batch stand in the footer, and the second one's after it
    let mut bytes = KINDS[0].to_vec();
    let is_block = |at: usize| {
        let word = |k: usize| bytes[at + 8 * k..].first_chunk().map_or(0, |&word| i64::from_le_bytes(word));
        let [start, head, body] = [word(0), word(1) & 0xffff_ffff, word(2)];
        start > 0 && head > 0 && body > 8000 && start + head + body == word(3)
    };
    let at = (0..bytes.len() - 32).rev().find(|&at| is_block(at)).unwrap();
    bytes[at + 16..at + 24].copy_from_slice(&i64::MAX.to_le_bytes());
    let message = read(&bytes).unwrap_err();
    assert!(message.contains("footer: expected batches of at most"), "{message}");
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
    // every byte of a small file, and some of those that zstd packed
    let (small, zstd) = (small(), KINDS[2].to_vec());
    let places =
        (0..small.len()).map(|place| (&small, place)).chain((0..zstd.len()).step_by(9).map(|place| (&zstd, place)));
    for (good, place) in places {
        for flip in [0x01, 0x80, 0xff] {
            let mut bad = good.clone();
            bad[place] ^= flip;
            if let Err(message) = read(&bad) {
                assert!(!message.contains('\n') && message.len() < 2000, "{message}");
            }
        }
    }
}
