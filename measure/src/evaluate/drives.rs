//! Which drives arguments name, and what they are called.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use lgs_formats::{clip_dir::CLIP_FILE, error::FormatError, importers, importers::Layout};

use crate::error::{MeasureError, Result};

/// Longest name before what tells equal names apart.
const MAX_NAME: usize = 100;
/// Levels of folders that are looked through for drives.
const MOST_LEVELS: usize = 3;
/// What the files of Waymo's first form end in.
const RECORDS: &str = "tfrecord";
/// Numbers of the test logs of `PandaSet`.
///
/// # Source
/// The split of `Flux4D`, after which the paper evaluates.
pub const TEST_LOGS: [u64; 10] = [1, 11, 16, 65, 84, 90, 106, 115, 123, 158];

/// A drive.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Drive {
    /// Its name in results: that of its folder or file, or of its scene, `~2`, `~3`, ... behind it where it was taken.
    pub name: String,
    /// Where it lies.
    pub path: PathBuf,
    /// Its name among the scenes that lie there; `None` where it is the only one.
    pub scene: Option<String>,
}

/// Which drives of a folder of drives are taken.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Logs {
    /// All.
    All,
    /// Those whose names end in one of these numbers.
    Numbers(Vec<u64>),
    /// Those of these names.
    Names(Vec<String>),
}

impl Drive {
    /// The number that its name ends in.
    pub fn number(&self) -> Option<u64> {
        number(&self.name)
    }
}

fn number(name: &str) -> Option<u64> {
    let digits = name.len() - name.trim_end_matches(|c: char| c.is_ascii_digit()).len();
    name[name.len() - digits..].parse().ok()
}

impl Logs {
    fn holds(&self, name: &str) -> bool {
        match self {
            Self::All => true,
            Self::Numbers(numbers) => number(name).is_some_and(|number| numbers.contains(&number)),
            Self::Names(names) => names.iter().any(|wanted| wanted == name),
        }
    }

    fn in_words(&self) -> String {
        match self {
            Self::All => "all".to_owned(),
            Self::Numbers(numbers) => numbers.iter().map(|n| format!("{n:03}")).collect::<Vec<_>>().join(", "),
            Self::Names(names) => names.join(", "),
        }
    }
}

/// The drives that arguments name, in their order: a drive, a folder of drives or of scenes (those of `logs`, in the order of their names or of
/// its table), or a list file with one drive a line, from the list's own folder; empty lines and those that start with `#` do not count.
///
/// # Errors
/// An argument that is none of these, and no drive at all.
pub fn find_drives(arguments: &[PathBuf], logs: &Logs) -> Result<Vec<Drive>> {
    let mut paths = Vec::new();
    for argument in arguments {
        let metadata = fs::metadata(argument).map_err(|e| FormatError::io(argument, "read", e))?;
        if metadata.is_dir() || is_drive(argument) {
            paths.extend(of_place(argument, logs)?);
        } else {
            let text = fs::read_to_string(argument).map_err(|e| FormatError::io(argument, "read", e))?;
            let folder = argument.parent().unwrap_or(Path::new(""));
            let lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
            paths.extend(lines.map(|line| folder.join(line)));
        }
    }
    if paths.is_empty() {
        return Err(MeasureError::unfit("DRIVES", "at least one drive", "none"));
    }
    let mut places = Vec::new();
    for path in paths {
        // What is wrong with a table is said when its drive is opened.
        let scenes = importers::scenes(&path).unwrap_or_default();
        if scenes.is_empty() {
            places.push((path, None));
            continue;
        }
        let count = scenes.len();
        let wanted: Vec<String> = scenes.into_iter().filter(|scene| logs.holds(&plain(scene))).collect();
        if wanted.is_empty() {
            return Err(none_of(logs, count, &path));
        }
        places.extend(wanted.into_iter().map(|scene| (path.clone(), Some(scene))));
    }
    Ok(named(places))
}

fn none_of(logs: &Logs, count: usize, place: &Path) -> MeasureError {
    let found = format!("none of them among the {count} drives of {}", place.display());
    MeasureError::unfit("logs", format!("one of {}", logs.in_words()), found)
}

/// Whether a folder or file is one drive.
fn is_drive(path: &Path) -> bool {
    if path.is_file() {
        return Layout::Waymo.is_of(path) || is_record(path);
    }
    path.join(CLIP_FILE).exists() || (records(path).len() < 2 && Layout::ALL.iter().any(|layout| layout.is_of(path)))
}

fn is_record(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending == RECORDS)
}

fn children(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut all: Vec<PathBuf> = fs::read_dir(folder)?.flatten().map(|entry| entry.path()).collect();
    all.sort();
    Ok(all)
}

fn records(folder: &Path) -> Vec<PathBuf> {
    children(folder).unwrap_or_default().into_iter().filter(|path| is_record(path)).collect()
}

fn of_place(place: &Path, logs: &Logs) -> Result<Vec<PathBuf>> {
    let all = inside(place, MOST_LEVELS)?;
    if all.as_slice() == [place] {
        return Ok(all);
    }
    if all.is_empty() {
        let found = format!("{} with none in it", place.display());
        return Err(MeasureError::unfit("DRIVES", "a drive, a folder of drives or a list file", found));
    }
    let count = all.len();
    let wanted: Vec<PathBuf> = all.into_iter().filter(|path| logs.holds(&plain_name(path))).collect();
    if wanted.is_empty() {
        return Err(none_of(logs, count, place));
    }
    Ok(wanted)
}

