//! Work that cannot fit into the memory is foreseen, and what is read takes no more than it may.

use std::ffi::OsStr;
use std::fs;
use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use lgs_engine::gaussians::physical::Splat;
use lgs_engine::render::{MemoryEstimate, Pass};
use lgs_engine::views::PinholeView;
use lgs_formats::targets::{MANIFEST_FILE, Manifest};
use lgs_tests::process::{binary, run};
use lgs_tests::{Outcome, clips, layouts};

use super::resources::limited;
use super::tiny::AHEAD;
use super::{Extreme, ensure, failed};
use crate::targetgen::job;

/// Where the system tells what memory a process takes.
const STATUS: &str = "/proc/self/status";
/// Bytes of memory that reading may take beside four times the input.
const BESIDE: u64 = 64 << 20;

pub(super) const CASES: &[Extreme] = &[
    Extreme::new(
        "more_tiles_than_32_bits_count",
        "2000 Gaussians that cover a view of 50000 x 50000 pixels: 10^10 places in tiles",
        "an error that names --image-size before anything is drawn: a count that wraps would draw other Gaussians",
        too_many_tiles,
    )
    .mended(
        "the count wrapped, had the memory held it: now a sample of the Gaussians tells of all before lists are made",
    ),
    Extreme::new(
        "targets_beyond_the_memory",
        "targets from images of 9000 x 9000 for a process of 3 GB",
        "a clip that failed, with a reason that names --image-size",
        targets_beyond,
    )
    .mended("the allocator aborted the job: now each clip is looked at before it is read"),
    Extreme::new(
        "validation_beyond_the_memory",
        "training that validates on images of 9000 x 9000, for a process of 3 GB",
        "one line that names --validation-size",
        validation_beyond,
    )
    .mended("the allocator aborted the process: now each clip is looked at before it is read"),
    Extreme::new(
        "sweep_as_it_is",
        "a DGP sweep of 20 MB, not packed",
        "read in at most 64 MB and four times the file",
        || parsed(&stored(1_250_000)?),
    )
    .needing(STATUS),
    Extreme::new(
        "sweep_that_unfolds_to_the_bound",
        "a DGP sweep of 16 KB that unfolds to just below the bound of 16 MB",
        "read in at most 64 MB and four times the file",
        || parsed(&deflated(1_048_000)?),
    )
    .needing(STATUS)
    .mended("files might unfold to 64 MB, which took 200 MB to read: now to 16 MB and four thirds of their size"),
];

/// Gaussians that each cover all of what is seen.
fn covering(num: usize) -> Vec<Splat> {
    let one = Splat {
        mean: [0.0, 0.0, 1.0],
        quat: [1.0, 0.0, 0.0, 0.0],
        scale: [1e4; 3],
        opacity: 0.9,
        colour: [0.5; 3],
        velocity: [0.0; 3],
        time: 0.0,
    };
    vec![one; num]
}

fn square(side: usize) -> PinholeView {
    let centre = 0.5 * side as f32;
    PinholeView { width: side, height: side, cx: centre, cy: centre, ..AHEAD }
}

fn too_many_tiles() -> Outcome {
    let estimate = MemoryEstimate::of_splats(&covering(2000));
    estimate.check([&AHEAD], Pass::Gradient).map_err(failed)?;
    let Err(error) = estimate.check([&AHEAD, &square(50_000)], Pass::Images) else {
        return Err("it was not refused".into());
    };
    let message = error.to_string();
    ensure(message.starts_with("image-size: expected") && message.contains("2^32"), || message)
}

fn targets_beyond() -> Outcome {
    let place = tempfile::tempdir()?;
    job::list(place.path(), 1)?;
    let flags = ["list", "--out", "out", "--image-size", "9000x9000", "--rounds", "1"].map(OsStr::new);
    let finished = limited("-v 3000000", "lgs-targetgen", &flags, place.path())?;
    ensure(finished.code == Some(1), || format!("exit {:?}: {}", finished.code, finished.stderr))?;
    let manifest = Manifest::read(&place.path().join("out").join(MANIFEST_FILE)).map_err(failed)?;
    let named = manifest.failed.first().is_some_and(|clip| clip.reason.starts_with("image-size: expected"));
    ensure(named && manifest.shards.is_empty(), || format!("{manifest:?}"))
}

