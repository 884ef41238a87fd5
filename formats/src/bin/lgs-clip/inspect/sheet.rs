//! The contact sheet: images of a few frames with the LiDAR over them, coloured by depth.

use std::path::Path;

use anyhow::{Context, Result};
use lgs_formats::{
    clip_dir::ClipDir,
    image::{ImageSize, PixelLabel, RgbImage, write_png},
};

use super::project::{Projected, camera_from_lidar, project};

/// Width of one image of the sheet, pixels.
const TILE_WIDTH: usize = 640;
/// Most that an image of the sheet is high, pixels: a higher one is narrower than the others.
const TILE_HEIGHT: usize = 2 * TILE_WIDTH;
/// Black between the images, pixels.
const GAP: usize = 4;
/// Distance of the stripes over what a mask hides, pixels.
const STRIPE: usize = 8;
/// Most frames of a sheet: more are spread evenly.
const MAX_FRAMES: usize = 4;
/// Depths of the first and the last colour, metres.
const DEPTHS: [f64; 2] = [2.0, 80.0];

/// Writes the sheet of a clip that has images, in a folder that is made when it is missing, and returns what its rows and columns are.
pub(crate) fn contact_sheet(dir: &ClipDir, file: &Path) -> Result<String> {
    let clip = dir.clip();
    let with_images: Vec<usize> = (0..clip.frames.len()).filter(|&f| !clip.frames[f].cameras.is_empty()).collect();
    let num_rows = with_images.len().min(MAX_FRAMES);
    if num_rows == 0 {
        return Ok("not written: there are no images".to_owned());
    }
    let chosen: Vec<usize> =
        (0..num_rows).map(|row| with_images[row * (with_images.len() - 1) / (num_rows - 1).max(1)]).collect();
    let mut names: Vec<&str> = Vec::new();
    for record in chosen.iter().flat_map(|&frame| &clip.frames[frame].cameras) {
        if !names.contains(&record.camera.name.as_str()) {
            names.push(&record.camera.name);
        }
    }
    let rows = chosen.iter().map(|&frame| row(dir, frame, &names)).collect::<Result<Vec<_>>>()?;
    if let Some(folder) = file.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        std::fs::create_dir_all(folder).with_context(|| format!("{}: create", folder.display()))?;
    }
    write_png(file, &stacked(&rows, names.len()))?;
    let frames: Vec<String> = chosen.iter().map(usize::to_string).collect();
    Ok(format!("rows are frames {}, columns {}", frames.join(", "), names.join(", ")))
}

/// The images of a frame by the columns of the sheet.
fn row(dir: &ClipDir, frame: usize, names: &[&str]) -> Result<Vec<Option<RgbImage>>> {
    let record = &dir.clip().frames[frame];
    let points = dir.load_sweep(frame)?.points;
    let mut tiles = Vec::with_capacity(names.len());
    for name in names {
        let Some(index) = record.cameras.iter().position(|found| found.camera.name == *name) else {
            tiles.push(None);
            continue;
        };
        let declared = &record.cameras[index].camera;
        let size = tile(declared.width as usize, declared.height as usize);
        let loaded = dir.load_image(frame, index, Some(size))?;
        let pose = camera_from_lidar(&loaded.camera, &record.lidar.world_from_lidar);
        let mut seen: Vec<Projected> =
            points.iter().filter_map(|&point| project(&loaded.camera, &pose, point)).collect();
        // Near returns over far ones.
        seen.sort_by(|a, b| b.depth.total_cmp(&a.depth));
        let mut tile = loaded.rgb;
        shade(&mut tile, loaded.labels.as_deref().unwrap_or_default());
        seen.iter().for_each(|point| dot(&mut tile, point));
        tiles.push(Some(tile));
    }
    Ok(tiles)
}

/// The size of an image on the sheet.
fn tile(width: usize, height: usize) -> ImageSize {
    let scaled = (height * TILE_WIDTH).div_ceil(width);
    if scaled <= TILE_HEIGHT {
        return ImageSize { height: scaled, width: TILE_WIDTH };
    }
    ImageSize { height: TILE_HEIGHT, width: (width * TILE_HEIGHT).div_ceil(height) }
}

/// Draws what a mask says: stripes of magenta over what is ignored, of yellow over what moves.
fn shade(tile: &mut RgbImage, labels: &[PixelLabel]) {
    let width = tile.width;
    for (pixel, label) in labels.iter().enumerate() {
        let colour = match label {
            PixelLabel::Ignored => [1.0, 0.0, 1.0],
            PixelLabel::Dynamic => [1.0, 1.0, 0.0],
            PixelLabel::Static => continue,
        };
        if (pixel % width + pixel / width) % STRIPE < STRIPE / 2 {
            tile.data[pixel * 3..pixel * 3 + 3].copy_from_slice(&colour);
        }
    }
}

/// Draws a return as two by two pixels.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "pixels of an image, not negative")]
fn dot(tile: &mut RgbImage, point: &Projected) {
    let colour = colour(point.depth);
    let (left, top) = (point.u as usize, point.v as usize);
    for y in top..(top + 2).min(tile.height) {
        for x in left..(left + 2).min(tile.width) {
            let start = (y * tile.width + x) * 3;
            tile.data[start..start + 3].copy_from_slice(&colour);
        }
    }
}

/// Red for near over yellow, green and cyan to blue for far, even in the logarithm of the depth.
#[expect(clippy::cast_possible_truncation, reason = "colours need no more than f32")]
fn colour(depth: f64) -> [f32; 3] {
    let [near, far] = DEPTHS;
    let share = ((depth / near).ln() / (far / near).ln()).clamp(0.0, 1.0) as f32;
    let hue = share * 4.0;
    let rising = |from: f32| (hue - from).clamp(0.0, 1.0);
    [1.0 - rising(1.0), rising(0.0) - rising(3.0), rising(2.0)]
}

/// The sheet of rows of `columns` tiles.
fn stacked(rows: &[Vec<Option<RgbImage>>], columns: usize) -> RgbImage {
    let heights: Vec<usize> =
        rows.iter().map(|row| row.iter().flatten().map(|tile| tile.height).max().unwrap_or(0)).collect();
    let width = columns * (TILE_WIDTH + GAP) - GAP;
    let height = heights.iter().sum::<usize>() + GAP * rows.len().saturating_sub(1);
    let mut sheet = RgbImage { width, height, data: vec![0.0; width * height * 3] };
    let mut top = 0;
    for (row, row_height) in rows.iter().zip(heights) {
        for (column, tile) in row.iter().enumerate() {
            let Some(tile) = tile else { continue };
            for (y, line) in tile.data.chunks_exact(tile.width * 3).enumerate() {
                let start = ((top + y) * width + column * (TILE_WIDTH + GAP)) * 3;
                sheet.data[start..start + line.len()].copy_from_slice(line);
            }
        }
        top += row_height + GAP;
    }
    sheet
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_image_fits_on_the_sheet() {
        let sides = |width, height| (tile(width, height).width, tile(width, height).height);
        assert_eq!(
            [sides(1936, 1216), sides(100, 200), sides(1, 16384), sides(16384, 1)],
            [(640, 402), (640, 1280), (1, 1280), (640, 1)]
        );
    }

    #[test]
    fn colours_run_from_red_to_blue() {
        assert_eq!(
            [colour(0.5), colour(2.0), colour(80.0), colour(1e6)],
            [[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]]
        );
        let [red, green, blue] = colour((2.0_f64 * 80.0).sqrt());
        assert!(red < 1e-6 && green > 0.999 && blue < 1e-6, "{red} {green} {blue}");
    }
}
