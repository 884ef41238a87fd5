//! Flags that do not fit: one line, exit code 2, nothing written.

use lgs_tests::process::{binary, run};
use lgs_tests::{Outcome, case, clips};
use libtest_mimic::Trial;

/// Flags that must be refused, and what the message must hold.
const REFUSED: [(&str, &[&str], &[&str]); 23] = [
    ("unknown_flag", &["--no-such-flag"], &["--no-such-flag"]),
    ("unknown_camera", &["--cameras", "rear_window"], &["--cameras", "rear_window"]),
    ("hold_out_beyond_the_clip", &["--hold-out", "999"], &["--hold-out", "999"]),
    ("hold_out_is_no_list", &["--hold-out", "even"], &["--hold-out", "even"]),
    ("hold_out_every_zero", &["--hold-out", "every:0"], &["--hold-out", "every:0"]),
    ("frame_beyond_the_clip", &["--frames", "0,999"], &["--frames", "999"]),
    ("size_of_one_number", &["--image-size", "100"], &["--image-size", "100"]),
    ("size_of_zero", &["--image-size", "0x64"], &["--image-size", "0x64"]),
    ("size_without_limit", &["--image-size", "4000000000x4000000000"], &["--image-size", "4000000000x4000000000"]),
    ("no_threads", &["--threads", "0"], &["--threads", "0"]),
    ("unknown_background", &["--background", "green"], &["--background", "green"]),
    ("unknown_density", &["--density", "half"], &["--density", "half"]),
    ("threshold_over_one", &["--theta-prune", "1.5"], &["--theta-prune", "1.5"]),
    ("threshold_that_is_no_number", &["--theta-add", "NaN"], &["--theta-add", "NaN"]),
    ("negative_budget", &["--max-gaussians", "-1"], &["-1"]),
    ("budget_without_a_network", &["--max-gaussians", "10"], &["--max-gaussians", "--weights"]),
    ("steps_without_end", &["--refine-steps", "1000000"], &["--refine-steps", "1000000"]),
    ("refinement_of_no_views", &["--refine-views", "0"], &["--refine-views", "0"]),
    ("pixels_too_far_apart", &["--pixel-stride", "65"], &["--pixel-stride", "65"]),
    ("unknown_refiner", &["--refine-with", "sgd:3"], &["--refine-with", "sgd:3"]),
    ("spacetime_of_one_moment", &["--stg", "--frames", "0", "--cameras", "front"], &["--stg", "one moment"]),
    ("sequence_at_no_rate", &["--sequence", "0"], &["--sequence", "0"]),
    ("missing_lpips_weights", &["--lpips-weights", "nowhere.safetensors"], &["nowhere.safetensors"]),
];

pub(crate) fn cases() -> Vec<Trial> {
    let refused =
        REFUSED.iter().map(|(name, flags, names)| case(format!("cli::flags::{name}"), || refuses(flags, names)));
    refused
        .chain([case("cli::flags::no_clip", no_clip), case("cli::flags::help_and_version", help_and_version)])
        .collect()
}

fn refuses(flags: &[&str], names: &[&str]) -> Outcome {
    let place = tempfile::tempdir()?;
    let out = place.path().join("out");
    let street = clips::street();
    let mut arguments =
        vec![street.as_os_str(), "--out".as_ref(), out.as_os_str(), "--weights".as_ref(), "none".as_ref()];
    arguments.extend(flags.iter().map(|flag| flag.as_ref() as &std::ffi::OsStr));
    run(&binary("lgs-infer")?, &arguments, place.path())?.expect_refusal(names)?;
    if out.exists() { Err("the refused run left an output directory".into()) } else { Ok(()) }
}

fn no_clip() -> Outcome {
    let place = tempfile::tempdir()?;
    let no_arguments: [&str; 0] = [];
    run(&binary("lgs-infer")?, &no_arguments, place.path())?.expect_refusal(&["CLIP_DIR"])
}

fn help_and_version() -> Outcome {
    let place = tempfile::tempdir()?;
    let help = run(&binary("lgs-infer")?, &["--help"], place.path())?;
    help.expect_success()?;
    let promised = [
        "--out",
        "--weights",
        "--describe",
        "--refine-steps",
        "--refine-with",
        "--refine-views",
        "--pixel-stride",
        "--query",
        "--density",
        "--theta-prune",
        "--theta-add",
        "--max-gaussians",
        "--cameras",
        "--image-size",
        "--frames",
        "--hold-out",
        "--background",
        "--views",
        "--at-time",
        "--lpips-weights",
        "--threads",
        "--seed",
        "--json",
    ];
    let missing: Vec<_> = promised.iter().filter(|flag| !help.stdout.contains(**flag)).collect();
    if !missing.is_empty() {
        return Err(format!("--help does not name {missing:?}").into());
    }
    let version = run(&binary("lgs-infer")?, &["--version"], place.path())?;
    version.expect_success()?;
    if version.stdout.contains(env!("CARGO_PKG_VERSION")) { Ok(()) } else { Err(version.stdout.into()) }
}
