//! Memory, disk, threads and interruptions; what must be the same however often and on however many threads it is made.

use std::ffi::OsStr;
use std::fs;
use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use lgs_formats::ply::read_ply;
use lgs_tests::process::{Finished, binary, run};
use lgs_tests::sources::all_files;
use lgs_tests::weights::{Heads, SMALL, Weights};
use lgs_tests::{Outcome, clips, layouts, metrics};

use super::{Extreme, ensure, failed};
use crate::targetgen::job::{self, product, targetgen};

pub(super) const CASES: &[Extreme] = &[
    Extreme::new("scenes_of_1_2_3_8_and_64_threads", "a network with set update and refinement on 1, 2, 3, 8, 8 and 64 threads", "the same bytes of scene.ply and, but for costs, of metrics.json", same_scenes),
    Extreme::new("the_shipped_recipe_of_1_2_3_and_8_threads", "the network that ships, its three learned steps and registered motion on 1, 2, 3, 8 and four times again 8 threads", "the same bytes of scene.ply and, but for costs, of metrics.json", same_shipped),
    Extreme::new("shards_of_1_2_3_and_8_threads", "targets of two clips on 1, 2, 3, 8 and again 8 threads", "the same bytes of shards and manifest", same_shards),
    Extreme::new("out_on_a_full_disk", "a disk, or a limit on files, that holds no scene.ply", "one line that names the file; nothing under its name, nothing temporary", full_disk),
    Extreme::new("interrupted_while_writing", "SIGINT and SIGTERM at ten moments from the first file on", "whole files only, nothing temporary, the process ends by the signal", interrupted)
        .mended("a temporary file stayed when the signal came during a write: now the signal waits for the file's name"),
    Extreme::new("images_beyond_the_memory", "images of 9000 x 9000 for a process of 3 GB", "one line that names --image-size, before anything is read; not an abort", images_beyond)
        .mended("the allocator aborted the process after a part of the work: now the least that a run needs is compared with what is free"),
    Extreme::new("gzip_that_unfolds_without_end", "a PandaSet sweep of 300 KB that unfolds to 300 MB, for a process of 260 MB", "one line that names the file and the bound", || {
        unfolding("pandaset", "lidar/01.pkl.gz", "01.pkl.gz", gzip_of_zeros)
    })
    .mended("files were unfolded up to 4 GB: now up to 16 MB and four thirds of their own size"),
    Extreme::new("npz_that_unfolds_without_end", "a DGP sweep of 300 KB that unfolds to 300 MB, for a process of 260 MB", "one line that names the file and the bound", || {
        unfolding("dgp", "point_cloud/LIDAR/1.npz", "1.npz", npz_of_zeros)
    })
    .mended("as for gzip"),
    Extreme::new("png_that_unfolds_without_end", "a depth map of 16 x 12 pixels whose 300 KB unfold to 300 MB, for a process of 260 MB", "read, or one line that names the file: no more is unfolded than its pixels need", png_beyond_its_pixels),
    Extreme::new("array_that_promises_a_memory", "a depth map of 200 bytes whose header promises 10^22 values, for a process of 260 MB", "one line that names the file and the shape that was declared", array_beyond_the_memory),
];

fn infer(place: &Path, out: &str, flags: &[&str]) -> Result<Finished, String> {
    let street = clips::street();
    let mut arguments = vec![street.as_os_str()];
    let common = ["--out", out, "--image-size", "48x80", "--views", "held-out", "--hold-out", "1", "--frames", "0..2"];
    arguments.extend(common.iter().chain(flags).map(|flag| OsStr::new(*flag)));
    run(&binary("lgs-infer")?, &arguments, place)
}

fn same_scenes() -> Outcome {
    let place = tempfile::tempdir()?;
    Weights::seeded(SMALL, 2, Heads { residuals: 1e-4, scores: 1.5 })?.write(&place.path().join("w.safetensors"))?;
    let flags = ["--weights", "w.safetensors", "--density", "policy", "--theta-prune", "0.4", "--theta-add", "0.5"];
    same_bytes(place.path(), &flags, &["1", "2", "3", "8", "8", "64"])
}

fn same_shipped() -> Outcome {
    let place = tempfile::tempdir()?;
    same_bytes(place.path(), &[], &["1", "2", "3", "8", "8"])?;
    let out = place.path().join("out0");
    let cloud = read_ply(&out.join("scene.ply")).map_err(failed)?;
    ensure(cloud.velocities.iter().any(|v| *v != [0.0; 3]), || "no velocity was registered".to_owned())?;
    let steps = &metrics::read(&out)?["network"]["refine"]["steps"];
    ensure(steps.as_u64().is_some_and(|steps| steps > 0), || format!("{steps} learned steps"))
}

