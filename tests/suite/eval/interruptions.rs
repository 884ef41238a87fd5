//! A job that is killed, and goes on: the same bytes in the end.

use std::env;
use std::fs;
use std::process::{Command, Stdio};
use std::time::Instant;

use lgs_tests::process::binary;
use lgs_tests::random::Random;
use lgs_tests::{Needed, Outcome, case, case_if, clips};
use libtest_mimic::Trial;

use super::{SMALL, eval, same_product};

pub(crate) fn cases() -> Vec<Trial> {
    let patience = match env::var_os("LGS_PATIENCE") {
        Some(_) => Needed::Here,
        None => Needed::Missing("LGS_PATIENCE to be set, since it takes a minute".to_owned()),
    };
    vec![
        case("eval::interruptions::killed_at_3_moments", || killed(3)),
        case_if(&patience, "eval::interruptions::killed_at_20_moments", || killed(20)),
    ]
}

fn killed(kills: usize) -> Outcome {
    let place = tempfile::tempdir()?;
    clips::short(&place.path().join("tiny"), 5)?;
    fs::write(place.path().join("list"), "tiny\n".repeat(4))?;
    let flags = [&["list"], SMALL.as_slice(), &["--scenes", "--viewer"]].concat();
    let start = Instant::now();
    eval(place.path(), &[flags.as_slice(), &["--out", "want"]].concat())?.expect_success()?;
    let longest = start.elapsed();
    let (out, want) = (place.path().join("got"), place.path().join("want"));
    let resumed = [flags.as_slice(), &["--out", "got", "--resume"]].concat();
    let mut random = Random::new(24);
    let mut interrupted = 0;
    for _ in 0..kills {
        let mut job = Command::new(binary("lgs-eval")?)
            .args(&resumed)
            .current_dir(place.path())
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()?;
        std::thread::sleep(longest.mul_f64(random.uniform(0.0, 0.8)));
        job.kill()?;
        if job.wait()?.success() {
            // It came to its end before: compare, and start anew.
            same_product(&out, &want)?;
            fs::remove_dir_all(&out)?;
        } else {
            interrupted += 1;
        }
    }
    eval(place.path(), &resumed)?.expect_success()?;
    same_product(&out, &want)?;
    if 2 * interrupted >= kills { Ok(()) } else { Err(format!("only {interrupted} runs were interrupted").into()) }
}
