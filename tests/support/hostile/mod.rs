//! What bytes from outside are given to: one target per format, shared by the suite and by the fuzzers of `tests/fuzz`.
//!
//! An input is one byte that says which file of a good folder it takes the place of, and the content of that file. With the byte's
//! highest bit set the content is packed first as the file's format asks, so that what lies behind a checksum is reached too.

mod content;
mod mutate;
mod record;

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

pub use mutate::Mutator;

/// Set in the first byte of an input: the content is packed first.
const PACKED: u8 = 0x80;

/// A reader of files from outside, with a folder that it reads without complaint.
#[derive(Clone, Copy, Debug)]
pub struct Target {
    /// Name of the target.
    pub name: &'static str,
    /// Fills an empty folder, the second path; the first is the repository's root.
    pub fill: fn(&Path, &Path) -> Result<(), String>,
    /// Reads the folder and says what was wrong with it, if anything; panics when what was read is not what the reader promises.
    pub read: fn(&Path) -> Result<(), String>,
}

/// The targets of files that hold data.
pub const TARGETS: [Target; 12] = [
    Target { name: "clip", fill: content::fill_clip, read: content::read_clip },
    Target { name: "ply", fill: content::fill_ply, read: content::read_scene },
    Target { name: "targets", fill: content::fill_targets, read: content::read_targets },
    Target { name: "dgp", fill: content::fill_dgp, read: content::read_dgp },
    Target { name: "kitti-raw", fill: content::fill_kitti, read: content::read_kitti },
    Target { name: "av2", fill: content::fill_av2, read: content::read_av2 },
    Target { name: "pandaset", fill: content::fill_pandaset, read: content::read_pandaset },
    Target { name: "nuscenes", fill: content::fill_nuscenes, read: content::read_nuscenes },
    Target { name: "depth", fill: content::fill_depth, read: content::read_depth },
    Target { name: "path", fill: content::fill_path, read: content::read_path },
    Target { name: "waymo", fill: content::fill_waymo, read: content::read_waymo },
    Target { name: "waymo-v2", fill: content::fill_waymo_v2, read: content::read_waymo },
];

/// A target's folder in a temporary place, good but for the file that an input stands for.
#[derive(Debug)]
pub struct Stage {
    place: tempfile::TempDir,
    read: fn(&Path) -> Result<(), String>,
    /// The files, relative to the folder, and their good content.
    files: Vec<(PathBuf, Vec<u8>)>,
}

impl Stage {
    /// The good folder of a target.
    ///
    /// # Errors
    /// When it cannot be made, or the target complains about it.
    pub fn new(target: &Target, repository: &Path) -> Result<Self, String> {
        let said = |e: io::Error| format!("{}: {e}", target.name);
        let place = tempfile::tempdir().map_err(said)?;
        (target.fill)(repository, place.path())?;
        let mut files = Vec::new();
        list(place.path(), Path::new(""), &mut files).map_err(said)?;
        files.sort();
        (target.read)(place.path())?;
        Ok(Self { place, read: target.read, files })
    }

    /// Inputs to start from: every file as it is, and packed ones as what is packed.
    pub fn seeds(&self) -> Vec<Vec<u8>> {
        let mut seeds = Vec::new();
        for (k, (path, content)) in (0_u8..PACKED).zip(&self.files) {
            seeds.push([&[k], content.as_slice()].concat());
            seeds.extend(unpacked(path, content).map(|inner| [&[k | PACKED], inner.as_slice()].concat()));
        }
        seeds
    }

    /// What the target says of an input; the folder is good again afterwards.
    ///
    /// # Errors
    /// What the target found to be wrong; a temporary place that cannot be written to.
    ///
    /// # Panics
    /// When the target breaks a promise.
    pub fn run(&self, input: &[u8]) -> Result<(), String> {
        let Some((&which, content)) = input.split_first() else { return Ok(()) };
        let (path, good) = &self.files[usize::from(which & !PACKED) % self.files.len()];
        let packed = (which & PACKED != 0).then(|| packed(path, content)).flatten();
        let full = self.place.path().join(path);
        let put = |bytes: &[u8]| fs::write(&full, bytes).map_err(|e| format!("{}: {e}", full.display()));
        put(packed.as_deref().unwrap_or(content))?;
        let said = (self.read)(self.place.path());
        put(good)?;
        said
    }
}

fn list(root: &Path, inside: &Path, files: &mut Vec<(PathBuf, Vec<u8>)>) -> io::Result<()> {
    for entry in fs::read_dir(root.join(inside))? {
        let path = inside.join(entry?.file_name());
        if root.join(&path).is_dir() {
            list(root, &path, files)?;
        } else {
            files.push((path.clone(), fs::read(root.join(&path))?));
        }
    }
    Ok(())
}

fn has_end(path: &Path, end: &str) -> bool {
    path.extension().is_some_and(|found| found == end)
}

/// The content as the packed file of this name; `None` for a name that is not of a packed file.
fn packed(path: &Path, content: &[u8]) -> Option<Vec<u8>> {
    if has_end(path, "gz") {
        let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::none());
        gzip.write_all(content).ok()?;
        return gzip.finish().ok();
    }
    if has_end(path, "npz") {
        let mut archive = zip::ZipWriter::new(io::Cursor::new(Vec::new()));
        let stored = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
        archive.start_file("data.npy", stored).ok()?;
        archive.write_all(content).ok()?;
        return Some(archive.finish().ok()?.into_inner());
    }
    has_end(path, "tfrecord").then(|| record::packed(content))
}

/// What a packed file holds.
fn unpacked(path: &Path, content: &[u8]) -> Option<Vec<u8>> {
    let mut inner = Vec::new();
    if has_end(path, "gz") {
        io::Read::read_to_end(&mut flate2::read::MultiGzDecoder::new(content), &mut inner).ok()?;
        return Some(inner);
    }
    if has_end(path, "npz") {
        let mut archive = zip::ZipArchive::new(io::Cursor::new(content)).ok()?;
        io::Read::read_to_end(&mut archive.by_name("data.npy").ok()?, &mut inner).ok()?;
        return Some(inner);
    }
    if has_end(path, "tfrecord") { record::unpacked(content) } else { None }
}
