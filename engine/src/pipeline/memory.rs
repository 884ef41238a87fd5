//! Whether a run can fit into the memory that there is, before it begins.

use lgs_formats::{clip_dir::ClipDir, sweep::count_returns};

use crate::{
    allocator::available_bytes,
    error::{EngineError, Result},
    views::Selection,
};

/// Bytes of a pixel of a loaded image: three values.
const IMAGE_PIXEL: u64 = 12;
/// Bytes of a pixel of the view that is being drawn: six planes of tiles, five of images, three of gradients.
const DRAWN_PIXEL: u64 = 4 * (6 + 5 + 3);
/// Bytes of a return: position, time, frame, colour, and its share of the search for neighbours.
const RETURN: u64 = 12 + 4 + 4 + 16 + 28;

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

    /// Nothing, when `available` bytes are enough.
    ///
    /// # Errors
    /// [`EngineError::Setting`] with the flag that lowers the larger part.
    pub fn check(&self, available: u64) -> Result<()> {
        let total = self.image_bytes.saturating_add(self.return_bytes);
        if total <= available {
            return Ok(());
        }
        let megabytes = |bytes: u64| bytes.div_ceil(1_000_000);
        let (setting, what) = if self.image_bytes >= self.return_bytes {
            ("--image-size", format!("{} images", self.images))
        } else {
            ("--frames", format!("{} returns", self.returns))
        };
        Err(EngineError::Setting {
            setting,
            expected: format!("work that fits into the {} MB of memory that are free", available / 1_000_000),
            found: format!("{what}, and at least {} MB in all", megabytes(total)),
        })
    }
}

/// Nothing, when the images and sweeps of a selection can fit into the memory that is free; what is not known counts as enough.
///
/// # Errors
/// Those of the selection and of [`Need::check`].
pub fn check_memory(dir: &ClipDir, selection: &Selection) -> Result<()> {
    let sizes = selection.sizes(dir.clip())?;
    let sweeps = selection.frames(dir.clip())?.input.into_iter();
    let files = sweeps.filter_map(|frame| dir.clip().frames.get(frame)).map(|f| dir.root().join(&f.lidar.file));
    // Foreign sweeps say how many returns they hold when they are read, and count as none.
    let returns = files.filter_map(|file| count_returns(&file).ok()).map(|count| count as u64).sum();
    available_bytes().map_or(Ok(()), |available| Need::of(&sizes, returns).check(available))
}

#[cfg(test)]
mod tests {
    use super::Need;

    #[test]
    fn the_larger_part_names_its_flag() {
        let images = Need::of(&[[1000, 1000], [500, 1000]], 10);
        assert_eq!(images.image_bytes, 12 * 1_500_000 + 56 * 1_000_000);
        assert!(images.check(images.image_bytes + images.return_bytes).is_ok());
        let message = images.check(1_000_000).unwrap_err().to_string();
        assert!(
            message.starts_with("--image-size: expected") && message.contains("2 images, and at least 75 MB"),
            "{message}"
        );
        let returns = Need::of(&[[1, 1]], 1 << 40);
        assert!(returns.check(1 << 30).unwrap_err().to_string().starts_with("--frames: expected"));
        assert!(Need::of(&[[usize::MAX; 2]; 3], u64::MAX).check(u64::MAX - 1).is_err(), "sums do not wrap");
    }
}
