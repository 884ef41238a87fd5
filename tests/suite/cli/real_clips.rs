//! `lgs-infer` on the real clips, where they are.

use lgs_tests::process::{binary, run};
use lgs_tests::{Needed, Outcome, case_if, metrics, places};
use libtest_mimic::Trial;

/// A run on a real clip and what it must reach.
struct RealRun {
    clip: &'static str,
    flags: &'static [&'static str],
    /// Mean held-out PSNR that a crude start reaches, dB.
    floor: f64,
}

const RUNS: [RealRun; 2] = [
    RealRun {
        clip: "ddad_scene_02",
        flags: &["--cameras", "CAMERA_01,CAMERA_05,CAMERA_06", "--image-size", "304x484", "--hold-out", "1"],
        floor: 15.5,
    },
    RealRun { clip: "kitti_sfnd", flags: &["--image-size", "188x621", "--hold-out", "odd"], floor: 16.4 },
];

pub(crate) fn cases() -> Vec<Trial> {
    let case_of = |run: &'static RealRun| {
        let needed = Needed::path(&places::shared().join("clips").join(run.clip), "the real clips");
        case_if(&needed, format!("cli::real_clips::{}", run.clip), || beats_a_crude_start(run))
    };
    RUNS.iter().map(case_of).collect()
}

fn beats_a_crude_start(real: &RealRun) -> Outcome {
    let place = tempfile::tempdir()?;
    let (clip, out) = (places::shared().join("clips").join(real.clip), place.path().join("out"));
    let mut arguments =
        vec![clip.as_os_str(), "--out".as_ref(), out.as_os_str(), "--weights".as_ref(), "none".as_ref()];
    arguments.extend(real.flags.iter().map(|flag| flag.as_ref() as &std::ffi::OsStr));
    run(&binary("lgs-infer")?, &arguments, place.path())?.expect_success()?;
    let page = metrics::read(&out)?;
    metrics::expect_promised_keys(&page)?;
    let psnr = metrics::number(&page, &["mean", "held_out", "psnr"])?;
    if psnr > real.floor { Ok(()) } else { Err(format!("held-out PSNR {psnr} dB, want over {}", real.floor).into()) }
}
