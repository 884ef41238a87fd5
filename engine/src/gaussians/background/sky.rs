//! A hemisphere far behind everything that the sweeps reach.

use super::{Sheet, depth::Trust, slant};
use crate::{
    points::PointCloud,
    views::{PinholeView, Projected, View},
};

/// Radius of the hemisphere over that of the sphere around the `LiDAR` bounding box (specification, section 4).
const RADIUS_SHARE: f32 = 4.0;

/// Where the rays of the views' pixels meet the hemisphere of `radius` metres; unknown below the horizon.
pub(super) fn sheets(views: &[&View], radius: f32) -> Vec<Sheet> {
    views.iter().map(|view| sheet(&view.pinhole, radius)).collect()
}

/// Radius (metres) of the hemisphere: four times half the diagonal of the bounding box of all returns.
pub(super) fn radius(cloud: &PointCloud) -> f32 {
    let extent = |k: usize| {
        let values = cloud.positions.iter().map(|p| p[k]);
        let range = values.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        (range.1 - range.0).max(0.0)
    };
    let diagonal = (0..3).map(|k| extent(k) * extent(k)).sum::<f32>().sqrt();
    RADIUS_SHARE * 0.5 * diagonal.max(1.0)
}

fn sheet(view: &PinholeView, radius: f32) -> Sheet {
    let up = |pixel: usize| {
        let (u, v) = ((pixel % view.width) as f32 + 0.5, (pixel / view.width) as f32 + 0.5);
        let camera = view.exposing([u, v]);
        camera.unproject(Projected { u, v, depth: 1.0 })[2] >= camera.centre()[2]
    };
    let of_pixel = |pixel: usize| {
        if up(pixel) { (slant(view, pixel) / radius, Trust::Confirmed) } else { (f32::NAN, Trust::Unknown) }
    };
    let (inverse_depths, trust) = (0..view.num_pixels()).map(of_pixel).unzip();
    Sheet { inverse_depths, trust }
}
