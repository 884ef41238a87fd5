//! Clip directories: `clip.json` and the files beside it.

use std::{
    fmt::Debug,
    path::{Path, PathBuf},
    sync::Arc,
};

use glam::DVec3;

use crate::{
    camera::{Distortion, Readout},
    clip::{CameraRecord, Clip, LidarRecord, ReturnsRecord},
    clip_json,
    error::{FormatError, Result},
    image::{self, DepthMap, ImageSize, LoadedImage},
    lidar_motion::{self, LidarMotion},
    pose::Pose,
    read::{MAX_DATA_BYTES, read_file},
    returns,
    sweep::{self, Sweep},
    write::write_atomic,
};

/// Name of the file that describes the clip.
pub const CLIP_FILE: &str = "clip.json";
/// Largest `clip.json`, bytes.
pub const MAX_CLIP_BYTES: u64 = 64 << 20;

/// The way from the files of a foreign layout to sweeps, and to images that are part of other files.
pub(crate) trait Decode: Debug + Send + Sync {
    /// The returns of the file `path` in the frame of `record.world_from_lidar`, and their times where it has them.
    ///
    /// # Errors
    /// A file that is not what the layout asks for.
    fn decode(&self, path: &Path, record: &LidarRecord) -> Result<Sweep>;

    /// Whether `file`, relative to the root, is part of another file, which has been looked through.
    fn holds(&self, _file: &Path) -> bool {
        false
    }

    /// The bytes of an image that is part of another file; `None` where it is a file of its own.
    ///
    /// # Errors
    /// A file that is damaged.
    fn image(&self, _file: &Path) -> Result<Option<Vec<u8>>> {
        Ok(None)
    }
}

/// Which files of a clip somebody needs; the default is all of them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Needed {
    /// Indices of frames.
    pub frames: Option<Vec<usize>>,
    /// Names of cameras.
    pub cameras: Option<Vec<String>>,
}

impl Needed {
    /// Whether files of this frame are needed.
    pub fn frame(&self, index: usize) -> bool {
        self.frames.as_ref().is_none_or(|frames| frames.contains(&index))
    }

    /// Whether files of this camera are needed.
    pub fn camera(&self, name: &str) -> bool {
        self.cameras.as_ref().is_none_or(|cameras| cameras.iter().any(|camera| camera == name))
    }
}

/// A clip directory, or a folder of a foreign layout that is read as one (see [`crate::importers`]), whose description
/// was checked and whose files were there, images and native sweeps of the right size, when it was opened. What is part of another file is
/// looked at when it is loaded.
#[derive(Clone, Debug)]
pub struct ClipDir {
    root: PathBuf,
    /// What errors of the description name: `clip.json`, or the folder of a foreign layout.
    described_in: PathBuf,
    clip: Clip,
    /// `None`: the sweeps are native.
    decoder: Option<Arc<dyn Decode>>,
}

impl ClipDir {
    /// The clip of the directory `root`.
    ///
    /// # Errors
    /// A `clip.json` that is missing or not as `lgs-clip/1` asks, a file that it names and that is missing, a sweep
    /// without points or with half a point, a file of another number of returns than its sweep, an image or mask of another size than declared.
    pub fn open(root: &Path) -> Result<Self> {
        Self::open_part(root, &Needed::default())
    }

    /// As [`ClipDir::open`], but files that are not needed may be missing or damaged. Frames keep their indices.
    ///
    /// # Errors
    /// Those of [`ClipDir::open`] for what is needed.
    pub fn open_part(root: &Path, needed: &Needed) -> Result<Self> {
        let file = root.join(CLIP_FILE);
        let clip = clip_json::parse(&file, &read_file(&file, MAX_CLIP_BYTES)?)?;
        Self { root: root.to_owned(), described_in: file, clip, decoder: None }.checked(needed)
    }

    /// The clip that an importer found in the folder `root`.
    ///
    /// # Errors
    /// A clip that `clip.json` could not say; of what is needed, a file that is missing, an image of another size than declared.
    pub(crate) fn foreign(root: &Path, clip: &Clip, decoder: Arc<dyn Decode>, needed: &Needed) -> Result<Self> {
        let clip = clip_json::checked(root, clip)?;
        Self { root: root.to_owned(), described_in: root.to_owned(), clip, decoder: Some(decoder) }.checked(needed)
    }

