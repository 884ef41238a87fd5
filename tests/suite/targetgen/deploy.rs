//! The files to edit for clusters: what they run is what the program takes, and exit codes reach the scheduler as they say.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use lgs_tests::process::binary;
use lgs_tests::{Needed, Outcome, case, case_if, clips, places};
use libtest_mimic::Trial;

pub(crate) fn cases() -> Vec<Trial> {
    let bash = if Command::new("bash").arg("-c").arg("true").status().is_ok_and(|status| status.success()) {
        Needed::Here
    } else {
        Needed::Missing("bash".to_owned())
    };
    vec![
        case("targetgen::deploy::counts_and_names_agree", counts_and_names),
        case_if(&bash, "targetgen::deploy::pods_pass_exit_codes_on", exit_codes),
        case_if(&bash, "targetgen::deploy::batch_scripts_do_a_whole_job", batch_scripts),
    ]
}

fn deploy(name: &str) -> PathBuf {
    places::repository().join("targetgen/deploy").join(name)
}

fn read(name: &str) -> Result<String, String> {
    fs::read_to_string(deploy(name)).map_err(|e| format!("{name}: {e}"))
}

/// What stands behind the first `key: ` of a file, without a comment and quotes.
fn value<'a>(text: &'a str, key: &str) -> Result<&'a str, String> {
    let line =
        text.lines().find_map(|line| line.trim_start_matches([' ', '-', '{']).strip_prefix(key)?.strip_prefix(": "));
    line.map(str::trim).ok_or_else(|| format!("no {key}"))
}

fn counts_and_names() -> Outcome {
    let job = read("targets-job.yaml")?;
    let completions = value(&job, "completions")?;
    let told = format!("name: JOB_COMPLETIONS, value: \"{completions}\"");
    let containers = job.split_once("containers:").ok_or("no containers")?.1;
    let container = format!("containerName: {},", value(containers, "name")?);
    for (name, wanted) in [("the count in the environment", &told), ("the container of the policy", &container)] {
        if !job.contains(wanted.as_str()) {
            return Err(format!("{name}: {wanted} is missing").into());
        }
    }
    Ok(())
}

/// A folder with a program of a name in it that does what `script` says.
fn program(folder: &Path, name: &str, script: &str) -> std::io::Result<()> {
    let path = folder.join(name);
    fs::write(&path, format!("#!/bin/sh\n{script}\n"))?;
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755))?;
    }
    Ok(())
}

/// Runs with a folder's programs before all others.
fn with_path(command: &mut Command, folder: &Path) -> std::io::Result<Output> {
    let old = std::env::var("PATH").unwrap_or_default();
    command.env("PATH", format!("{}:{old}", folder.display())).output()
}

/// Clips that failed (1) are no failure of the pod; an error (2) is, under its own code.
fn exit_codes() -> Outcome {
    let place = tempfile::tempdir()?;
    for file in ["targets-job.yaml", "merge-job.yaml"] {
        let text = read(file)?;
        let shell = value(&text, "args")?.trim_matches(['[', ']', '"']).to_owned();
        for (own, want) in [(0, 0), (1, 0), (2, 2), (137, 137)] {
            program(place.path(), "lgs-targetgen", &format!("exit {own}"))?;
            let got = with_path(Command::new("sh").args(["-c", &shell]), place.path())?.status.code();
            if got != Some(want) {
                return Err(format!("{file}: exit {own} of the program became {got:?}, want {want}").into());
            }
        }
    }
    Ok(())
}

fn batch_scripts() -> Outcome {
    let place = tempfile::tempdir()?;
    clips::short(&place.path().join("tiny"), 1)?;
    fs::write(place.path().join("clips.txt"), "tiny\ntiny\n")?;
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
    let manifest = fs::read_to_string(place.path().join("targets/manifest.json"))?;
    if manifest.contains("tiny~2") && manifest.contains("24") { Ok(()) } else { Err(manifest.into()) }
}
