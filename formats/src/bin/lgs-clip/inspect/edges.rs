//! Edges that a sweep and an image of the same moment share: where depth or intensity jumps to the side, colours do so too.

use glam::DVec3;
use lgs_formats::{
    image::{LoadedImage, PixelLabel},
    pose::Pose,
    sweep::Sweep,
};

/// Height of the strips of elevation in which neighbours are looked for, degrees: about the distance of a LiDAR's beams.
const STRIP_DEG: f64 = 0.4;
/// Largest turn between two returns that are neighbours, degrees.
const NEIGHBOUR_DEG: f64 = 0.7;
/// Smallest jump of the range: metres, and a share of it.
const MIN_JUMP: f64 = 0.5;
const MIN_JUMP_SHARE: f64 = 0.1;
/// Largest difference of range on one surface, metres.
const SURFACE: f64 = 0.3;
/// Share of the neighbours on one surface whose difference of intensity is no edge.
const INTENSITY_QUANTILE: f64 = 0.97;
/// Weight of an edge of intensity, where one of depth has the jump's share of the range, at most 1.
const INTENSITY_WEIGHT: f64 = 0.3;
/// Nearest depth of an edge, metres.
const NEAR: f64 = 1.5;
/// Share of the pixels whose gradient is below that of a full edge.
const EDGE_QUANTILE: f64 = 0.95;
/// What is left of an edge one pixel beside it.
const DECAY: f32 = 0.75;
/// Half the width of the surroundings that an edge is compared with, pixels.
const SURROUNDINGS: usize = 24;

/// An edge of a sweep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Edge {
    /// In the camera's frame, metres.
    pub(super) place: DVec3,
    pub(super) weight: f64,
}

/// A return as seen from the LiDAR, with the camera's axes.
struct Ray {
    strip: i64,
    /// Degrees to the right of the camera's axis.
    azimuth: f64,
    range: f64,
    intensity: f64,
    place: DVec3,
}

/// The edges of a sweep in front of a camera.
pub(super) fn of_sweep(sweep: &Sweep, camera_from_lidar: &Pose) -> Vec<Edge> {
    let mut rays: Vec<Ray> =
        sweep.points.iter().zip(&sweep.intensities).filter_map(|(&p, &i)| ray(p, i, camera_from_lidar)).collect();
    rays.sort_by(|a, b| (a.strip, a.azimuth).partial_cmp(&(b.strip, b.azimuth)).unwrap_or(std::cmp::Ordering::Equal));
    let neighbours = |pair: &[Ray]| pair[0].strip == pair[1].strip && pair[1].azimuth - pair[0].azimuth < NEIGHBOUR_DEG;
    let change = |pair: &[Ray]| (pair[1].intensity - pair[0].intensity).abs();
    let on_surface = |pair: &[Ray]| neighbours(pair) && (pair[1].range - pair[0].range).abs() < SURFACE;
    let mut changes: Vec<f64> = rays.windows(2).filter(|pair| on_surface(pair)).map(change).collect();
    let least = quantile(&mut changes, INTENSITY_QUANTILE).unwrap_or(f64::INFINITY).max(1e-6);
    let mut edges = Vec::new();
    for pair in rays.windows(2).filter(|pair| neighbours(pair)) {
        let near = if pair[0].range < pair[1].range { &pair[0] } else { &pair[1] };
        let jump = (pair[1].range - pair[0].range).abs();
        if jump > MIN_JUMP.max(MIN_JUMP_SHARE * near.range) {
            edges.push(Edge { place: near.place, weight: (jump / near.range).min(1.0) });
        } else if on_surface(pair) && change(pair) >= least {
            edges.push(Edge { place: (pair[0].place + pair[1].place) / 2.0, weight: INTENSITY_WEIGHT });
        }
    }
    edges.retain(|edge| edge.place.z > NEAR);
    edges
}

#[expect(clippy::cast_possible_truncation, reason = "strips of 180 degrees")]
fn ray(point: [f32; 3], intensity: f32, camera_from_lidar: &Pose) -> Option<Ray> {
    let point = DVec3::from(point.map(f64::from));
    let direction = camera_from_lidar.rotation() * point;
    let range = direction.length();
    let is_ahead = range > 1.0 && direction.z > 0.0;
    is_ahead.then(|| Ray {
        strip: ((-direction.y / range).asin().to_degrees() / STRIP_DEG).floor() as i64,
        azimuth: direction.x.atan2(direction.z).to_degrees(),
        range,
        intensity: f64::from(intensity),
        place: camera_from_lidar.transform_point(point),
    })
}

/// The value below which a share of the values lies; they are sorted by it.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "an index of a list"
)]
fn quantile(values: &mut [f64], share: f64) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get((values.len() as f64 * share) as usize).copied()
}

/// `[H, W]` how much more of an edge to the side a pixel shows than its surroundings do, about -1 to 1; NaN where the mask hides it.
#[expect(clippy::cast_possible_truncation, reason = "at most 1")]
pub(super) fn of_image(image: &LoadedImage) -> Vec<f32> {
    let (width, height) = (image.rgb.width, image.rgb.height);
    let grey: Vec<f32> =
        image.rgb.data.as_chunks::<3>().0.iter().map(|[r, g, b]| 0.3 * r + 0.6 * g + 0.1 * b).collect();
    let mut edges = vec![0.0_f32; width * height];
    for (row, line) in grey.chunks_exact(width).enumerate() {
        for x in 1..width.saturating_sub(1) {
            edges[row * width + x] = (line[x + 1] - line[x - 1]).abs();
        }
    }
    let mut sorted: Vec<f64> = edges.iter().map(|&edge| f64::from(edge)).collect();
    let full = quantile(&mut sorted, EDGE_QUANTILE).unwrap_or(0.0).max(1e-6);
    edges.iter_mut().for_each(|edge| *edge = (f64::from(*edge) / full).min(1.0) as f32);
    for line in edges.chunks_exact_mut(width) {
        for x in 1..width {
            line[x] = line[x].max(DECAY * line[x - 1]);
        }
        for x in (1..width).rev() {
            line[x - 1] = line[x - 1].max(DECAY * line[x]);
        }
        subtract_surroundings(line);
    }
    for (edge, label) in edges.iter_mut().zip(image.labels.as_deref().unwrap_or_default()) {
        if *label == PixelLabel::Ignored {
            *edge = f32::NAN;
        }
    }
    edges
}

/// Takes the mean of the surroundings from every value of a row.
#[expect(
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    reason = "numbers of pixels, means of values up to 1"
)]
fn subtract_surroundings(line: &mut [f32]) {
    let sums: Vec<f64> = std::iter::once(0.0)
        .chain(line.iter().scan(0.0, |sum, &value| {
            *sum += f64::from(value);
            Some(*sum)
        }))
        .collect();
    for (x, value) in line.iter_mut().enumerate() {
        let (from, to) = (x.saturating_sub(SURROUNDINGS), (x + SURROUNDINGS + 1).min(sums.len() - 1));
        *value -= ((sums[to] - sums[from]) / (to - from) as f64) as f32;
    }
}
