//! What the fuzzers of `tests/fuzz` have kept, and a fixed number of changed inputs, for every reader of files from outside.

use std::fs::File;
use std::io::Read;
use std::time::{Duration, Instant};

use lgs_tests::hostile::{Mutator, Stage, TARGETS, Target};
use lgs_tests::hostile_models::TARGETS as MODELS;
use lgs_tests::{Outcome, places};
use libtest_mimic::Failed;

use super::{Extreme, ensure};

/// Inputs that each reader is given, where `LGS_FUZZ_EXECUTIONS` does not ask for another number.
const EXECUTIONS: u64 = 400;
/// Longest time that one input may take.
const LONGEST: Duration = Duration::from_secs(30);

macro_rules! reader {
    ($name:literal, $input:literal, $target:expr) => {
        Extreme::new(
            $name,
            $input,
            "read, or refused with a sentence: no panic, nothing that is not finite, at most 30 s",
            || attack(&$target),
        )
    };
}

pub(super) const CASES: &[Extreme] = &[
    reader!("clip", "changed files of a clip directory", TARGETS[0]),
    reader!("ply", "changed PLY files", TARGETS[1]),
    reader!("targets", "changed shards and manifests", TARGETS[2]),
    reader!("weights", "changed weights files", MODELS[0]),
    reader!("config", "changed model configs", MODELS[1]),
    reader!("dgp", "changed files of a DGP scene", TARGETS[3]),
    reader!("kitti_raw", "changed files of a KITTI drive", TARGETS[4]),
    reader!("av2", "changed files of an Argoverse 2 log", TARGETS[5]),
    reader!("pandaset", "changed files of a PandaSet sequence", TARGETS[6]),
    reader!("nuscenes", "changed files of a nuScenes release", TARGETS[7]),
    reader!("depth", "changed depth maps, PNG and npy, metric and relative", TARGETS[8]),
    reader!("path", "changed camera paths", TARGETS[9]),
    reader!("waymo", "changed files of records of a Waymo drive", TARGETS[10]),
    reader!("waymo_v2", "changed components of a Waymo drive", TARGETS[11]),
];

fn attack(target: &Target) -> Outcome {
    let asked = std::env::var("LGS_FUZZ_EXECUTIONS").ok().and_then(|text| text.parse().ok());
    let seed = std::env::var("LGS_FUZZ_SEED").ok().and_then(|text| text.parse().ok()).unwrap_or(1);
    let executions: u64 = asked.unwrap_or(EXECUTIONS);
    let stage = Stage::new(target, places::repository())?;
    let (mut seeds, mut mutator) = (stage.seeds(), Mutator::new(seed));
    let kept = corpus(target.name)?;
    ensure(!kept.is_empty(), || "the fuzzers have kept nothing".to_owned())?;
    for (name, input) in kept {
        one(&stage, &input, &|| name.clone())?;
        seeds.push(input);
    }
    let mut refused = 0_u64;
    for execution in 0..executions {
        let input = mutator.next(&seeds);
        refused += u64::from(one(&stage, &input, &|| format!("execution {execution} of seed {seed}"))?);
    }
    ensure(refused > executions / 10 || executions < 100, || {
        format!("{refused} of {executions} refused: nothing is changed")
    })
}

/// Whether the reader refuses an input.
fn one(stage: &Stage, input: &[u8], name: &dyn Fn() -> String) -> Result<bool, Failed> {
    let start = Instant::now();
    let said = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| stage.run(input)));
    let took = start.elapsed();
    ensure(said.is_ok() && took < LONGEST, || format!("{}: {took:?}, {input:?}", name()))?;
    Ok(matches!(said, Ok(Err(_))))
}

/// The inputs that a fuzzer has kept since each leads somewhere else, by their names.
fn corpus(target: &str) -> Result<Vec<(String, Vec<u8>)>, Failed> {
    let file = places::repository().join("tests/fuzz/corpus").join(format!("{}.zip", target.replace('-', "_")));
    let mut archive = zip::ZipArchive::new(File::open(&file).map_err(|e| format!("{}: {e}", file.display()))?)?;
    let mut kept = Vec::with_capacity(archive.len());
    for k in 0..archive.len() {
        let (mut entry, mut input) = (archive.by_index(k)?, Vec::new());
        entry.read_to_end(&mut input)?;
        kept.push((format!("{}: {k:03}", file.display()), input));
    }
    Ok(kept)
}
