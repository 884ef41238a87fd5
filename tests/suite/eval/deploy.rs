//! The files to edit for clusters: what they run is what the program takes, and gives what one run gives.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use lgs_tests::pods::{Job, bash, program};
use lgs_tests::process::binary;
use lgs_tests::{Needed, Outcome, case, case_if, clips, places};
use libtest_mimic::{Failed, Trial};

use super::{SMALL, eval, same_product};

pub(crate) fn cases() -> Vec<Trial> {
    let bash = bash();
    vec![
        case("eval::deploy::counts_and_names_agree", || job("eval-job.yaml")?.expect_counts_and_names()),
        case_if(&bash, "eval::deploy::pods_pass_exit_codes_on", exit_codes),
        case_if(&bash, "eval::deploy::pods_do_a_whole_job", pods),
        case_if(&bash, "eval::deploy::batch_scripts_do_a_whole_job", batch_scripts),
        case_if(&slurm(), "eval::deploy::an_array_under_slurm", under_slurm),
    ]
}

fn job(name: &str) -> Result<Job, String> {
    Job::read(&script(name), "lgs-eval")
}

fn exit_codes() -> Outcome {
    job("eval-job.yaml")?.expect_exit_codes()?;
    job("eval-merge-job.yaml")?.expect_exit_codes()
}

fn pods() -> Outcome {
    let place = tempfile::tempdir()?;
    let drives = place.path().join("drives");
    clips::short(&drives.join("tiny"), 5)?;
    let own = format!("own {}", SMALL[2..].join(" "));
    job("eval-job.yaml")?.run(place.path(), &[("pandaset", &own)])?;
    job("eval-merge-job.yaml")?.run(place.path(), &[])?;
    let drives = drives.display().to_string();
    eval(place.path(), &[&[drives.as_str()], SMALL.as_slice(), &["--out", "whole"]].concat())?.expect_success()?;
    same_product(&place.path().join("evaluation"), &place.path().join("whole"))
}

/// A folder with a drive, its list and the program under its name, and the variable of programs in which that comes first.
fn place_of_scripts() -> Result<(tempfile::TempDir, String), Failed> {
    let place = tempfile::tempdir()?;
    clips::short(&place.path().join("tiny"), 5)?;
    fs::write(place.path().join("drives.txt"), "tiny\n")?;
    program(place.path(), "lgs-eval", &format!("exec {} \"$@\"", binary("lgs-eval")?.display()))?;
    let path = format!("{}:{}", place.path().display(), std::env::var("PATH").unwrap_or_default());
    Ok((place, path))
}

fn script(name: &str) -> PathBuf {
    places::repository().join("measure/deploy").join(name)
}

/// Runs a command that goes by the variables of the scripts, to its end.
fn with_variables(command: &mut Command, place: &Path, path: &str) -> Outcome {
    command.current_dir(place).env("PATH", path).env("PROTOCOL", "own").env("FLAGS", SMALL[2..].join(" "));
    let output = command.output()?;
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    if output.status.success() {
        Ok(())
    } else {
        Err(format!("{command:?}: {:?}: {said}", output.status.code()).into())
    }
}

/// Joins the shares, which are to be what one run gives.
fn merged_is_whole(place: &Path, path: &str) -> Outcome {
    with_variables(Command::new("bash").arg(script("eval-merge.sbatch")), place, path)?;
    eval(place, &[&["drives.txt"], SMALL.as_slice(), &["--out", "whole"]].concat())?.expect_success()?;
    same_product(&place.join("evaluation"), &place.join("whole"))
}

fn batch_scripts() -> Outcome {
    let (place, path) = place_of_scripts()?;
    // The second task failed and is submitted alone.
    for [task, min, count] in [["1", "1", "3"], ["3", "1", "3"], ["2", "2", "1"]] {
        let array = [("ID", task), ("MIN", min), ("COUNT", count)];
        let mut command = Command::new("bash");
        command.arg(script("eval.sbatch")).envs(array.map(|(name, value)| (format!("SLURM_ARRAY_TASK_{name}"), value)));
        with_variables(&mut command, place.path(), &path)?;
    }
    merged_is_whole(place.path(), &path)
}

/// Whether a Slurm answers that has nodes.
fn slurm() -> Needed {
    let answer = Command::new("sinfo").args(["--noheader", "--states=idle"]).output();
    if answer.is_ok_and(|answer| answer.status.success() && !answer.stdout.is_empty()) {
        Needed::Here
    } else {
        Needed::Missing("a Slurm with a node that is idle".to_owned())
    }
}

fn under_slurm() -> Outcome {
    let (place, path) = place_of_scripts()?;
    let mut command = Command::new("sbatch");
    with_variables(command.args(["--wait", "--export=ALL"]).arg(script("eval.sbatch")), place.path(), &path)?;
    merged_is_whole(place.path(), &path)
}
