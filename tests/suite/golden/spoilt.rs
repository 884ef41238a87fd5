//! A golden with a wrong value fails, and the report says where it is and what was wanted.

use std::fs;
use std::path::Path;
use std::process::Command;

use lgs_tests::{Outcome, case, places};
use libtest_mimic::Trial;
use safetensors::SafeTensors;

/// A golden, one tensor of it to spoil, and the case that must notice.
struct Spoilt {
    kind: &'static str,
    files: &'static [&'static str],
    tensor: &'static str,
    case: &'static str,
}

const SPOILT: [Spoilt; 4] = [
    Spoilt {
        kind: "sparse_conv",
        files: &["a_small.safetensors"],
        tensor: "out.up",
        case: "golden::sparse_conv::given::a_small::chain",
    },
    Spoilt { kind: "knn", files: &["a_random.safetensors"], tensor: "out.idx", case: "golden::knn::given::a_random" },
    Spoilt {
        kind: "ptv3",
        files: &["a_small_1x1000.io.safetensors", "a_small_1x1000.weights.safetensors"],
        tensor: "act.enc2",
        case: "golden::ptv3::given::a_small_1x1000::folded",
    },
    Spoilt {
        kind: "ptv3",
        files: &["a_small_1x1000.io.safetensors", "a_small_1x1000.weights.safetensors"],
        tensor: "ser.order.hilbert",
        case: "golden::ptv3::given::a_small_1x1000::serialization",
    },
];

pub(crate) fn cases() -> Vec<Trial> {
    let notices = |spoilt: &'static Spoilt| case(format!("golden::spoilt::{}", spoilt.tensor), || is_noticed(spoilt));
    SPOILT.iter().map(notices).collect()
}

/// Runs the case on an honest copy, which passes, and on one whose last value has another sign bit, which must not.
fn is_noticed(spoilt: &Spoilt) -> Outcome {
    let place = tempfile::tempdir()?;
    let directory = place.path().join(spoilt.kind);
    fs::create_dir(&directory)?;
    for file in spoilt.files {
        fs::copy(places::shipped_goldens(spoilt.kind).join(file), directory.join(file))?;
    }
    let (passed, text) = run(place.path(), spoilt.case)?;
    if !passed {
        return Err(format!("the honest copy fails: {text}").into());
    }
    let path = directory.join(spoilt.files[0]);
    let mut bytes = fs::read(&path)?;
    let end = end_of(&bytes, spoilt.tensor)?;
    bytes[end - 1] ^= 0x80;
    fs::write(&path, bytes)?;
    let (passed, text) = run(place.path(), spoilt.case)?;
    let missing: Vec<_> = ["got ", "want ", "tolerance "].iter().filter(|word| !text.contains(**word)).collect();
    if passed || !missing.is_empty() {
        return Err(format!("passed: {passed}, the report lacks {missing:?}: {text}").into());
    }
    Ok(())
}

/// Where a tensor's bytes end in a safetensors file.
fn end_of(bytes: &[u8], tensor: &str) -> Result<usize, Box<dyn std::error::Error>> {
    let parsed = SafeTensors::deserialize(bytes)?;
    let data = parsed.tensor(tensor)?.data();
    Ok(data.as_ptr_range().end as usize - bytes.as_ptr() as usize)
}

/// Runs one case of this suite with goldens from a directory: whether it passed, and the report.
fn run(goldens: &Path, name: &str) -> Result<(bool, String), Box<dyn std::error::Error>> {
    let mut command = Command::new(std::env::current_exe()?);
    let output = command.env("LGS_GOLDEN_DIR", goldens).args(["--exact", name]).output()?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    if !text.contains("running 1 test") {
        return Err(format!("no case {name}: {text}").into());
    }
    Ok((output.status.success(), text))
}
