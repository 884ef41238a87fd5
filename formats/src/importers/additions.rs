//! What a user has beside a public data set: masks of the own vehicle, depth maps of a network.

use std::path::{Path, PathBuf};

use crate::{
    clip::{CameraRecord, Clip, DepthKind, DepthRecord},
    error::{FormatError, Result},
    image,
    read::{MAX_DATA_BYTES, read_file},
    write::write_atomic,
};

/// Endings of depth maps.
const DEPTH_ENDINGS: [&str; 2] = ["png", "npy"];

/// Files that a clip gets while it is written; the default is none.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Additions {
    /// Folder of `CAMERA.png`: the mask of all images of a camera.
    pub masks: Option<PathBuf>,
    /// Folder of `FRAME_CAMERA.png` or `.npy`, FRAME of four digits as in the names that images get: depth maps.
    pub depth: Option<DepthFolder>,
}

/// A folder of depth maps.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DepthFolder {
    /// Where it is.
    pub folder: PathBuf,
    /// What its maps say.
    pub kind: DepthKind,
}

impl Additions {
    /// Copies what there is for the images of `clip` to `place`, where its other files lie, and names it in their records.
    ///
    /// # Errors
    /// A folder without a file for any image; a mask or depth map that is damaged or of another size than its image.
    pub(super) fn apply(&self, place: &Path, clip: &mut Clip) -> Result<()> {
        let (mut masks, mut maps, mut wanted) = (0, 0, Vec::new());
        for (f, frame) in clip.frames.iter_mut().enumerate() {
            for record in &mut frame.cameras {
                wanted.push(format!("{f:04}_{}", record.camera.name));
                masks += usize::from(self.add_mask(place, record)?);
                maps += usize::from(self.add_depth(place, f, record)?);
            }
        }
        let stem = wanted.first().map_or("FRAME_CAMERA", String::as_str);
        let name = stem.split_once('_').map_or(stem, |(_, name)| name);
        let missing = |folder: &Path, setting: &'static str, files: String| {
            Err(FormatError::unfit(
                folder,
                setting,
                format!("files named like the clip's images, such as {files}"),
                "none",
            ))
        };
        match (&self.masks, &self.depth) {
            (Some(folder), _) if masks == 0 => missing(folder, "masks", format!("`{name}.png`")),
            (_, Some(maps_of)) if maps == 0 => {
                missing(&maps_of.folder, "depth", format!("`{stem}.png` or `{stem}.npy`"))
            }
            _ => Ok(()),
        }
    }

    /// Whether there is a mask for a record, which then has it.
    fn add_mask(&self, place: &Path, record: &mut CameraRecord) -> Result<bool> {
        let name = &record.camera.name;
        let Some(source) = self.masks.as_ref().map(|folder| folder.join(format!("{name}.png"))).filter(|f| f.exists())
        else {
            return Ok(false);
        };
        let file = PathBuf::from(format!("images/{name}_mask.png"));
        if !place.join(&file).exists() {
            image::check_mask(&source, &record.camera)?;
            write_atomic(&place.join(&file), &read_file(&source, MAX_DATA_BYTES)?)?;
        }
        image::check_size(&place.join(&file), &record.camera)?;
        record.mask = Some(file);
        Ok(true)
    }

    /// Whether there is a depth map for a record, which then has it.
    fn add_depth(&self, place: &Path, frame: usize, record: &mut CameraRecord) -> Result<bool> {
        let Some(DepthFolder { folder, kind }) = &self.depth else { return Ok(false) };
        let stem = format!("{frame:04}_{}", record.camera.name);
        let found = DEPTH_ENDINGS.into_iter().map(|ending| (folder.join(format!("{stem}.{ending}")), ending));
        let Some((source, ending)) = found.into_iter().find(|(source, _)| source.exists()) else { return Ok(false) };
        let depth = Some(DepthRecord { file: source.clone(), kind: *kind });
        image::load_depth(Path::new(""), &CameraRecord { depth, ..record.clone() }, None)?;
        let file = PathBuf::from(format!("images/{stem}_depth.{ending}"));
        write_atomic(&place.join(&file), &read_file(&source, MAX_DATA_BYTES)?)?;
        record.depth = Some(DepthRecord { file, kind: *kind });
        Ok(true)
    }
}
