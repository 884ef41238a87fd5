use super::*;

/// One table of 60 rows in several ways, as pyarrow writes it: see `tests/fixtures/waymo.py`.
const WAYS: [(&str, &[u8]); 5] = [
    ("plain", include_bytes!("../../../../tests/fixtures/parquet/plain.parquet")),
    ("snappy", include_bytes!("../../../../tests/fixtures/parquet/snappy.parquet")),
    ("pages", include_bytes!("../../../../tests/fixtures/parquet/pages.parquet")),
    ("second", include_bytes!("../../../../tests/fixtures/parquet/second.parquet")),
    ("gzip", include_bytes!("../../../../tests/fixtures/parquet/gzip.parquet")),
];
const LZ4: &[u8] = include_bytes!("../../../../tests/fixtures/parquet/lz4.parquet");
const DELTA: &[u8] = include_bytes!("../../../../tests/fixtures/parquet/delta.parquet");
const ROWS: u64 = 60;

/// What `act` makes of a file of these bytes.
fn on<T>(bytes: &[u8], act: impl Fn(&ParquetFile) -> Result<T>) -> std::result::Result<T, String> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("t.parquet");
    std::fs::write(&path, bytes).unwrap();
    ParquetFile::open(&path).and_then(|file| act(&file)).map_err(|e| e.to_string())
}

/// All of the table.
fn all(file: &ParquetFile) -> Result<()> {
    file.ints("whole")?;
    file.ints("small")?;
    file.floats("float")?;
    file.floats("double")?;
    file.texts("text")?;
    for row in [59, 0, 31] {
        file.bytes("bytes", row)?;
        file.numbers("list", row)?;
        file.numbers("three", row)?;
    }
    Ok(())
}

#[test]
fn the_same_table_in_every_way() {
    for (way, bytes) in WAYS {
        let columns = |file: &ParquetFile| {
            let whole = (0..60).map(|r| (r % 7 != 3).then_some(r * r - 5)).collect::<Vec<Option<i64>>>();
            assert_eq!(file.ints("whole")?, whole, "{way}");
            assert_eq!(file.ints("small")?, (0..60).map(|r| Some(r % 3 - 1)).collect::<Vec<_>>(), "{way}");
            assert_eq!(file.floats("float")?, (0..60).map(|r| Some(f64::from(r) / 4.0)).collect::<Vec<_>>(), "{way}");
            let double = (0..60).map(|r| (r % 11 != 0).then_some(f64::from(r) / 3.0)).collect::<Vec<_>>();
            assert_eq!(file.floats("double")?, double, "{way}");
            let text = (0..60).map(|r| (r % 13 != 1).then(|| format!("größe {}", r % 4))).collect::<Vec<_>>();
            assert_eq!(file.texts("text")?, text, "{way}");
            Ok(())
        };
        on(bytes, columns).unwrap();
    }
}

#[test]
fn single_rows_in_any_order() {
    for (way, bytes) in WAYS {
        let rows = |file: &ParquetFile| {
            for k in 0..ROWS {
                let row = k * 37 % ROWS;
                let byte = u8::try_from(row).unwrap();
                let want = vec![byte; usize::from(byte % 5)];
                assert_eq!(file.bytes("bytes", row)?, Some(want), "{way}: {row}");
                let count = if row % 11 == 3 { 0 } else { byte % 5 };
                let want: Vec<f64> = (byte..byte + count).map(f64::from).collect();
                assert_eq!(file.numbers("list", row)?, want, "{way}: {row}");
                assert_eq!(file.numbers("three", row)?, [0, 1, 2].map(|k| f64::from(byte + k)), "{way}: {row}");
            }
            assert_eq!(file.bytes("bytes", ROWS)?, None);
            assert_eq!(file.numbers("list", u64::MAX)?, [0.0; 0]);
            Ok(())
        };
        on(bytes, rows).unwrap();
    }
}

#[test]
fn what_is_not_there_or_unknown_is_said() {
    let (_, good) = WAYS[1];
    let message = on(good, |file| file.ints("other")).unwrap_err();
    assert!(message.contains("t.parquet: columns: expected a column `other`, found `whole`, `small`"), "{message}");
    let message = on(good, |file| file.ints("text")).unwrap_err();
    assert!(message.ends_with("t.parquet: text: expected integers, found Bytes"), "{message}");
    let message = on(good, |file| file.numbers("bytes", 3)).unwrap_err();
    assert!(message.ends_with("bytes: expected numbers, found Bytes"), "{message}");
    let message = on(LZ4, |file| file.ints("whole")).unwrap_err();
    let want = "whole: expected compression 0 (none), 1 (Snappy), 2 (gzip) or 6 (Zstandard), found ";
    assert!(message.contains(want), "{message}");
    let message = on(DELTA, |file| file.ints("whole")).unwrap_err();
    assert!(
        message.contains("whole: expected values of encoding 0 (plain), 2 or 8 (of a dictionary), found 5"),
        "{message}"
    );
}

#[test]
fn a_file_that_ends_early_is_an_error_wherever_it_ends() {
    for (_, good) in WAYS {
        for end in (0..good.len()).step_by(7) {
            let message = on(&good[..end], all).unwrap_err();
            assert!(message.contains("t.parquet: footer: expected "), "{end}: {message}");
        }
    }
}

#[test]
fn a_page_has_the_checksum_that_it_says() {
    let (_, good) = WAYS[2];
    let place = good.windows(6).position(|window| window == "größe".as_bytes().split_at(6).0).unwrap();
    let mut bad = good.to_vec();
    bad[place] ^= 1;
    let message = on(&bad, |file| file.texts("text")).unwrap_err();
    assert!(message.contains("text: expected a page with the CRC-32 "), "{message}");
}

#[test]
fn damaged_files_never_panic() {
    for (_, good) in WAYS {
        let mut bad = good.to_vec();
        for place in (0..good.len()).step_by(11) {
            bad[place] ^= [0x01, 0x80, 0xff][place % 3];
            if let Err(message) = on(&bad, all) {
                assert!(!message.contains('\n'), "{message}");
            }
            bad[place] = good[place];
        }
    }
}
