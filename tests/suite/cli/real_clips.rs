//! `lgs-infer` on the real clips, where they are.

use std::path::Path;

use lgs_tests::process::{binary, run};
use lgs_tests::{Needed, Outcome, case_if, metrics, places};
use libtest_mimic::{Failed, Trial};
use serde_json::Value;

use super::infer::same_results;

/// Largest resident memory of a run with the full network, 10^6 bytes.
const MAX_MEMORY_MB: f64 = 8_000.0;

/// A run on a real clip.
struct RealRun {
    clip: &'static str,
    flags: &'static [&'static str],
}

const RUNS: [RealRun; 2] = [
    RealRun {
        clip: "ddad_scene_02",
        flags: &["--cameras", "CAMERA_01,CAMERA_05,CAMERA_06", "--image-size", "304x484", "--hold-out", "1"],
    },
    RealRun { clip: "kitti_sfnd", flags: &["--image-size", "94x310", "--hold-out", "odd"] },
];

pub(crate) fn cases() -> Vec<Trial> {
    let [wide, narrow] = &RUNS;
    let mut cases = Vec::new();
    for (run, full_network) in [(wide, fits_the_full_network as fn(&RealRun) -> Outcome), (narrow, repeats_to_the_bit)]
    {
        let needed = Needed::path(&places::shared().join("clips").join(run.clip), "the real clips");
        let name = format!("cli::real_clips::{}", run.clip);
        cases.push(case_if(&needed, format!("{name}::full_network"), move || full_network(run)));
        cases.push(case_if(&needed, name, move || beats_copying(run)));
    }
    cases
}

/// Runs with flags before those of the clip and returns the output directory's page.
fn infer(real: &RealRun, out: &Path, flags: &[&str]) -> Result<Value, Failed> {
    let clip = places::shared().join("clips").join(real.clip);
    let mut arguments = vec![clip.as_os_str(), "--out".as_ref(), out.as_os_str()];
    arguments.extend(flags.iter().chain(real.flags).map(|flag| flag.as_ref() as &std::ffi::OsStr));
    run(&binary("lgs-infer")?, &arguments, places::repository())?.expect_success()?;
    Ok(metrics::read(out)?)
}

/// A step with seeded weights of the paper's size.
const FULL: [&str; 6] = ["--weights", "random:models/full.json", "--refine-steps", "1", "--views", "none"];

/// In bounded memory.
fn fits_the_full_network(real: &RealRun) -> Outcome {
    let place = tempfile::tempdir()?;
    let page = infer(real, place.path(), &FULL)?;
    metrics::expect_network_keys(&page)?;
    let memory = page["peak_rss_mb"].as_f64().unwrap_or(0.0);
    if memory > MAX_MEMORY_MB {
        return Err(format!("peak memory {memory} MB, at most {MAX_MEMORY_MB}").into());
    }
    Ok(())
}

/// The same bytes with one thread and with two, at half the size of its images.
fn repeats_to_the_bit(real: &RealRun) -> Outcome {
    let place = tempfile::tempdir()?;
    let [one, two] = ["1", "2"].map(|threads| (threads, place.path().join(threads)));
    for (threads, out) in [&one, &two] {
        infer(real, out, &[FULL.as_slice(), &["--threads", threads]].concat())?;
    }
    same_results(&one.1, &two.1)
}

fn beats_copying(real: &RealRun) -> Outcome {
    let place = tempfile::tempdir()?;
    let page = infer(real, &place.path().join("out"), &["--weights", "none"])?;
    metrics::expect_promised_keys(&page)?;
    let mean = |figure: &str| metrics::number(&page, &["mean", "held_out", figure]);
    let (psnr, copying) = (mean("psnr")?, mean("psnr_copying")?);
    if psnr > copying { Ok(()) } else { Err(format!("held-out PSNR {psnr} dB, copying {copying} dB").into()) }
}
