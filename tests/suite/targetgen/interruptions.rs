//! A job that is killed, has no room, or may not write: whole files only, and `--resume` ends with the bytes of an undisturbed run.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use lgs_formats::targets::Shard;
use lgs_tests::process::{Finished, binary, run};
use lgs_tests::random::Random;
use lgs_tests::{Needed, Outcome, case, case_if, clips};
use libtest_mimic::Trial;

use super::job::{SMALL, list, product, same_product, targetgen};

const KILLS: usize = 30;
/// Clips that take little beside the writes that a kill is to hit, and fill more than one shard.
const TINY: [&str; 6] = ["--image-size", "24x40", "--shard-mb", "1", "--rounds", "1"];
const TINY_FRAMES: usize = 2;
const TINY_CLIPS: usize = 12;

pub(crate) fn cases() -> Vec<Trial> {
    let read_only = if can_mount() { Needed::Here } else { Needed::Missing("the right to mount".to_owned()) };
    vec![
        case("targetgen::interruptions::killed_at_30_moments", killed),
        case("targetgen::interruptions::disk_full", disk_full),
        case_if(&read_only, "targetgen::interruptions::read_only", read_only_folder),
    ]
}

/// The undisturbed run of four clips.
fn undisturbed(folder: &Path) -> Result<PathBuf, String> {
    list(folder, 4).map_err(|e| e.to_string())?;
    whole(folder, &SMALL)
}

fn whole(folder: &Path, flags: &[&str]) -> Result<PathBuf, String> {
    let finished = targetgen(folder, &[&["list", "--out", "want"], flags].concat())?;
    match finished.code {
        Some(0) => Ok(folder.join("want")),
        code => Err(format!("exit {code:?}: {}", finished.stderr)),
    }
}

fn killed() -> Outcome {
    let place = tempfile::tempdir()?;
    clips::short(&place.path().join("tiny"), TINY_FRAMES)?;
    fs::write(place.path().join("list"), "tiny\n".repeat(TINY_CLIPS))?;
    let start = Instant::now();
    let want = whole(place.path(), &TINY)?;
    let longest = start.elapsed().mul_f64(0.7);
    if product(&want)?.len() < 3 {
        return Err("one shard: packing is not put to the test".into());
    }
    let out = place.path().join("got");
    let arguments = [&["list", "--out", "got", "--resume"], TINY.as_slice()].concat();
    let mut random = Random::new(17);
    let mut finished = 0;
    for _ in 0..KILLS {
        let mut job = Command::new(binary("lgs-targetgen")?)
            .args(&arguments)
            .current_dir(place.path())
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()?;
        std::thread::sleep(longest.mul_f64(random.uniform(0.0, 1.0)));
        job.kill()?;
        let done = job.wait()?.success();
        whole_files(&out)?;
        if done {
            // It came to its end before: compare, and start anew.
            same_product(&out, &want)?;
            fs::remove_dir_all(&out)?;
            finished += 1;
        }
    }
    targetgen(place.path(), &arguments)?.expect_success()?;
    same_product(&out, &want)?;
    if finished < KILLS / 2 { Ok(()) } else { Err(format!("only {} runs were interrupted", KILLS - finished).into()) }
}

/// Every file under its final name can be read to its end.
fn whole_files(out: &Path) -> Outcome {
    for folder in [out.to_owned(), out.join("clips")] {
        let Ok(entries) = fs::read_dir(&folder) else { continue };
        for path in entries.flatten().map(|entry| entry.path()) {
            if path.extension().is_some_and(|e| e == "safetensors") {
                let shard = Shard::read(&path).map_err(|e| e.to_string())?;
                for name in shard.names() {
                    shard.clip(name).map_err(|e| e.to_string())?;
                }
            }
        }
    }
    Ok(())
}

/// A file system in memory, for as long as this lives.
struct SmallDisk {
    at: PathBuf,
}

impl SmallDisk {
    fn new(at: &Path, options: &str) -> Option<Self> {
        fs::create_dir_all(at).ok()?;
        let mounted = mount(&["-t", "tmpfs", "-o", options, "tmpfs"], at);
        mounted.then(|| Self { at: at.to_owned() })
    }

    fn change(&self, options: &str) -> bool {
        mount(&["-o", &format!("remount,{options}")], &self.at)
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        // what cannot be unmounted goes with the machine
        let _ = Command::new("umount").arg(&self.at).stderr(Stdio::null()).status();
    }
}

fn mount(arguments: &[&str], at: &Path) -> bool {
    let mut command = Command::new("mount");
    command.args(arguments).arg(at).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}

fn can_mount() -> bool {
    tempfile::tempdir().is_ok_and(|place| SmallDisk::new(&place.path().join("disk"), "size=64k").is_some())
}

/// On a disk that holds two clips of four; where nothing can be mounted, with a limit on the size of a file.
fn disk_full() -> Outcome {
    let place = tempfile::tempdir()?;
    let want = undisturbed(place.path())?;
    let arguments = [&["list", "--out", "disk/got", "--resume"], SMALL.as_slice()].concat();
    let disk = SmallDisk::new(&place.path().join("disk"), "size=1m");
    let full = match &disk {
        Some(_) => targetgen(place.path(), &arguments)?,
        None => limited(place.path(), &arguments)?,
    };
    full.expect_one_line_at_the_end(&["disk/got"])?;
    let out = place.path().join("disk/got");
    whole_files(&out)?;
    if let Some(disk) = disk.as_ref().filter(|disk| !disk.change("size=64m")) {
        return Err(format!("{}: cannot be made larger", disk.at.display()).into());
    }
    targetgen(place.path(), &arguments)?.expect_success()?;
    same_product(&out, &want)
}

fn limited(folder: &Path, arguments: &[&str]) -> Result<Finished, String> {
    let program = binary("lgs-targetgen")?;
    let script = "trap '' XFSZ; ulimit -f 500; exec \"$@\"";
    let mut all = vec!["-c".as_ref(), script.as_ref(), "bash".as_ref(), program.as_os_str()];
    all.extend(arguments.iter().map(|a| a.as_ref() as &std::ffi::OsStr));
    run("bash".as_ref(), &all, folder)
}

fn read_only_folder() -> Outcome {
    let place = tempfile::tempdir()?;
    list(place.path(), 1)?;
    let disk = SmallDisk::new(&place.path().join("disk"), "size=8m,ro").ok_or("cannot mount")?;
    let arguments = [&["list", "--out", "disk/got"], SMALL.as_slice()].concat();
    targetgen(place.path(), &arguments)?.expect_refusal(&["disk/got", "Read-only"])?;
    if !disk.change("rw") {
        return Err("cannot be made writable".into());
    }
    targetgen(place.path(), &arguments)?.expect_success()
}
