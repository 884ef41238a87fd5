//! From a folder to a clip: which layout it has, which of its frames and cameras are wanted.

use std::path::Path;

use super::{Layout, Selection, Source, values::entries};
use crate::{
    clip::{Clip, Frame},
    clip_dir::{CLIP_FILE, ClipDir, Needed},
    error::{FormatError, Result},
};

/// The clip of a directory with a `clip.json`, or of a folder of a foreign layout, whichever `path` is.
///
/// # Errors
/// Those of [`ClipDir::open`] and [`open_as`]; a folder of neither kind.
pub fn open(path: &Path) -> Result<ClipDir> {
    open_part(path, &Needed::default())
}

/// As [`open`], but what is not needed may be missing or damaged. Frames keep their indices.
///
/// # Errors
/// Those of [`open`] for what is needed.
pub fn open_part(path: &Path, needed: &Needed) -> Result<ClipDir> {
    open_scene(path, None, needed)
}

/// Names of the scenes or drives of a folder that holds several of them, by which [`open_scene`] opens each; none where it is one clip.
///
/// # Errors
/// A table of scenes that cannot be read.
pub fn scenes(path: &Path) -> Result<Vec<String>> {
    if !path.is_dir() || path.join(CLIP_FILE).exists() {
        return Ok(Vec::new());
    }
    let all = match Layout::ALL.into_iter().find(|layout| layout.is_of(path)) {
        Some(Layout::NuScenes) => super::nuscenes::scenes(path)?,
        Some(Layout::Waymo) => super::waymo::scenes(path)?,
        _ => Vec::new(),
    };
    Ok(if all.len() > 1 { all } else { Vec::new() })
}

/// As [`open_part`], of a folder with several scenes the one of a name.
///
/// # Errors
/// Those of [`open_part`]; no scene of that name.
pub fn open_scene(path: &Path, scene: Option<&str>, needed: &Needed) -> Result<ClipDir> {
    let is_file = path.is_file();
    if is_file && !Layout::Waymo.is_of(path) && !Layout::Waymo.resembles(path) {
        return Err(FormatError::invalid(
            path,
            "layout",
            "a folder, or a file of Waymo's records",
            "a file of something else",
        ));
    }
    if !(path.is_dir() || is_file) || path.join(CLIP_FILE).exists() {
        return ClipDir::open_part(path, needed);
    }
    let all = || Layout::ALL.into_iter();
    let found = match is_file {
        true => Some(Layout::Waymo),
        false => all().find(|layout| layout.is_of(path)).or_else(|| all().find(|layout| layout.resembles(path))),
    };
    let Some(layout) = found else {
        let names = Layout::ALL.map(|layout| layout.to_string()).join(", ");
        let expected = format!("`{CLIP_FILE}` or the files of one of {names}");
        let found = entries(path, &[""])?.into_iter().take(5).collect::<Vec<_>>().join(", ");
        let found = if found.is_empty() { "nothing".to_owned() } else { format!("`{found}`") };
        return Err(FormatError::invalid(path, "layout", expected, found));
    };
    let selection = Selection {
        scene: scene.map(str::to_owned),
        cameras: needed.cameras.clone(),
        frames: needed.frames.clone(),
        ..Selection::default()
    };
    let source = read(layout, path, &selection)?;
    let standing = stand_ins(&source.frames, needed);
    clip_of(path, source, |frames| {
        frames.into_iter().zip(standing).map(|(frame, standing)| frame.or_else(|e| standing.ok_or(e))).collect()
    })
    .and_then(|(source, clip)| ClipDir::foreign(&source.root, &clip, source.decoder, needed))
}

/// The clip of a folder of a foreign layout. Frames are counted anew.
///
/// # Errors
/// A file that is missing, damaged or of another form than the layout's; frames, cameras or a scene that it does not have.
pub fn open_as(layout: Layout, path: &Path, selection: &Selection) -> Result<ClipDir> {
    if let Some(scene) = selection.scene.as_ref().filter(|_| ![Layout::NuScenes, Layout::Waymo].contains(&layout)) {
        let expected = format!("none: a folder of {layout} holds one scene");
        return Err(FormatError::unfit(path, "scene", expected, format!("`{scene}`")));
    }
    if let Some(other) = Layout::ALL.into_iter().find(|other| !layout.is_of(path) && other.is_of(path)) {
        return Err(FormatError::invalid(
            path,
            "layout",
            format!("the files of {layout}"),
            format!("those of {other}"),
        ));
    }
    let source = read(layout, path, selection)?;
    let (source, clip) = clip_of(path, source, |frames| match &selection.frames {
        Some(wanted) => take_frames(path, frames, wanted),
        None => frames.into_iter().collect(),
    })?;
    ClipDir::foreign(&source.root, &clip, source.decoder, &Needed::default())
}