    fn checked(self, needed: &Needed) -> Result<Self> {
        for (f, frame) in self.clip.frames.iter().enumerate().filter(|(f, _)| needed.frame(*f)) {
            let at = format!("frames[{f}]");
            if !self.holds(&frame.lidar.file) {
                let path = self.existing(&format!("{at}.lidar.file"), &frame.lidar.file)?;
                if self.decoder.is_none() {
                    self.check_returns(&at, sweep::count_returns(&path)?, &frame.lidar.returns)?;
                }
            }
            let cameras = frame.cameras.iter().enumerate();
            for (c, record) in cameras.filter(|(_, record)| needed.camera(&record.camera.name)) {
                self.check_camera(&format!("{at}.cameras[{c}]"), record)?;
            }
        }
        Ok(self)
    }

    /// The same clip, its images taken as rectified, whatever it says of their lenses; those of fisheyes stay what they are.
    #[must_use]
    pub fn without_distortion(mut self) -> Self {
        for record in self.clip.frames.iter_mut().flat_map(|frame| &mut frame.cameras) {
            record.camera.distortion = record.camera.distortion.filter(|lens| matches!(lens, Distortion::Fisheye(_)));
        }
        self
    }

    /// The same clip, a camera mounted otherwise: its pose in the axes of the one that is stated.
    #[must_use]
    pub fn with_mount(mut self, camera: &str, stated_from_found: &Pose) -> Self {
        for record in self.clip.frames.iter_mut().flat_map(|frame| &mut frame.cameras) {
            let own = &mut record.camera;
            if own.name == camera {
                own.world_from_camera = own.world_from_camera * *stated_from_found;
                if let Some(Distortion::Fisheye(lens)) = &mut own.distortion {
                    let turn = Pose::new(lens.fisheye_from_pinhole, DVec3::ZERO);
                    lens.world_from_fisheye = own.world_from_camera * turn.inverse();
                }
            }
        }
        self
    }

    /// The same clip, images of a camera exposed at other moments than its timestamps.
    #[must_use]
    pub fn with_readout(mut self, camera: &str, readout: Readout) -> Self {
        for record in self.clip.frames.iter_mut().flat_map(|frame| &mut frame.cameras) {
            if record.camera.name == camera {
                record.camera.readout = Some(readout);
            }
        }
        self
    }

    /// What `clip.json`, or the foreign layout, says.
    pub fn clip(&self) -> &Clip {
        &self.clip
    }

    /// The clip directory.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// The sweep of a frame, without rows that are no return, all returns in the frame of the `LiDAR` at the sweep's timestamp: where they are not, the motion between the
    /// poses of the clip's frames brings them there.
    ///
    /// # Errors
    /// A frame that the clip does not have; those of [`sweep::read_sweep`], [`returns::read_times`] and [`returns::read_sensors`]; a foreign
    /// sweep that is not what its layout asks for; a motion that no sensor survives.
    pub fn load_sweep(&self, frame: usize) -> Result<Sweep> {
        let frames = &self.clip.frames;
        let record = &frames.get(frame).ok_or_else(|| self.no_such("frames", frame, frames.len()))?.lidar;
        let path = self.root.join(&record.file);
        let sweep = match &self.decoder {
            Some(decoder) => decoder.decode(&path, record)?,
            None => self.native(sweep::read_rows(&path)?, &record.returns)?,
        };
        let sweep = sweep.without_missing(&path)?;
        lidar_motion::placed(&path, sweep, record, &LidarMotion::of(&self.clip, frame))
    }

    /// A native sweep with what stands beside its file.
    fn native(&self, sweep: Sweep, record: &ReturnsRecord) -> Result<Sweep> {
        let count = sweep.points.len();
        let times = record.times.as_ref().map(|file| returns::read_times(&self.root.join(file), count));
        let sensors = record.sensors.as_ref().map(|sensors| {
            returns::read_sensors(&self.root.join(&sensors.file), count, sensors.lidar_from_sensor.len())
        });
        Ok(Sweep { times: times.transpose()?, sensors: sensors.transpose()?, ..sweep })
    }