fn validation_beyond() -> Outcome {
    let place = tempfile::tempdir()?;
    let (street, config) = (clips::street(), lgs_tests::places::repository().join("models/tiny.json"));
    let mut arguments: Vec<&OsStr> = vec!["backbone".as_ref(), "--config".as_ref(), config.as_os_str()];
    arguments.extend(["--clips".as_ref(), street.as_os_str(), "--validation".as_ref(), street.as_os_str()]);
    arguments.extend(["--validation-size", "9000x9000", "--steps", "1", "--out", "out"].map(OsStr::new));
    let finished = limited("-v 3000000", "lgs-train", &arguments, place.path())?;
    finished.expect_one_line_at_the_end(&["--validation-size", "memory", "MB"])
}

/// The numpy file of so many rows.
fn rows(num: usize, write: &mut impl Write, value: impl Fn(usize) -> f32) -> std::io::Result<()> {
    let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({num}, 4), }}");
    write.write_all(b"\x93NUMPY\x01\x00v\x00")?;
    write.write_all(format!("{header:<117}\n").as_bytes())?;
    let block: Vec<u8> = (0..1000).flat_map(|i| [value(i), 1.0, 2.0, 0.5]).flat_map(f32::to_le_bytes).collect();
    (0..num / 1000).try_for_each(|_| write.write_all(&block))
}

fn archive(method: zip::CompressionMethod, num: usize, value: impl Fn(usize) -> f32) -> std::io::Result<Vec<u8>> {
    let mut archive = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    archive.start_file("data.npy", zip::write::SimpleFileOptions::default().compression_method(method))?;
    rows(num, &mut archive, value)?;
    Ok(archive.finish()?.into_inner())
}

fn stored(num: usize) -> std::io::Result<Vec<u8>> {
    archive(zip::CompressionMethod::Stored, num, |i| 0.01 * i as f32)
}

fn deflated(num: usize) -> std::io::Result<Vec<u8>> {
    archive(zip::CompressionMethod::Deflated, num, |_| 0.0)
}

/// Fails unless a drive with this sweep is imported within the bound of memory.
fn parsed(sweep: &[u8]) -> Outcome {
    let place = tempfile::tempdir()?;
    let source = place.path().join("source");
    clips::copy(&layouts::foreign("dgp")?.path(), &source)?;
    fs::write(source.join("point_cloud/LIDAR/1.npz"), sweep)?;
    let arguments: [&OsStr; 5] =
        ["import".as_ref(), "dgp".as_ref(), source.as_os_str(), "--out".as_ref(), "out".as_ref()];
    run(&binary("lgs-clip")?, &arguments, place.path())?.expect_success()?;
    let written = fs::metadata(place.path().join("out/lidar/0001.bin"))?.len();
    ensure(written > 16_000_000, || format!("a sweep of {written} bytes was written"))?;
    fs::remove_dir_all(place.path().join("out"))?;
    let peak = peak_bytes(&arguments, place.path())?;
    let most = 4 * sweep.len() as u64 + BESIDE;
    ensure(peak > written && peak <= most, || format!("{peak} bytes for an input of {} bytes", sweep.len()))
}

/// The most memory that `lgs-clip` was seen to take.
fn peak_bytes(arguments: &[&OsStr], place: &Path) -> Result<u64, libtest_mimic::Failed> {
    let mut child = Command::new(binary("lgs-clip")?)
        .args(arguments)
        .current_dir(place)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()?;
    let status = format!("/proc/{}/status", child.id());
    let mut peak = None;
    while child.try_wait()?.is_none() {
        let page = fs::read_to_string(&status).unwrap_or_default();
        let line = page.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let kibibytes = line.and_then(|line| line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok());
        peak = peak.max(kibibytes.map(|kibibytes| 1024 * kibibytes));
        std::thread::sleep(Duration::from_micros(500));
    }
    peak.ok_or_else(|| "the process ended before its memory was seen".into())
}
