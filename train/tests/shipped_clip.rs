//! The clip in `clips/street` is what its documented command makes, byte for byte, and the program keeps its promises.

use std::{
    fs, io,
    path::{Path, PathBuf},
    process::{Command, Output},
};

fn program(args: &[&str], dir: &Path) -> io::Result<Output> {
    Command::new(env!("CARGO_BIN_EXE_lgs-train")).args(args).current_dir(dir).output()
}

fn shipped() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../clips/street")
}

/// Files below `dir` with their bytes, by relative path.
fn contents(dir: &Path) -> io::Result<Vec<(PathBuf, Vec<u8>)>> {
    let mut pending = vec![dir.to_owned()];
    let mut files = Vec::new();
    while let Some(folder) = pending.pop() {
        for entry in fs::read_dir(folder)? {
            let path = entry?.path();
            if path.is_dir() {
                pending.push(path);
            } else {
                let bytes = fs::read(&path)?;
                let relative = path.strip_prefix(dir).map_err(io::Error::other)?;
                files.push((relative.to_owned(), bytes));
            }
        }
    }
    files.sort();
    Ok(files)
}

/// The arguments of the command in the clip's README.
fn documented_command() -> io::Result<Vec<String>> {
    let readme = fs::read_to_string(shipped().join("README.md"))?;
    let line = readme.lines().find_map(|line| line.split_once("--bin lgs-train -- "));
    let (_, flags) = line.ok_or_else(|| io::Error::other("no command in the clip's README"))?;
    Ok(flags.split_whitespace().map(str::to_owned).collect())
}

#[test]
fn the_documented_command_makes_the_shipped_clip() {
    let out = tempfile::tempdir().unwrap();
    let command = documented_command().unwrap();
    let args: Vec<&str> = command.iter().map(String::as_str).collect();
    for threads in ["1", "2"] {
        let folder = out.path().join(threads);
        fs::create_dir(&folder).unwrap();
        let made = program(&[args.as_slice(), &["--threads", threads]].concat(), &folder).unwrap();
        assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
        let written: PathBuf = fs::read_dir(folder.join("out")).unwrap().next().unwrap().unwrap().path();
        assert_eq!(written.file_name().unwrap(), "street");
        let (made, mut kept) = (contents(&written).unwrap(), contents(&shipped()).unwrap());
        kept.retain(|(path, _)| path != Path::new("README.md"));
        let names = |files: &[(PathBuf, Vec<u8>)]| files.iter().map(|(path, _)| path.clone()).collect::<Vec<_>>();
        assert_eq!(names(&made), names(&kept));
        for ((path, made), (_, kept)) in made.iter().zip(&kept) {
            assert!(made == kept, "{} differs from the shipped file", path.display());
        }
    }
}

#[test]
fn the_shipped_clip_is_small_and_valid() {
    let bytes: usize = contents(&shipped()).unwrap().iter().map(|(_, bytes)| bytes.len()).sum();
    assert!(bytes < 700_000, "{bytes} bytes");
    let dir = lgs_formats::clip_dir::ClipDir::open(&shipped()).unwrap();
    assert_eq!(dir.clip().licence, "MIT OR Apache-2.0");
    assert_eq!(dir.clip().name, "street");
}

#[test]
fn errors_are_one_line_and_leave_nothing() {
    let out = tempfile::tempdir().unwrap();
    fs::create_dir_all(out.path().join("full/train-000001")).unwrap();
    fs::write(out.path().join("full/train-000001/kept"), "kept").unwrap();
    let cases: [(&[&str], &str); 5] = [
        (&[], "expected a command"),
        (&["scenes", "--out", "full", "--count", "2", "--seed", "0"], "train-000001: expected a directory that"),
        (&["scenes", "--out", "new", "--frames", "0"], "num_frames: expected 1..=1000, found 0"),
        (&["scenes", "--out", "new", "--cameras", "7"], "--cameras"),
        (&["scenes", "--out", "new", "--name", "a", "--count", "2"], "--name: expected --count 1"),
    ];
    for (args, expected) in cases {
        let output = program(args, out.path()).unwrap();
        let line = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{args:?}");
        assert!(line.starts_with("lgs-train: ") && line.lines().count() == 1 && line.contains(expected), "{line}");
        assert!(output.stdout.is_empty());
    }
    assert_eq!(contents(out.path()).unwrap().len(), 1, "an error wrote files");
}

#[test]
fn the_summary_counts_what_was_written() {
    let out = tempfile::tempdir().unwrap();
    let flags = "scenes --out made --count 2 --seed 5 --split test --frames 1 --cameras 2 --image-size 16x24 \
                 --beams 4 --azimuths 60 --images jpeg:70 --masks --json";
    let args: Vec<&str> = flags.split_whitespace().collect();
    let output = program(&args, out.path()).unwrap();
    let summary: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((summary["frames"].as_u64(), summary["images"].as_u64()), (Some(2), Some(4)));
    for name in ["test-000005", "test-000006"] {
        let dir = lgs_formats::clip_dir::ClipDir::open(&out.path().join("made").join(name)).unwrap();
        let image = dir.load_image(0, 1, None).unwrap();
        assert_eq!((image.rgb.height, image.rgb.width), (16, 24));
        assert!(image.labels.is_some());
    }
}
