//! Whether a run can fit into the memory that there is, before it begins.

use lgs_formats::{clip_dir::ClipDir, sweep::count_returns};

use crate::{
    allocator::available_for,
    error::{EngineError, Result},
    network::{config::ModelConfig, guide::refine_inputs},
    views::Selection,
};

/// Bytes of a pixel of a loaded image: three values.
const IMAGE_PIXEL: u64 = 12;
/// Bytes of a pixel of the view that is being drawn: six planes of tiles, five of images, three of gradients.
const DRAWN_PIXEL: u64 = 4 * (6 + 5 + 3);
/// Bytes of a return: position, origin, time, frame, velocity, thing, colour, and its share of the search for neighbours.
const RETURN: u64 = 12 + 12 + 4 + 4 + 12 + 4 + 16 + 28;

/// Bytes of a Gaussian whose gradient is taken: its values and those before the step, its splat, its place in the lists of tiles, sums of
/// gradients in f64 and f32.
const REFINED: u64 = 800;
/// Bytes of a Gaussian beside them while per-scene optimisation runs: two moments of 17 values.
const MOMENTS: u64 = 2 * 17 * 4;

/// Names of the settings that lower what a run needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MemorySettings {
    /// Of the images, and of the background that is made of them.
    pub images: &'static str,
    /// Of the returns.
    pub returns: &'static str,
}

impl Default for MemorySettings {
    /// Those of a run of a whole clip.
    fn default() -> Self {
        Self { images: "image-size", returns: "frames" }
    }
}

/// What a run surely needs at one time, bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Need {
    /// Number of images.
    pub images: usize,
    /// Of the images.
    pub image_bytes: u64,
    /// Number of returns of the input sweeps.
    pub returns: u64,
    /// Of the returns.
    pub return_bytes: u64,
}

impl Need {
    /// Of images of these sizes `[H, W]`, and of so many returns.
    pub fn of(sizes: &[[usize; 2]], returns: u64) -> Self {
        let pixels = |[height, width]: &[usize; 2]| (*height as u64).saturating_mul(*width as u64);
        let all = sizes.iter().map(pixels).fold(0, u64::saturating_add);
        let largest = sizes.iter().map(pixels).max().unwrap_or(0);
        let drawn = largest.saturating_mul(DRAWN_PIXEL);
        Self {
            images: sizes.len(),
            image_bytes: all.saturating_mul(IMAGE_PIXEL).saturating_add(drawn),
            returns,
            return_bytes: returns.saturating_mul(RETURN),
        }
    }

    const fn total(&self) -> u64 {
        self.image_bytes.saturating_add(self.return_bytes)
    }

    /// Fails when `available` bytes are not enough.
    ///
    /// # Errors
    /// [`EngineError::TooLarge`] with the setting that lowers the larger part.
    pub fn check(&self, available: u64, settings: MemorySettings) -> Result<()> {
        let total = self.total();
        if total <= available {
            return Ok(());
        }
        let (setting, found) = if self.image_bytes >= self.return_bytes {
            (settings.images, format!("{} images", self.images))
        } else {
            (settings.returns, format!("{} returns", self.returns))
        };
        Err(EngineError::TooLarge { setting, what: "work that fits", found, need: total, free: available })
    }
}

/// Fails when the images and sweeps of a selection cannot fit into the memory that is free; what is not known counts as enough.
///
/// # Errors
/// Those of the selection and of [`Need::check`].
pub(crate) fn check_memory(dir: &ClipDir, selection: &Selection, settings: MemorySettings) -> Result<()> {
    let sizes = selection.sizes(dir.clip())?;
    let sweeps = selection.frames(dir.clip())?.input.into_iter();
    let files = sweeps.filter_map(|frame| dir.clip().frames.get(frame)).map(|f| dir.root().join(&f.lidar.file));
    // Foreign sweeps say how many returns they hold when they are read, and count as none.
    let returns = files.filter_map(|file| count_returns(&file).ok()).map(|count| count as u64).sum();
    let need = Need::of(&sizes, returns);
    available_for(need.total()).map_or(Ok(()), |available| need.check(available, settings))
}

