//! Scenes as `lgs-clip/1` directories.

use std::path::{Path, PathBuf};

use image::{ExtendedColorType, ImageEncoder, codecs::jpeg::JpegEncoder};
use lgs_formats::{
    clip::{CameraRecord, Clip, Compensation, Frame, LidarRecord, ReturnsRecord},
    clip_dir,
    error::FormatError,
    image::{RgbImage, to_byte, write_mask, write_png},
    returns::write_times,
    sweep,
    write::write_atomic,
};

use super::{
    camera::Capture,
    depth_map::{self, DepthMaps},
    scene::Scene,
};
use crate::error::{Result, TrainError};

/// Terms under which the made clips may be used.
pub const LICENCE: &str = "MIT OR Apache-2.0";

/// How images are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImageFormat {
    /// Without loss.
    Png,
    /// With loss, at a quality of 1..=100.
    Jpeg(u8),
}

impl ImageFormat {
    const fn extension(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Jpeg(_) => "jpg",
        }
    }
}

/// What an exported clip is called and holds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Export {
    /// Name of the clip.
    pub name: String,
    /// How images are stored.
    pub images: ImageFormat,
    /// Whether masks of moving pixels are written.
    pub masks: bool,
    /// Which depth maps are written, if any.
    pub depth: Option<DepthMaps>,
}

/// What was written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Written {
    /// Timestamps.
    pub frames: usize,
    /// Images of all cameras.
    pub images: usize,
    /// LiDAR points.
    pub points: usize,
}

/// What was written: the clip as the new directory `dir`.
///
/// The clip is written beside `dir` under another name and renamed when it is complete, so that `dir` never holds a
/// part of a clip. `progress` is called after each image.
///
/// # Errors
/// `dir` exists and is not empty; the directory cannot be written to.
pub fn write(scene: &Scene, dir: &Path, export: &Export, progress: &dyn Fn()) -> Result<Written> {
    require_vacant(dir)?;
    let parent = match dir.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    std::fs::create_dir_all(parent).map_err(|e| FormatError::io(parent, "create", e))?;
    let staging = tempfile::Builder::new()
        .prefix(".lgs-scene-")
        .tempdir_in(parent)
        .map_err(|e| FormatError::io(parent, "create a directory in", e))?;
    let root = staging.path().join("clip");
    let create = |path: &Path| std::fs::create_dir(path).map_err(|e| FormatError::io(path, "create", e));
    create(&root)?;
    for folder in
        ["lidar", "images"].into_iter().chain(export.masks.then_some("masks")).chain(export.depth.map(|_| "depth"))
    {
        create(&root.join(folder))?;
    }
    let mut written = Written::default();
    let mut frames = Vec::new();
    for index in 0..scene.config().num_frames {
        frames.push(write_frame(scene, &root, export, index, &mut written, progress)?);
    }
    let clip = Clip {
        name: export.name.clone(),
        source: format!("procedural, made by lgs-train, scene seed {}", scene.config().seed),
        licence: LICENCE.to_owned(),
        frames,
    };
    clip_dir::write_clip(&root, &clip)?;
    if dir.exists() {
        std::fs::remove_dir(dir).map_err(|e| FormatError::io(dir, "replace", e))?;
    }
    std::fs::rename(&root, dir).map_err(|e| FormatError::io(dir, "rename to", e))?;
    Ok(written)
}

/// Fails unless `dir` may be written: it does not exist, or is an empty directory.
///
/// # Errors
/// [`TrainError::NotEmpty`], or the directory cannot be read.
pub fn require_vacant(dir: &Path) -> Result<()> {
    match std::fs::read_dir(dir) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(()),
        Err(e) => Err(FormatError::io(dir, "read", e).into()),
        Ok(mut entries) => match entries.next() {
            None => Ok(()),
            Some(_) => Err(TrainError::NotEmpty { dir: dir.to_owned() }),
        },
    }
}

fn write_frame(
    scene: &Scene,
    root: &Path,
    export: &Export,
    index: usize,
    written: &mut Written,
    progress: &dyn Fn(),
) -> Result<Frame> {
    let file = PathBuf::from(format!("lidar/{index:04}.bin"));
    let scan = scene.scan(index);
    sweep::write_sweep(&root.join(&file), &scan.sweep)?;
    let mut lidar = LidarRecord::new(file, scene.lidar_timestamp(index), scene.world_from_lidar(index));
    if let Some(times) = &scan.sweep.times {
        let file = PathBuf::from(format!("lidar/{index:04}.times"));
        write_times(&root.join(&file), times)?;
        let compensated = scene.config().rig.lidar.compensated;
        let compensation = if compensated { Compensation::To(0.0) } else { Compensation::None };
        lidar.returns = ReturnsRecord { times: Some(file), compensation, sensors: None };
    }
    let mut cameras = Vec::new();
    for k in 0..scene.config().rig.cameras.len() {
        let (camera, capture) = (scene.camera(index, k), scene.capture(index, k));
        let stem = format!("{index:04}_{}", camera.name);
        let file = PathBuf::from(format!("images/{stem}.{}", export.images.extension()));
        write_image(&root.join(&file), &capture.rgb, export.images)?;
        let mask = export.masks.then(|| PathBuf::from(format!("masks/{stem}.png")));
        if let Some(mask) = &mask {
            let Capture { rgb, labels, .. } = &capture;
            write_mask(&root.join(mask), rgb.width, rgb.height, labels)?;
        }
        let number = (index * scene.config().rig.cameras.len() + k) as u64;
        let depth =
            export.depth.map(|maps| depth_map::write(maps, &capture, root, &stem, [scene.config().seed, number]));
        cameras.push(CameraRecord { file, mask, depth: depth.transpose()?, camera });
        progress();
    }
    written.frames += 1;
    written.images += cameras.len();
    written.points += scan.sweep.points.len();
    Ok(Frame { lidar, cameras, boxes: Some(scene.boxes(index)) })
}

fn write_image(path: &Path, image: &RgbImage, format: ImageFormat) -> Result<()> {
    let ImageFormat::Jpeg(quality) = format else { return Ok(write_png(path, image)?) };
    let encode_error = |reason: String| TrainError::Encode { file: path.to_owned(), reason };
    let size = |pixels: usize| u32::try_from(pixels).map_err(|e| encode_error(e.to_string()));
    let bytes: Vec<u8> = image.data.iter().map(|&v| to_byte(v)).collect();
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, quality)
        .write_image(&bytes, size(image.width)?, size(image.height)?, ExtendedColorType::Rgb8)
        .map_err(|e| encode_error(e.to_string()))?;
    Ok(write_atomic(path, &jpeg)?)
}