/// The drive that a place is, or those in it, at most so many levels down: KITTI has folders of dates with drives.
fn inside(place: &Path, levels: usize) -> Result<Vec<PathBuf>> {
    if place.is_file() || place.join(CLIP_FILE).exists() || levels == 0 {
        return Ok(if is_drive(place) { vec![place.to_owned()] } else { Vec::new() });
    }
    let all = children(place).map_err(|e| FormatError::io(place, "read", e))?;
    let below: Vec<PathBuf> = all.into_iter().filter(|path| is_drive(path)).collect();
    if below.len() < 2 && is_drive(place) {
        let deeper = below.first().map_or(Ok(Vec::new()), |below| inside(below, levels - 1))?;
        return Ok(if deeper.len() > 1 { deeper } else { vec![place.to_owned()] });
    }
    let all: Vec<Vec<PathBuf>> = below.iter().map(|path| inside(path, levels - 1)).collect::<Result<_>>()?;
    Ok(all.concat())
}

/// The name of a folder or file as names of results may be.
fn plain_name(path: &Path) -> String {
    let is_file = path.is_file();
    let name_of = |path: &Path| {
        let name = if is_file { path.file_stem() } else { path.file_name() };
        name.map(|name| name.to_string_lossy().into_owned())
    };
    let name = name_of(path).or_else(|| name_of(&fs::canonicalize(path).ok()?)).unwrap_or_else(|| "drive".to_owned());
    plain(&name)
}

fn plain(name: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() || "._-".contains(c) { c } else { '_' };
    name.chars().map(plain).take(MAX_NAME).collect()
}

fn named(places: Vec<(PathBuf, Option<String>)>) -> Vec<Drive> {
    let mut taken: BTreeMap<String, usize> = BTreeMap::new();
    let name = |(path, scene): (PathBuf, Option<String>)| {
        let base = scene.as_deref().map_or_else(|| plain_name(&path), plain);
        let count = taken.entry(base.clone()).or_insert(0);
        *count += 1;
        let name = if *count == 1 { base } else { format!("{base}~{count}") };
        Drive { name, path, scene }
    };
    places.into_iter().map(name).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_lists_and_records_become_named_drives() {
        let dir = tempfile::tempdir().unwrap();
        for clip in ["all/001", "all/002", "all/pandaset_158", "x y"] {
            fs::create_dir_all(dir.path().join(clip)).unwrap();
            fs::write(dir.path().join(clip).join(CLIP_FILE), "{}").unwrap();
        }
        fs::create_dir(dir.path().join("waymo")).unwrap();
        for record in ["waymo/segment-1_2.tfrecord", "waymo/b.tfrecord"] {
            fs::write(dir.path().join(record), "").unwrap();
        }
        fs::write(dir.path().join("list"), "# comment\n\nx y\n  all/001 \n").unwrap();
        let names = |arguments: &[&str], logs: &Logs| {
            let paths: Vec<PathBuf> = arguments.iter().map(|a| dir.path().join(a)).collect();
            find_drives(&paths, logs).map(|found| found.into_iter().map(|drive| drive.name).collect::<Vec<_>>())
        };
        assert_eq!(names(&["all"], &Logs::All).unwrap(), ["001", "002", "pandaset_158"]);
        assert_eq!(names(&["all"], &Logs::Numbers(TEST_LOGS.to_vec())).unwrap(), ["001", "pandaset_158"]);
        assert_eq!(names(&["all"], &Logs::Names(vec!["002".to_owned()])).unwrap(), ["002"]);
        assert_eq!(
            names(&["all/002"], &Logs::Numbers(TEST_LOGS.to_vec())).unwrap(),
            ["002"],
            "a drive is taken as it is"
        );
        assert_eq!(names(&["waymo"], &Logs::All).unwrap(), ["b", "segment-1_2"]);
        assert_eq!(names(&["list", "all/001"], &Logs::All).unwrap(), ["x_y", "001", "001~2"]);
        for (date, drive) in [("d1", "a"), ("d1", "b"), ("d2", "c")] {
            let date = dir.path().join("kitti").join(date);
            fs::create_dir_all(date.join(drive).join("velodyne_points")).unwrap();
            fs::write(date.join("calib_cam_to_cam.txt"), "").unwrap();
        }
        assert_eq!(names(&["kitti"], &Logs::All).unwrap(), ["a", "b", "d2"], "a folder with one drive is that drive");
        assert_eq!(names(&["kitti/d1"], &Logs::All).unwrap(), ["a", "b"]);
        assert_eq!(names(&["kitti/d1/a", "kitti/d2"], &Logs::All).unwrap(), ["a", "d2"]);
        let message = names(&["all"], &Logs::Names(vec!["7".to_owned()])).unwrap_err().to_string();
        assert!(message.starts_with("logs: expected one of 7, found none of them among the 3 drives"), "{message}");
        fs::create_dir(dir.path().join("empty")).unwrap();
        let message = names(&["empty"], &Logs::All).unwrap_err().to_string();
        assert!(message.starts_with("DRIVES: expected a drive, a folder of drives"), "{message}");
        assert!(names(&["nowhere"], &Logs::All).is_err() && names(&[], &Logs::All).is_err());
    }
}
