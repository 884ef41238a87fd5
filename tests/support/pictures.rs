//! Pictures of a failing image case.

use std::fs;
use std::path::PathBuf;

use crate::{Outcome, places};

/// `outcome`; when it is a failure, both images are left as PNG files and their paths are added to the message.
///
/// # Shapes
/// `got`, `want`: `[H, W, 3]` in 0..=1.
pub fn with_pictures(outcome: Outcome, name: &str, width: usize, got: &[f64], want: &[f64]) -> Outcome {
    let Err(failure) = outcome else { return Ok(()) };
    let message = failure.message().unwrap_or("failed").to_owned();
    let left =
        save(&format!("{name}.got"), width, got).and_then(|g| Ok((g, save(&format!("{name}.want"), width, want)?)));
    let text = match left {
        Ok((got, want)) => format!("{message}\n  got  {}\n  want {}", got.display(), want.display()),
        Err(error) => format!("{message}\n  (pictures could not be left: {error})"),
    };
    Err(text.into())
}

fn save(name: &str, width: usize, rgb: &[f64]) -> Result<PathBuf, Box<dyn std::error::Error>> {
    let directory = places::failures();
    fs::create_dir_all(&directory)?;
    let path = directory.join(format!("{}.png", name.replace("::", "-")));
    let height = rgb.len() / (3 * width.max(1));
    let bytes = rgb.iter().map(|&v| to_byte(v)).collect();
    let picture = image::RgbImage::from_raw(u32::try_from(width)?, u32::try_from(height)?, bytes);
    picture.ok_or("not a whole image")?.save(&path)?;
    Ok(path)
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 0..=255 first")]
fn to_byte(value: f64) -> u8 {
    (255.0 * value).round().clamp(0.0, 255.0) as u8
}