/// Fails unless the runs on so many threads write the same bytes.
fn same_bytes(place: &Path, flags: &[&str], threads: &[&str]) -> Outcome {
    let mut first: Option<(Vec<u8>, serde_json::Value)> = None;
    for (k, threads) in threads.iter().enumerate() {
        let out = format!("out{k}");
        infer(place, &out, &[flags, &["--threads", threads]].concat())?.expect_success()?;
        let out = place.join(out);
        let found = (fs::read(out.join("scene.ply"))?, metrics::without_costs(&metrics::read(&out)?));
        let want = first.get_or_insert_with(|| found.clone());
        ensure(*want == found, || format!("run {k}, of {threads} threads, gave other bytes"))?;
    }
    Ok(())
}

fn same_shards() -> Outcome {
    let place = tempfile::tempdir()?;
    job::list(place.path(), 2)?;
    let mut first = None;
    for (k, threads) in ["1", "2", "3", "8", "8"].into_iter().enumerate() {
        let out = format!("out{k}");
        let arguments = [&["list", "--out", &out, "--threads", threads], job::SMALL.as_slice()].concat();
        targetgen(place.path(), &arguments)?.expect_success()?;
        let found = product(&place.path().join(out))?;
        let want = first.get_or_insert_with(|| found.clone());
        ensure(*want == found, || format!("run {k}, of {threads} threads, gave other bytes"))?;
    }
    Ok(())
}

/// Runs a program under a limit of the shell.
pub(super) fn limited(limit: &str, program: &str, arguments: &[&OsStr], place: &Path) -> Result<Finished, String> {
    let program = binary(program)?;
    let script = format!("trap '' XFSZ; ulimit {limit}; exec \"$@\"");
    let mut all: Vec<&OsStr> = vec!["-c".as_ref(), script.as_ref(), "bash".as_ref(), program.as_os_str()];
    all.extend(arguments);
    run("bash".as_ref(), &all, place)
}

fn names(folder: &Path) -> Result<Vec<String>, String> {
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let files = all_files(folder)?;
    Ok(files.iter().map(|file| file.to_string_lossy().into_owned()).collect())
}

fn full_disk() -> Outcome {
    let place = tempfile::tempdir()?;
    let street = clips::street();
    let flags = ["--out", "out", "--image-size", "48x80", "--weights", "none", "--views", "none"];
    let mut arguments = vec![street.as_os_str()];
    arguments.extend(flags.map(OsStr::new));
    let finished = limited("-f 64", "lgs-infer", &arguments, place.path())?;
    finished.expect_refusal(&["scene.ply"])?;
    let left = names(&place.path().join("out"))?;
    ensure(left.is_empty(), || format!("it left {left:?}"))
}

fn interrupted() -> Outcome {
    let mut ended_by_signal = 0;
    for (k, signal) in (0..10_u64).zip(["-INT", "-TERM"].into_iter().cycle()) {
        let place = tempfile::tempdir()?;
        let flags = ["--out", "out", "--image-size", "96x160", "--weights", "none", "--sequence", "60"];
        let mut child = Command::new(binary("lgs-infer")?)
            .arg(clips::street())
            .args(flags)
            .current_dir(place.path())
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()?;
        let (out, start) = (place.path().join("out"), Instant::now());
        while names(&out)?.is_empty() && child.try_wait()?.is_none() && start.elapsed() < Duration::from_secs(60) {
            std::thread::sleep(Duration::from_millis(1));
        }
        std::thread::sleep(Duration::from_millis(2 * k));
        Command::new("kill").args([signal, &child.id().to_string()]).stderr(Stdio::null()).status()?;
        let status = child.wait()?;
        let by_signal = status.code().is_none();
        ended_by_signal += usize::from(by_signal);
        ensure(by_signal || status.success(), || format!("{signal}: {status}"))?;
        whole_files(&out)?;
    }
    ensure(ended_by_signal > 0, || "every run was done before its signal".to_owned())
}

/// Fails unless every file that is there is whole.
fn whole_files(out: &Path) -> Outcome {
    for name in names(out)? {
        let path = out.join(&name);
        ensure(!name.contains(".part"), || format!("{name} was left"))?;
        if name.ends_with("scene.ply") {
            read_ply(&path).map_err(failed)?;
        }
        if name.ends_with(".json") {
            metrics::read(out)?;
        }
        if name.ends_with(".png") {
            image::open(&path)?;
        }
    }
    Ok(())
}