/// The folder as its layout says, once the wanted cameras are there.
fn read(layout: Layout, path: &Path, selection: &Selection) -> Result<Source> {
    let mut source = layout.read(path, selection)?;
    source.cameras.sort_unstable();
    source.cameras.dedup();
    let unknown = |name: &&String| !source.cameras.contains(name);
    if let Some(unknown) = selection.cameras.iter().flatten().find(unknown) {
        let expected = format!("one of {}", source.cameras.join(", "));
        return Err(FormatError::unfit(path, "cameras", expected, format!("`{unknown}`")));
    }
    let unknown = |name: &&String| !source.lidars.contains(name);
    if let Some(unknown) = selection.lidars.iter().flatten().find(unknown) {
        let expected = match source.lidars.as_slice() {
            [] => format!("none: a folder of {layout} has one LiDAR, or returns that tell of none"),
            names => format!("one of {}", names.join(", ")),
        };
        return Err(FormatError::unfit(path, "lidars", expected, format!("`{unknown}`")));
    }
    // Annotations without a single box say nothing: a test split has such tables.
    if source.frames.iter().flatten().all(|frame| frame.boxes.as_ref().is_none_or(Vec::is_empty)) {
        source.frames.iter_mut().flatten().for_each(|frame| frame.boxes = None);
    }
    Ok(source)
}

/// The clip of the frames that `take` makes of the folder's.
fn clip_of(
    path: &Path,
    mut source: Source,
    take: impl FnOnce(Vec<Result<Frame>>) -> Result<Vec<Frame>>,
) -> Result<(Source, Clip)> {
    let frames = take(std::mem::take(&mut source.frames))?;
    if frames.is_empty() {
        return Err(FormatError::invalid(path, "frames", "at least one frame", "none"));
    }
    let clip =
        Clip { name: source.name.clone(), source: source.source.clone(), licence: source.licence.clone(), frames };
    Ok((source, clip))
}

/// `[frames]` what stands for a frame that is not needed where it cannot be read: the sweep of the nearest one that can, without images.
fn stand_ins(frames: &[Result<Frame>], needed: &Needed) -> Vec<Option<Frame>> {
    let good: Vec<(usize, &Frame)> =
        frames.iter().enumerate().filter_map(|(i, f)| Some((i, f.as_ref().ok()?))).collect();
    let nearest_frame = |index: usize| {
        let (_, frame) = good.iter().min_by_key(|(other, _)| other.abs_diff(index))?;
        Some(Frame { lidar: frame.lidar.clone(), cameras: Vec::new(), boxes: None })
    };
    (0..frames.len()).map(|index| if needed.frame(index) { None } else { nearest_frame(index) }).collect()
}

fn take_frames(path: &Path, frames: Vec<Result<Frame>>, wanted: &[usize]) -> Result<Vec<Frame>> {
    let count = frames.len();
    let mut frames: Vec<Option<Result<Frame>>> = frames.into_iter().map(Some).collect();
    let mut taken: Vec<(usize, Frame)> = Vec::with_capacity(wanted.len());
    for &index in wanted {
        let twice = taken.iter().find(|(other, _)| *other == index).map(|(_, frame)| frame.clone());
        let frame = match (twice, frames.get_mut(index).and_then(Option::take)) {
            (Some(frame), _) => frame,
            (None, Some(frame)) => frame?,
            (None, None) => {
                let expected = format!("indices below {count}, the number of frames");
                return Err(FormatError::unfit(path, "frames", expected, index.to_string()));
            }
        };
        taken.push((index, frame));
    }
    Ok(taken.into_iter().map(|(_, frame)| frame).collect())
}