    fn check_returns(&self, at: &str, count: usize, record: &ReturnsRecord) -> Result<()> {
        if let Some(file) = &record.times {
            returns::check_size(&self.existing(&format!("{at}.lidar.times"), file)?, returns::TIME_BYTES, count)?;
        }
        if let Some(sensors) = &record.sensors {
            returns::check_size(&self.existing(&format!("{at}.lidar.sensors.file"), &sensors.file)?, 1, count)?;
        }
        Ok(())
    }

    /// The image of a camera (by its place in the frame's list): decoded, rectified, and resized to `size` if given.
    ///
    /// # Errors
    /// A frame or camera that the clip does not have; those of [`image::load`].
    pub fn load_image(&self, frame: usize, camera: usize, size: Option<ImageSize>) -> Result<LoadedImage> {
        let record = self.record(frame, camera)?;
        image::load(&self.root, record, &self.image_file(record)?, size)
    }

    /// The bytes of the image file of a record.
    ///
    /// # Errors
    /// A file that is missing or cannot be read.
    pub(crate) fn image_file(&self, record: &CameraRecord) -> Result<Vec<u8>> {
        let inside = self.decoder.as_ref().map_or(Ok(None), |decoder| decoder.image(&record.file))?;
        inside.map_or_else(|| read_file(&self.root.join(&record.file), MAX_DATA_BYTES), Ok)
    }

    /// Whether a file is part of another one.
    fn holds(&self, file: &Path) -> bool {
        self.decoder.as_ref().is_some_and(|decoder| decoder.holds(file))
    }

    /// The depth map of the image that [`ClipDir::load_image`] gives, if the clip has one: rectified, at the same size.
    ///
    /// # Errors
    /// A frame or camera that the clip does not have; those of [`image::load_depth`].
    pub fn load_depth(&self, frame: usize, camera: usize, size: Option<ImageSize>) -> Result<Option<DepthMap>> {
        image::load_depth(&self.root, self.record(frame, camera)?, size)
    }

    fn record(&self, frame: usize, camera: usize) -> Result<&CameraRecord> {
        let frames = &self.clip.frames;
        let cameras = &frames.get(frame).ok_or_else(|| self.no_such("frames", frame, frames.len()))?.cameras;
        let field = || format!("frames[{frame}].cameras");
        cameras.get(camera).ok_or_else(|| self.no_such(&field(), camera, cameras.len()))
    }

    fn no_such(&self, field: &str, index: usize, count: usize) -> FormatError {
        FormatError::invalid(&self.described_in, field, format!("an entry {index}"), format!("{count} entries"))
    }

    /// The path of a file that `clip.json` names, if there is one.
    fn existing(&self, field: &str, file: &Path) -> Result<PathBuf> {
        let path = self.root.join(file);
        match std::fs::metadata(&path) {
            Ok(_) => Ok(path),
            Err(error) => {
                let found = format!("`{}`: {error}", file.display());
                Err(FormatError::invalid(&self.described_in, field, "a file that exists", found))
            }
        }
    }

    fn check_camera(&self, at: &str, record: &CameraRecord) -> Result<()> {
        if !self.holds(&record.file) {
            let path = self.existing(&format!("{at}.file"), &record.file)?;
            image::check_size(&path, &record.camera)?;
        }
        if let Some(mask) = &record.mask {
            image::check_size(&self.existing(&format!("{at}.mask"), mask)?, &record.camera)?;
        }
        if let Some(depth) = &record.depth {
            image::check_depth(&self.existing(&format!("{at}.depth.file"), &depth.file)?, &record.camera)?;
        }
        Ok(())
    }
}

/// Writes the `clip.json` of `clip` into the directory `root`, which must exist.
///
/// # Errors
/// A clip that could not be read back, and a directory that cannot be written to.
pub fn write_clip(root: &Path, clip: &Clip) -> Result<()> {
    let file = root.join(CLIP_FILE);
    let text = clip_json::to_text(&file, clip)?;
    write_atomic(&file, &text)
}

#[cfg(test)]
mod tests;
