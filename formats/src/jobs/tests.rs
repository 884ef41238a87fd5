//! Jobs of records: resumed, in parts, with failures, and what is refused.

use std::{
    fs,
    path::{Path, PathBuf},
};

use serde_json::{Value, json};

use super::*;
use crate::targets::MANIFEST_FILE;

fn names() -> Vec<String> {
    (0..7).map(|k| format!("snippet-{k}")).collect()
}

/// A record and a file of an item; the fourth item fails.
fn made(item: &str) -> Result<Made, String> {
    if item == "snippet-3" {
        return Err("no input frames".to_owned());
    }
    Ok(Made {
        record: json!({ "psnr": item.len(), "of": item }),
        files: vec![("a.bin".to_owned(), item.as_bytes().to_vec())],
    })
}

fn run(out: &Path, key: &Value, part: Option<Part>, resume: bool) -> crate::error::Result<(RecordManifest, Tried)> {
    let all = names();
    let job = RecordJob { out, key, items: Items { all: &all, part, resume } };
    job.run(&mut made, &mut |_| ())
}

/// Every file below a folder, with its bytes.
fn content(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut all = Vec::new();
    let mut open = vec![folder.to_owned()];
    while let Some(next) = open.pop() {
        for path in fs::read_dir(next).unwrap().map(|entry| entry.unwrap().path()) {
            if path.is_dir() {
                open.push(path);
            } else {
                all.push((path.strip_prefix(folder).unwrap().to_owned(), fs::read(&path).unwrap()));
            }
        }
    }
    all.sort();
    all
}

#[test]
fn a_job_that_stops_and_goes_on_and_one_in_parts_end_with_the_same_bytes() {
    let place = tempfile::tempdir().unwrap();
    let at = |name: &str| place.path().join(name);
    let key = json!({ "weights": "tiny" });
    let (manifest, tried) = run(&at("whole"), &key, None, false).unwrap();
    assert_eq!((tried.done_now, tried.failed.len(), manifest.done.len()), (6, 1, 6));
    assert_eq!(manifest.failed[0].reason, "no input frames");
    let whole = content(&at("whole"));
    assert_eq!(whole.len(), 6 * 2 + 1);

    // As if it had been killed: the last records and the manifest are missing, and a write was not finished.
    fs::create_dir(at("killed")).unwrap();
    run(&at("killed"), &key, None, false).unwrap();
    fs::remove_file(at("killed").join(MANIFEST_FILE)).unwrap();
    for item in ["snippet-5", "snippet-6"] {
        fs::remove_file(at("killed").join(format!("items/{item}.json"))).unwrap();
    }
    fs::remove_file(at("killed").join("items/snippet-6/a.bin")).unwrap();
    for unfinished in ["items/.lgs-1.part", "items/snippet-6/.lgs-2.part"] {
        fs::write(at("killed").join(unfinished), "half").unwrap();
    }
    let (_, tried) = run(&at("killed"), &key, None, true).unwrap();
    assert_eq!((tried.done_now, tried.done_before), (2, 4));
    assert_eq!(content(&at("killed")), whole);

    for index in [2, 3, 1] {
        let part = Some(Part { index, count: 3 });
        run(&at("parts"), &key, part, false).unwrap();
        run(&at(&format!("part{index}")), &key, part, false).unwrap();
    }
    fs::write(at("parts").join("items/.lgs-1.part"), "half").unwrap();
    RecordManifest::merge(&[at("parts")], &at("parts")).unwrap();
    assert_eq!(content(&at("parts")), whole, "parts of one folder");
    let folders = [1, 2, 3].map(|index| at(&format!("part{index}")));
    RecordManifest::merge(&folders, &at("merged")).unwrap();
    assert_eq!(content(&at("merged")), whole, "parts of several folders");
    assert_eq!(RecordManifest::merge(&[at("parts")], &at("parts")).unwrap(), manifest, "once more");
}

#[test]
fn what_does_not_fit_together_is_refused() {
    let place = tempfile::tempdir().unwrap();
    let (out, key) = (place.path().join("o"), json!(1));
    run(&out, &key, None, false).unwrap();
    let said = |result: crate::error::Result<(RecordManifest, Tried)>| result.unwrap_err().to_string();
    assert!(said(run(&out, &key, None, false)).contains("out: expected an empty folder, or `resume`"));
    assert!(said(run(&out, &json!(2), None, true)).contains("key: expected 2, found 1"));
    fs::write(out.join("items/snippet-0/a.bin"), "other").unwrap();
    assert!(said(run(&out, &key, None, true)).contains("a.bin: SHA-256"));
    let some = run(&place.path().join("p"), &key, Some(Part { index: 1, count: 2 }), false);
    assert!(some.is_ok());
    let folders = [place.path().join("p")];
    let missing = RecordManifest::merge(&folders, &place.path().join("m")).unwrap_err().to_string();
    assert!(missing.contains("part-2-of-2.json once, found it 0 times"), "{missing}");
    let none = RecordManifest::merge(&[place.path().join("o")], &place.path().join("m")).unwrap_err().to_string();
    assert!(none.contains("part-I-of-N.json"), "{none}");
    for wrong in [vec!["a/b".to_owned()], vec!["a".to_owned(), "a".to_owned()], vec![String::new()]] {
        let items = Items { all: &wrong, part: None, resume: false };
        let out = place.path().join("w");
        assert!(RecordJob { out: &out, key: &key, items }.run(&mut made, &mut |_| ()).is_err(), "{wrong:?}");
        let names = |_: &str| Ok::<_, String>(Made { record: key.clone(), files: vec![("../b".to_owned(), vec![1])] });
        let all = ["a".to_owned()];
        let job = RecordJob { out: &out, key: &key, items: Items { all: &all, ..items } };
        assert!(job.run(&mut names.clone(), &mut |_| ()).is_err());
    }
}

#[test]
fn records_are_read_back() {
    let place = tempfile::tempdir().unwrap();
    let (all, key) = (names(), json!({ "seed": 0 }));
    let job = RecordJob { out: place.path(), key: &key, items: Items { all: &all, part: None, resume: false } };
    job.run(&mut made, &mut |_| ()).unwrap();
    assert_eq!(job.record("snippet-1").unwrap(), Some(json!({ "psnr": 9, "of": "snippet-1" })));
    assert_eq!(job.record("snippet-3").unwrap(), None);
    let other = json!({ "seed": 1 });
    assert!(RecordJob { key: &other, ..job }.record("snippet-1").is_err());
}