fn images_beyond() -> Outcome {
    let place = tempfile::tempdir()?;
    let street = clips::street();
    let mut arguments = vec![street.as_os_str()];
    arguments.extend(["--out", "out", "--image-size", "9000x9000", "--weights", "none"].map(OsStr::new));
    limited("-v 3000000", "lgs-infer", &arguments, place.path())?.expect_refusal(&["--image-size", "memory", "MB"])?;
    ensure(!place.path().join("out").exists(), || "an output folder".to_owned())
}

const ZEROS: usize = 300_000_000;

fn gzip_of_zeros() -> std::io::Result<Vec<u8>> {
    let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
    zeros(&mut gzip)?;
    gzip.finish()
}

fn npz_of_zeros() -> std::io::Result<Vec<u8>> {
    let mut archive = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    let packed = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Deflated);
    archive.start_file("data.npy", packed)?;
    zeros(&mut archive)?;
    Ok(archive.finish()?.into_inner())
}

fn zeros(to: &mut impl Write) -> std::io::Result<()> {
    let block = vec![0; 1 << 20];
    (0..ZEROS / block.len()).try_for_each(|_| to.write_all(&block))
}

/// A grey PNG of 16 bits whose data go on behind its last pixel.
fn png_of_zeros() -> std::io::Result<Vec<u8>> {
    let mut packed = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
    zeros(&mut packed)?;
    let mut png = b"\x89PNG\r\n\x1a\n".to_vec();
    let header = [&16_u32.to_be_bytes()[..], &12_u32.to_be_bytes(), &[16, 0, 0, 0, 0]].concat();
    for (name, data) in [(b"IHDR", header), (b"IDAT", packed.finish()?), (b"IEND", Vec::new())] {
        let chunk = [name.as_slice(), &data].concat();
        let mut check = flate2::Crc::new();
        check.update(&chunk);
        png.extend(u32::try_from(data.len()).map_err(std::io::Error::other)?.to_be_bytes());
        png.extend(chunk);
        png.extend(check.sum().to_be_bytes());
    }
    Ok(png)
}

/// What an import of the fixture of DGP with this depth map says, within 260 MB.
fn with_depth_map(place: &Path, ending: &str, content: &[u8]) -> Result<Finished, String> {
    let (source, file) = (layouts::foreign("dgp")?.path(), format!("0000_CAMERA_01.{ending}"));
    fs::create_dir(place.join("own"))
        .and_then(|()| fs::write(place.join("own").join(file), content))
        .map_err(|e| e.to_string())?;
    let mut arguments: Vec<&OsStr> = vec!["import".as_ref(), "dgp".as_ref(), source.as_os_str()];
    arguments.extend(["--out", "out", "--depth", "own", "--depth-kind", "relative"].map(OsStr::new));
    limited("-v 260000", "lgs-clip", &arguments, place)
}

fn png_beyond_its_pixels() -> Outcome {
    let place = tempfile::tempdir()?;
    let finished = with_depth_map(place.path(), "png", &png_of_zeros()?)?;
    if finished.code == Some(0) { Ok(()) } else { finished.expect_refusal(&["0000_CAMERA_01.png", "image"]) }
}

fn array_beyond_the_memory() -> Outcome {
    let place = tempfile::tempdir()?;
    let header =
        format!("{:<117}\n", "{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999, 99999999999), }");
    let content = [b"\x93NUMPY\x01\x00v\x00".as_slice(), header.as_bytes(), &[0; 72]].concat();
    with_depth_map(place.path(), "npy", &content)?.expect_refusal(&["0000_CAMERA_01.npy", "depth map"])
}

fn unfolding(layout: &str, file: &str, name: &str, content: fn() -> std::io::Result<Vec<u8>>) -> Outcome {
    let place = tempfile::tempdir()?;
    let source = place.path().join("source");
    clips::copy(&layouts::foreign(layout)?.path(), &source)?;
    let bytes = content()?;
    ensure(bytes.len() < 2_000_000, || format!("{} bytes", bytes.len()))?;
    fs::write(source.join(file), bytes)?;
    let arguments: [&OsStr; 5] =
        ["import".as_ref(), layout.as_ref(), source.as_os_str(), "--out".as_ref(), "out".as_ref()];
    limited("-v 260000", "lgs-clip", &arguments, place.path())?.expect_refusal(&[name, "at most", "unpacked"])?;
    ensure(!place.path().join("out").exists(), || "an output folder".to_owned())
}
