//! Depth maps that the clip brings, each brought to metres by the returns that fall on it (specification, section 4, background a).

mod align;

use lgs_formats::clip::DepthKind;
use serde::Serialize;

use self::align::{Line, Pair};
use super::{
    Sheet,
    depth::{self, Map, Trust},
    is_ignored, slant,
};
use crate::{
    parallel,
    points::PointCloud,
    views::{NEAR, View},
};

/// Fewest returns that tell scale and shift.
const MIN_RETURNS: usize = 30;
/// Largest median error of a map that is believed.
const MAX_ERROR: f64 = 0.25;
/// A metric map stays as it is when its own error is below the first, and unless scale and shift bring it below the second, a share.
const WORTH: (f64, f64) = (1e-3, 0.95);
/// Resolution that maps are taken to have when they are compared, 1 / metres.
const STEP: f32 = 0.004;
/// What the own vehicle is nearer than, metres.
const OWN_VEHICLE_RANGE: f32 = 4.0;
/// Share by which its inverse depth differs between images of its camera.
const SAME: f32 = 0.05;

/// How a depth map was brought to metres, and how well that went.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MapFit {
    /// Index of the frame in the clip.
    pub frame: usize,
    /// Name of the camera.
    pub camera: String,
    /// What the map says: `metric` or `relative`.
    pub kind: DepthKind,
    /// Inverse depth (1 / metres) is `scale * value + shift`; of a metric map the values are inverse depths, too.
    pub scale: f64,
    /// See `scale`, 1 / metres.
    pub shift: f64,
    /// Returns that fall on known pixels of the map.
    pub returns: usize,
    /// Median over the returns of the error of the inverse depth, as a share; `None` without returns.
    pub error: Option<f64>,
    /// Share of the returns within a tenth.
    pub inliers: Option<f64>,
    /// Whether the map is used: else the depths of its image are searched as in a clip without maps.
    pub used: bool,
}

/// Depths of views, and what became of their maps.
#[derive(Debug)]
pub(super) struct Aligned {
    pub(super) sheets: Vec<Sheet>,
    /// In the order of frames.
    pub(super) fits: Vec<MapFit>,
}

/// The depths of `views` from their maps, and by search where there is no map, or none that fits; nowhere farther than `radius` metres.
pub(super) fn sheets(views: &[&View], cloud: &PointCloud, radius: f32) -> Aligned {
    let fits: Vec<Option<MapFit>> = parallel::map(views.len(), 1, &|i| fit(views[i]));
    let all_used = fits.iter().all(|fit| fit.as_ref().is_some_and(|fit| fit.used));
    let mut sheets = if all_used { Vec::new() } else { depth::sheets(views, cloud, radius) };
    let inverse: Vec<Option<Vec<f32>>> =
        views.iter().zip(&fits).map(|(view, fit)| in_metres(view, fit.as_ref())).collect();
    let of_view = |i: usize| Some(sheet(views, &inverse, i, inverse[i].as_deref()?, radius));
    let of_maps: Vec<Option<Sheet>> = parallel::map(views.len(), 1, &of_view);
    if all_used {
        sheets = of_maps.into_iter().flatten().collect();
    } else {
        let better = sheets.iter_mut().zip(of_maps).filter_map(|(sheet, of_map)| Some((sheet, of_map?)));
        better.for_each(|(sheet, of_map)| *sheet = of_map);
    }
    let mut fits: Vec<MapFit> = fits.into_iter().flatten().collect();
    fits.sort_by(|a, b| (a.frame, &a.camera).cmp(&(b.frame, &b.camera)));
    Aligned { sheets, fits }
}

