//! The effect of single actions after everything was optimised for a few steps.
//!
//! Actions that stand far from each other in every view are tried in one optimisation: a pixel's change belongs to the action that is
//! nearest to it in the image. The loss is a sum over pixels, and a few steps reach no further than a few Gaussians' widths.

use lgs_engine::gaussians::physical::{Splat, to_physical};
use lgs_engine::gaussians::{Branch, GaussianSet};
use lgs_engine::loss::{LossCounts, LossMap, loss_map};
use lgs_engine::refine::adam::{AdamRates, adam};
use lgs_engine::render::render;
use lgs_engine::views::View;
use rayon::prelude::*;

use super::{Effects, Sample};
use crate::branches::{BEHIND, Problem};

/// How actions are optimised.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AfterSettings {
    /// Steps of Adam.
    pub steps: usize,
    /// Least distance of two actions of one optimisation in every view, pixels.
    pub separation_px: f64,
}

/// An action's place in each view; `None` behind the camera.
type Places = Vec<Option<[f64; 2]>>;

/// By how much the mean loss over the views differs, after `steps` of Adam on everything, from that without the action; `progress` is told
/// the share that is done.
pub fn after(
    problem: &Problem<'_>,
    sample: &Sample,
    settings: &AfterSettings,
    progress: &mut dyn FnMut(f64),
) -> Effects {
    let splats = to_physical(problem.set);
    let places: Vec<Places> = sample.chosen.iter().map(|&i| places(&splats[i], problem.views)).collect();
    let groups = group(&places, settings.separation_px);
    let base = optimised(problem, problem.set.clone(), settings.steps);
    let size = sample.chosen.len();
    let mut effects = Effects { prune: vec![0.0; size], add: vec![0.0; size] };
    for (done, group) in groups.iter().enumerate() {
        let without = optimised(problem, without(problem.set, sample, group), settings.steps);
        let with = optimised(problem, with(problem.set, sample, group), settings.steps);
        for (maps, effects) in [(without, &mut effects.prune), (with, &mut effects.add)] {
            for (v, view) in problem.views.iter().enumerate() {
                let share = 1.0 / (problem.views.len() * view.pinhole.num_pixels()) as f64;
                let members: Vec<(usize, [f64; 2])> =
                    group.iter().filter_map(|&k| places[k][v].map(|place| (k, place))).collect();
                for (k, change) in attribute(&base[v], &maps[v], view.pinhole.width, &members) {
                    effects[k] += share * change;
                }
            }
        }
        progress((done + 1) as f64 / groups.len() as f64);
    }
    effects
}

/// Loss maps of the views after an optimisation.
fn optimised(problem: &Problem<'_>, mut set: GaussianSet, steps: usize) -> Vec<LossMap> {
    let views: Vec<&View> = problem.views.iter().collect();
    adam(&mut set, &views, &AdamRates::default(), steps, |_| ());
    let splats = to_physical(&set);
    let map = |view: &View| {
        let rendered = render(&splats, &view.pinhole, BEHIND);
        loss_map(&rendered, view, &problem.weights, &LossCounts::of(view))
    };
    problem.views.iter().map(map).collect()
}

fn without(set: &GaussianSet, sample: &Sample, group: &[usize]) -> GaussianSet {
    let mut gone = vec![false; set.len()];
    group.iter().for_each(|&k| gone[sample.chosen[k]] = true);
    let kept: Vec<usize> = (0..set.len()).filter(|&i| !gone[i]).collect();
    set.select(&kept, set.num_lidar - group.len())
}

fn with(set: &GaussianSet, sample: &Sample, group: &[usize]) -> GaussianSet {
    let [lidar, background] = [Branch::Lidar, Branch::Background].map(|branch| set.rows(branch).collect::<Vec<_>>());
    let mut with = set.select(&lidar, set.num_lidar + group.len());
    with.append(&sample.copies.select(group, group.len()));
    with.append(&set.select(&background, 0));
    with
}

fn places(splat: &Splat, views: &[View]) -> Places {
    let place = |view: &View| {
        let pinhole = &view.pinhole;
        let elapsed = pinhole.time - splat.time;
        let [x, y, z] =
            pinhole.to_camera([0, 1, 2].map(|k| splat.mean[k] + splat.velocity[k] * elapsed)).map(f64::from);
        let focal = [pinhole.fx, pinhole.fy].map(f64::from);
        (z > 0.0).then(|| [focal[0] * x / z + f64::from(pinhole.cx), focal[1] * y / z + f64::from(pinhole.cy)])
    };
    views.iter().map(place).collect()
}

/// Actions by optimisation: each goes to the first whose members are all far from it in every view.
fn group(places: &[Places], separation_px: f64) -> Vec<Vec<usize>> {
    let far = |a: &Places, b: &Places| {
        a.iter().zip(b).all(|pair| match pair {
            (Some(a), Some(b)) => (a[0] - b[0]).hypot(a[1] - b[1]) >= separation_px,
            _ => true,
        })
    };
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for (k, own) in places.iter().enumerate() {
        match groups.iter_mut().find(|group| group.iter().all(|&member| far(own, &places[member]))) {
            Some(group) => group.push(k),
            None => groups.push(vec![k]),
        }
    }
    groups
}

/// Sums of the changes of the pixels that are nearest to each member.
fn attribute(before: &LossMap, after: &LossMap, width: usize, members: &[(usize, [f64; 2])]) -> Vec<(usize, f64)> {
    let rows = before.values.par_chunks(width).zip(after.values.par_chunks(width)).enumerate();
    let by_row: Vec<Vec<f64>> = rows
        .map(|(y, (before, after))| {
            let mut sums = vec![0.0_f64; members.len()];
            for (x, (before, after)) in before.iter().zip(after).enumerate().filter(|(_, (b, a))| b != a) {
                let distance = |place: &[f64; 2]| (x as f64 + 0.5 - place[0]).hypot(y as f64 + 0.5 - place[1]);
                let nearest =
                    (0..members.len()).min_by(|&a, &b| distance(&members[a].1).total_cmp(&distance(&members[b].1)));
                if let Some(nearest) = nearest {
                    sums[nearest] += f64::from(*after) - f64::from(*before);
                }
            }
            sums
        })
        .collect();
    members.iter().enumerate().map(|(m, &(k, _))| (k, by_row.iter().map(|row| row[m]).sum())).collect()
}
