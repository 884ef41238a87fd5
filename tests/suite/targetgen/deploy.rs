//! The files to edit for clusters: what they run is what the program takes, and exit codes reach the scheduler as they say.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use lgs_tests::pods::{Job, bash, program, with_path};
use lgs_tests::process::binary;
use lgs_tests::{Outcome, case, case_if, clips, places};
use libtest_mimic::Trial;

pub(crate) fn cases() -> Vec<Trial> {
    let bash = bash();
    vec![
        case("targetgen::deploy::counts_and_names_agree", || job("targets-job.yaml")?.expect_counts_and_names()),
        case_if(&bash, "targetgen::deploy::pods_pass_exit_codes_on", exit_codes),
        case_if(&bash, "targetgen::deploy::pods_do_a_whole_job", pods),
        case_if(&bash, "targetgen::deploy::batch_scripts_do_a_whole_job", batch_scripts),
    ]
}

fn deploy(name: &str) -> PathBuf {
    places::repository().join("targetgen/deploy").join(name)
}

fn job(name: &str) -> Result<Job, String> {
    Job::read(&deploy(name), "lgs-targetgen")
}

fn exit_codes() -> Outcome {
    job("targets-job.yaml")?.expect_exit_codes()?;
    job("merge-job.yaml")?.expect_exit_codes()
}

/// A folder with a clip that `clips.txt` names twice.
fn place_of_clips() -> Result<tempfile::TempDir, libtest_mimic::Failed> {
    let place = tempfile::tempdir()?;
    clips::short(&place.path().join("tiny"), 1)?;
    fs::write(place.path().join("clips.txt"), "tiny\ntiny\n")?;
    Ok(place)
}

/// Fails unless the manifest has both clips at the size that was asked for.
fn is_whole(place: &Path) -> Outcome {
    let manifest = fs::read_to_string(place.join("targets/manifest.json"))?;
    if manifest.contains("tiny~2") && manifest.contains("24") { Ok(()) } else { Err(manifest.into()) }
}

fn pods() -> Outcome {
    let place = place_of_clips()?;
    job("targets-job.yaml")?.run(place.path(), &[("--resume", "--resume --image-size 24x40 --rounds 1")])?;
    job("merge-job.yaml")?.run(place.path(), &[])?;
    is_whole(place.path())
}

fn batch_scripts() -> Outcome {
    let place = place_of_clips()?;
    program(place.path(), "lgs-targetgen", &format!("exec {} \"$@\"", binary("lgs-targetgen")?.display()))?;
    let run = |script: &str, task: Option<[&str; 3]>| -> Outcome {
        let mut command = Command::new("bash");
        command.arg(deploy(script)).current_dir(place.path()).env("FLAGS", "--image-size 24x40 --rounds 1");
        if let Some([task, min, count]) = task {
            let array = [("ID", task), ("MIN", min), ("COUNT", count)];
            command.envs(array.map(|(name, value)| (format!("SLURM_ARRAY_TASK_{name}"), value)));
        }
        let output = with_path(&mut command, place.path())?;
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        if output.status.success() {
            Ok(())
        } else {
            Err(format!("{script}: {:?}: {said}", output.status.code()).into())
        }
    };
    run("targets.sbatch", Some(["1", "1", "2"]))?;
    // The second task failed and is submitted alone.
    run("targets.sbatch", Some(["2", "2", "1"]))?;
    run("merge.sbatch", None)?;
    is_whole(place.path())
}
