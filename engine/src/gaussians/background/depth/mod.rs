//! Depth maps of the input views from the images and the sweeps together.
//!
//! Every pixel's depth is searched along its ray: where the other images of the same camera show the same, where returns
//! are, not behind the ground, infinitely far where it looks like sky, and like its neighbours unless there is an edge. Maps
//! of different views then confirm or contradict each other.

mod agree;
mod enlarge;
mod evidence;
mod ground;
mod level;
mod matching;
mod own_vehicle;
mod relative;
mod sky_colours;
mod smooth;
mod volume;

use std::collections::BTreeSet;

pub(super) use self::agree::{Map, Trust, trust};
use self::{evidence::Evidence, ground::Ground, level::Level, own_vehicle::Part, smooth::Choice};
use super::Sheet;
use crate::{
    parallel,
    points::PointCloud,
    views::{View, reduced::Reduced},
};

/// Depths are searched in images of at most so many pixels: what is found in a larger image is hardly better, and takes memory by the pixel.
const MAX_PIXELS: usize = 150_000;
/// Views that are searched side by side, at most: each needs some 800 bytes a pixel while it runs, and keeps two threads busy.
const AT_ONCE: usize = 4;
/// Other images of its camera that a view is matched against.
const MAX_SOURCES: usize = 2;
/// How much nearer than the ground that it hides the own vehicle is taken to be.
const OWN_VEHICLE_NEARER: f32 = 1.6;

/// What the search found for one view, at the reduced size.
struct Search {
    evidence: Vec<Evidence>,
    choices: Vec<Choice>,
    step: f32,
}

/// The depth maps of `views`, nowhere farther than `radius` metres.
pub(super) fn sheets(views: &[&View], cloud: &PointCloud, radius: f32) -> Vec<Sheet> {
    let ground = Ground::fit(cloud);
    let levels: Vec<Level> = parallel::map(views.len(), 1, &|i| Level::new(Reduced::new(views[i], factor(views[i]))));
    let search = |i: usize| {
        let evidence = evidence::evidence(views[i], &levels[i].view, cloud, ground);
        let others: Vec<&Level> = sources(views, i).into_iter().map(|j| &levels[j]).collect();
        let volume = volume::volume(&levels[i], &others, &evidence);
        let choices = smooth::smooth(&volume, &levels[i].view);
        Search { evidence, choices, step: volume.step }
    };
    let at_once = (rayon::current_num_threads() / 2).clamp(1, AT_ONCE);
    let all: Vec<usize> = (0..views.len()).collect();
    let searches: Vec<Search> =
        all.chunks(at_once).flat_map(|some| parallel::map(some.len(), 1, &|k| search(some[k]))).collect();
    let parts = parts(views, &levels, &searches);
    let scene: Vec<Vec<f32>> = (0..views.len()).map(|i| scene_depths(&searches[i], &parts[i])).collect();
    let map = |i: usize| Map { camera: &levels[i].view.pinhole, inverse: &scene[i], step: searches[i].step };
    let finish = |i: usize| {
        let others: Vec<Map<'_>> = sources(views, i).into_iter().map(map).collect();
        let mut trust = agree::trust(map(i), &others);
        for (trust, evidence) in trust.iter_mut().zip(&searches[i].evidence) {
            if evidence.weight >= 1.0 && *trust != Trust::Unknown {
                *trust = Trust::Confirmed;
            }
        }
        let mut inverse = agree::repaired(&levels[i].view, &scene[i], &trust);
        for (k, _) in parts[i].iter().enumerate().filter(|&(_, &part)| part == Part::Vehicle) {
            trust[k] = Trust::OwnVehicle;
            inverse[k] = OWN_VEHICLE_NEARER * searches[i].evidence[k].floor;
        }
        enlarge::enlarged(views[i], &levels[i].view, factor(views[i]), &inverse, &trust, radius)
    };
    parallel::map(views.len(), 1, &finish)
}

/// By how much a view is reduced, in both directions.
fn factor(view: &View) -> usize {
    let reduced = |by: usize| (view.pinhole.width / by) * (view.pinhole.height / by);
    (1..).find(|&by| reduced(by) <= MAX_PIXELS).unwrap_or(1)
}

/// Indices of the views that view `i` is matched against: the nearest frames of the same camera. By their numbers: times, which
/// are rounded, would decide between equal distances by chance.
pub(super) fn sources(views: &[&View], i: usize) -> Vec<usize> {
    let gap = |j: usize| views[j].frame.abs_diff(views[i].frame);
    let other = |j: &usize| views[*j].camera == views[i].camera && views[*j].frame != views[i].frame;
    let mut found: Vec<usize> = (0..views.len()).filter(other).collect();
    found.sort_by_key(|&j| (gap(j), views[j].frame));
    found.truncate(MAX_SOURCES);
    found
}

/// What the pixels of every view show; the same in all images of a camera.
fn parts(views: &[&View], levels: &[Level], searches: &[Search]) -> Vec<Vec<Part>> {
    let mut result: Vec<Vec<Part>> = searches.iter().map(|s| vec![Part::Scene; s.choices.len()]).collect();
    let size = |i: usize| (levels[i].view.pinhole.width, searches[i].choices.len());
    let groups: BTreeSet<(&str, (usize, usize))> = (0..views.len()).map(|i| (&*views[i].camera, size(i))).collect();
    for (camera, size_of_group) in groups {
        let members: Vec<usize> =
            (0..views.len()).filter(|&i| views[i].camera == camera && size(i) == size_of_group).collect();
        let guess = |&i: &usize| searches[i].choices.iter().map(|choice| choice.own_vehicle).collect();
        let parts = own_vehicle::parts(&members.iter().map(guess).collect::<Vec<_>>(), size_of_group.0);
        for &i in &members {
            result[i].clone_from(&parts);
        }
    }
    result
}

/// The inverse depths of what is not the own vehicle; NaN elsewhere.
fn scene_depths(search: &Search, parts: &[Part]) -> Vec<f32> {
    let depth = |(choice, part): (&Choice, &Part)| if *part == Part::Scene { choice.inverse } else { f32::NAN };
    search.choices.iter().zip(parts).map(depth).collect()
}