/// How the map of a view is brought to metres; `None` without a map.
fn fit(view: &View) -> Option<MapFit> {
    let map = view.depth_map.as_ref()?;
    let pair = |sample: &crate::views::DepthSample| {
        let pixel = sample.pixel as usize;
        let value = map.inverse.get(pixel).copied().filter(|value| !value.is_nan())?;
        let counts = sample.depth > NEAR && !is_ignored(view, pixel);
        counts.then(|| Pair { value: f64::from(value), inverse: 1.0 / f64::from(sample.depth) })
    };
    let pairs: Vec<Pair> = view.depth_samples.iter().filter_map(pair).collect();
    let enough = pairs.len() >= MIN_RETURNS;
    let fitted = if enough { align::fit(&pairs) } else { None };
    let own_error = Line::IDENTITY.error(&pairs);
    let worth = |line: &Line| own_error > WORTH.0 && line.error(&pairs) < WORTH.1 * own_error;
    let line = match map.kind {
        DepthKind::Metric => fitted.filter(worth).or(Some(Line::IDENTITY)),
        DepthKind::Relative => fitted,
    };
    let error = line.filter(|_| !pairs.is_empty()).map(|line| line.error(&pairs));
    // Too few returns say nothing against a map in metres.
    let believed = error.is_none_or(|error| error <= MAX_ERROR) || !enough;
    let Line { scale, shift } = line.unwrap_or(Line { scale: 0.0, shift: 0.0 });
    Some(MapFit {
        frame: view.frame,
        camera: view.camera.clone(),
        kind: map.kind,
        scale,
        shift,
        returns: pairs.len(),
        error,
        inliers: line.filter(|_| !pairs.is_empty()).map(|line| line.inliers(&pairs)),
        used: line.is_some() && believed,
    })
}

/// `[H, W]` inverse depths of a map that is used, 1 / metres and at least 0; NaN where nothing is known.
#[expect(clippy::cast_possible_truncation, reason = "rounding to single precision is the purpose")]
fn in_metres(view: &View, fit: Option<&MapFit>) -> Option<Vec<f32>> {
    let (map, fit) = (view.depth_map.as_ref()?, fit.filter(|fit| fit.used)?);
    let line = Line { scale: fit.scale, shift: fit.shift };
    let sky = |value: f32| fit.kind == DepthKind::Metric && value == 0.0;
    let of_value = |&value: &f32| match value {
        value if sky(value) || value.is_nan() => value,
        value => line.at(f64::from(value)).clamp(0.0, f64::from(1.0 / NEAR)) as f32,
    };
    Some(map.inverse.iter().map(of_value).collect())
}

/// The sheet of a view: the inverse depths of its map, trusted as the maps of the nearest frames of its camera confirm them.
fn sheet(views: &[&View], all: &[Option<Vec<f32>>], i: usize, inverse: &[f32], radius: f32) -> Sheet {
    let pinhole = &views[i].pinhole;
    let fits = |j: &usize| all[*j].as_ref().is_some_and(|other| other.len() == inverse.len());
    let sources: Vec<usize> = depth::sources(views, i).into_iter().filter(fits).collect();
    let others: Vec<Map<'_>> = sources
        .iter()
        .filter_map(|&j| Some(Map { camera: &views[j].pinhole, inverse: all[j].as_deref()?, step: STEP }))
        .collect();
    let mut trust = depth::trust(Map { camera: pinhole, inverse, step: STEP }, &others);
    for (pixel, trust) in trust.iter_mut().enumerate().filter(|(_, trust)| **trust == Trust::Contradicted) {
        // What is near, looks still in the images and is not there in the world moves with the camera.
        let here = inverse[pixel];
        let same = |other: &Map<'_>| (other.inverse[pixel] - here).abs() < SAME * here;
        if here > 1.0 / OWN_VEHICLE_RANGE && others.iter().all(same) {
            *trust = Trust::OwnVehicle;
        }
    }
    let near_enough = |(pixel, &w): (usize, &f32)| if w.is_nan() { w } else { w.max(slant(pinhole, pixel) / radius) };
    Sheet { inverse_depths: inverse.iter().enumerate().map(near_enough).collect(), trust }
}

#[cfg(test)]
mod tests;
