//! A fixed number of changed inputs for every reader of files from outside: the fuzzers of `tests/fuzz` with a repeatable source.

use std::time::{Duration, Instant};

use lgs_tests::hostile::{Mutator, Stage, TARGETS, Target};
use lgs_tests::hostile_models::TARGETS as MODELS;
use lgs_tests::{Outcome, places};

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
];

fn attack(target: &Target) -> Outcome {
    let asked = std::env::var("LGS_FUZZ_EXECUTIONS").ok().and_then(|text| text.parse().ok());
    let seed = std::env::var("LGS_FUZZ_SEED").ok().and_then(|text| text.parse().ok()).unwrap_or(1);
    let executions: u64 = asked.unwrap_or(EXECUTIONS);
    let stage = Stage::new(target, places::repository())?;
    let (seeds, mut mutator) = (stage.seeds(), Mutator::new(seed));
    let mut refused = 0_u64;
    for execution in 0..executions {
        let input = mutator.next(&seeds);
        let start = Instant::now();
        let said = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| stage.run(&input)));
        let took = start.elapsed();
        ensure(said.is_ok() && took < LONGEST, || {
            format!("execution {execution} of seed {seed}: {took:?}, {input:?}")
        })?;
        refused += u64::from(matches!(said, Ok(Err(_))));
    }
    ensure(refused > executions / 10 || executions < 100, || {
        format!("{refused} of {executions} refused: nothing is changed")
    })
}
