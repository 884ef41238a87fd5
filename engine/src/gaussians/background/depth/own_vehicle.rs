//! The part of a camera's images that shows the vehicle it is mounted on.

/// Half width of the window in which pixels vote, pixels.
const REACH: usize = 3;
/// Share of the votes that makes a pixel part of the vehicle.
const MAJORITY: f32 = 0.35;
/// Width of the rim in which pixels may belong to either, pixels.
const RIM: usize = 3;

/// What a pixel of a camera shows in all of its images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    /// The scene.
    Scene,
    /// Either: too close to the vehicle's outline.
    Rim,
    /// The vehicle.
    Vehicle,
}

/// The parts of a camera's images, `[H, W]`, from a first guess in each of them: what most say within a window and what
/// reaches the lower edge of the image.
pub(super) fn parts(guesses: &[Vec<bool>], width: usize) -> Vec<Part> {
    let num_pixels = guesses.first().map_or(0, Vec::len);
    let votes: Vec<f32> = (0..num_pixels)
        .map(|i| guesses.iter().filter(|guess| guess[i]).count() as f32 / guesses.len() as f32)
        .collect();
    let chosen: Vec<bool> = (0..num_pixels)
        .map(|i| {
            let (sum, count) =
                window(i, width, num_pixels, REACH).fold((0.0, 0.0), |(s, n), k| (s + votes[k], n + 1.0));
            sum > MAJORITY * count
        })
        .collect();
    let vehicle = reaching_below(&chosen, width);
    let part = |i: usize| {
        if vehicle[i] {
            Part::Vehicle
        } else if window(i, width, num_pixels, RIM).any(|k| vehicle[k]) {
            Part::Rim
        } else {
            Part::Scene
        }
    };
    (0..num_pixels).map(part).collect()
}

/// Indices of the pixels at most `reach` rows and columns away.
fn window(pixel: usize, width: usize, num_pixels: usize, reach: usize) -> impl Iterator<Item = usize> {
    let (column, row) = (pixel % width, pixel / width);
    let columns = column.saturating_sub(reach)..(column + reach + 1).min(width);
    let rows = row.saturating_sub(reach)..(row + reach + 1).min(num_pixels / width);
    rows.flat_map(move |r| columns.clone().map(move |c| r * width + c))
}

/// The chosen pixels that are connected to a chosen one in the last row.
fn reaching_below(chosen: &[bool], width: usize) -> Vec<bool> {
    let mut reached = vec![false; chosen.len()];
    let mut open: Vec<usize> = (chosen.len() - width.min(chosen.len())..chosen.len()).collect();
    while let Some(pixel) = open.pop() {
        if reached[pixel] || !chosen[pixel] {
            continue;
        }
        reached[pixel] = true;
        let column = pixel % width;
        open.extend((column > 0).then(|| pixel - 1));
        open.extend((column + 1 < width).then_some(pixel + 1));
        open.extend(pixel.checked_sub(width));
        open.extend(Some(pixel + width).filter(|&below| below < chosen.len()));
    }
    reached
}

#[cfg(test)]
mod tests {
    use super::{Part, parts};

    /// 24 x 16 pixels; the lower five rows are the vehicle, and a patch of the sky looks like it.
    fn guess(i: usize) -> bool {
        let (column, row) = (i % 24, i / 24);
        row >= 11 || (row < 5 && column < 6)
    }

    #[test]
    fn the_vehicle_is_what_reaches_the_lower_edge() {
        let parts = parts(&[(0..384).map(guess).collect()], 24);
        assert_eq!(parts[15 * 24 + 12], Part::Vehicle);
        assert_eq!(parts[2 * 24 + 2], Part::Scene, "not connected");
        assert_eq!(parts[8 * 24 + 12], Part::Rim);
        assert_eq!(parts[4 * 24 + 12], Part::Scene);
    }

    #[test]
    fn one_image_of_three_does_not_decide() {
        let none = vec![false; 384];
        let parts = parts(&[(0..384).map(guess).collect(), none.clone(), none], 24);
        assert!(parts.iter().all(|&part| part == Part::Scene));
    }

    #[test]
    fn a_hole_in_the_vehicle_is_closed() {
        let parts = parts(&[(0..384).map(|i| guess(i) && i != 13 * 24 + 12).collect()], 24);
        assert_eq!(parts[13 * 24 + 12], Part::Vehicle);
    }
}