/// Bytes of a Gaussian while a network of this config refines it: rows of inputs and features, twice while they are gathered, and of a
/// hidden layer.
fn refined_by(config: &ModelConfig) -> u64 {
    let features = config.unet.decoder.last().copied().unwrap_or(0);
    let values = 2 * (refine_inputs(config.guidance, true) + features) + config.head_width.unwrap_or(0);
    REFINED + 4 * values as u64
}

/// Fails when so many Gaussians of the `LiDAR` branch and of the background cannot be refined in the memory that is free, by a network or
/// (`None`) by per-scene optimisation; what is not known counts as enough.
///
/// # Errors
/// [`EngineError::TooLarge`] with the setting that lowers the larger branch.
pub fn check_refinement(gaussians: [usize; 2], config: Option<&ModelConfig>, settings: MemorySettings) -> Result<()> {
    let need = refinement_bytes(gaussians, config);
    available_for(need).map_or(Ok(()), |available| check_gaussians(gaussians, need, available, settings))
}

fn refinement_bytes([lidar, background]: [usize; 2], config: Option<&ModelConfig>) -> u64 {
    let each = config.map_or(REFINED + MOMENTS, refined_by);
    (lidar as u64).saturating_add(background as u64).saturating_mul(each)
}

fn check_gaussians([lidar, background]: [usize; 2], need: u64, available: u64, settings: MemorySettings) -> Result<()> {
    if need <= available {
        return Ok(());
    }
    let setting = if lidar >= background { settings.returns } else { settings.images };
    let found = format!("{lidar} LiDAR and {background} background Gaussians");
    Err(EngineError::TooLarge { setting, what: "a scene that can be refined", found, need, free: available })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::{MemorySettings, Need, check_gaussians, refinement_bytes};
    use crate::error::Result;
    use crate::network::config::ModelConfig;

    fn check(gaussians: [usize; 2], config: Option<&ModelConfig>, available: u64) -> Result<()> {
        check_gaussians(gaussians, refinement_bytes(gaussians, config), available, MemorySettings::default())
    }

    #[test]
    fn the_larger_branch_names_its_setting() {
        let config = ModelConfig::parse(include_str!("../../../models/tiny.json"), Path::new("tiny.json")).unwrap();
        // What the refinement of 10^6 Gaussians was seen to take beside images and sites: 1.6 GB.
        assert!(check([600_000, 400_000], Some(&config), 1_700_000_000).is_ok());
        let message = check([600_000, 400_000], Some(&config), 1_000_000_000).unwrap_err().to_string();
        assert!(message.starts_with("frames: expected a scene") && message.contains("600000 LiDAR"), "{message}");
        let message = check([4, 1_000_000], None, 900_000_000).unwrap_err().to_string();
        assert!(message.starts_with("image-size: expected") && message.contains("at least 937 MB"), "{message}");
        assert!(check([usize::MAX; 2], None, u64::MAX - 1).is_err(), "sums do not wrap");
    }

    #[test]
    fn the_larger_part_names_its_setting() {
        let images = Need::of(&[[1000, 1000], [500, 1000]], 10);
        assert_eq!(images.image_bytes, 12 * 1_500_000 + 56 * 1_000_000);
        assert!(images.check(images.image_bytes + images.return_bytes, MemorySettings::default()).is_ok());
        let message = images.check(1_000_000, MemorySettings::default()).unwrap_err().to_string();
        assert!(
            message.starts_with("image-size: expected") && message.contains("2 images, at least 75 MB"),
            "{message}"
        );
        let returns = Need::of(&[[1, 1]], 1 << 40);
        let settings = MemorySettings { returns: "cameras", ..MemorySettings::default() };
        assert!(returns.check(1 << 30, settings).unwrap_err().to_string().starts_with("cameras: expected"));
        assert!(Need::of(&[[usize::MAX; 2]; 3], u64::MAX).check(u64::MAX - 1, settings).is_err(), "sums do not wrap");
    }
}
