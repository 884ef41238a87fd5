//! The slow twins: the same in the order of the formulas, with nothing shared between branches.

mod exact;

use lgs_engine::gaussians::physical::to_physical;
use lgs_engine::gaussians::{GaussianSet, MEAN, NUM_ATTRIBUTES};
use lgs_engine::loss::{LossCounts, loss_map};
use lgs_engine::objective::objective;
use lgs_engine::render::{ImageGradient, backward, render, render_for_gradient};
use lgs_engine::views::View;
use lgs_formats::targets::{Normalise, Signal, TargetsConfig, ZScore};

use crate::branches::{BEHIND, Problem, Round};
use crate::delta::ActionDeltas;
use crate::response::GradientRow;

/// Deltas of every round.
pub fn deltas(problem: &Problem<'_>, rounds: &[Round], config: &TargetsConfig) -> Vec<ActionDeltas> {
    let round_deltas = |round: &Round| match config.signal {
        Signal::Response => response(problem, round, config),
        Signal::Footprint => footprint(problem, round),
        Signal::Magnitude => magnitude(problem, round),
        Signal::Exact => exact::deltas(problem, round),
    };
    rounds.iter().map(round_deltas).collect()
}

/// The set without a round's primitives, and the set with their copies behind the `LiDAR` branch.
fn branches(set: &GaussianSet, round: &Round) -> [GaussianSet; 2] {
    let mut without = GaussianSet { num_lidar: set.num_lidar - round.chosen.len(), ..GaussianSet::default() };
    let mut with = GaussianSet { num_lidar: set.num_lidar + round.chosen.len(), ..GaussianSet::default() };
    for i in 0..set.len() {
        if i == set.num_lidar {
            with.append(&round.copies);
        }
        let one = set.select(&[i], 1);
        with.append(&one);
        if !round.removed.get(i).is_some_and(|&removed| removed) {
            without.append(&one);
        }
    }
    if set.len() == set.num_lidar {
        with.append(&round.copies);
    }
    [without, with]
}

fn gradients(problem: &Problem<'_>, set: &GaussianSet) -> Vec<GradientRow> {
    let views: Vec<&View> = problem.views.iter().collect();
    objective(set, &views, &problem.weights).gradient.attributes
}

fn largest(rows: &[GradientRow]) -> [f64; NUM_ATTRIBUTES] {
    std::array::from_fn(|c| rows.iter().map(|row| f64::from(row[c].abs())).fold(0.0, f64::max))
}

fn response_of(row: &GradientRow, largest: &[f64; NUM_ATTRIBUTES]) -> f64 {
    let share = |c: usize| if row[c] == 0.0 { 0.0 } else { f64::from(row[c].abs()) / largest[c] };
    (0..NUM_ATTRIBUTES).map(share).sum::<f64>() / NUM_ATTRIBUTES as f64
}

/// The `k` of `among` that are nearest to i, i itself left out.
fn around(set: &GaussianSet, i: usize, among: impl Iterator<Item = usize>, k: usize) -> Vec<usize> {
    let place = |j: usize| MEAN.map(|axis| f64::from(set.attributes[j][axis])).collect::<Vec<f64>>();
    let distance = |j: usize| place(i).iter().zip(place(j)).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
    let mut all: Vec<(f64, usize)> = among.filter(|&j| j != i).map(|j| (distance(j), j)).collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    all.into_iter().take(k).map(|(_, j)| j).collect()
}

fn response(problem: &Problem<'_>, round: &Round, config: &TargetsConfig) -> ActionDeltas {
    let set = problem.set;
    let before = gradients(problem, set);
    let [without, with] = branches(set, round).map(|branch| gradients(problem, &branch));
    let by = |rows: &[GradientRow]| largest(if config.normalise == Normalise::Branch { rows } else { &before });
    let kept: Vec<usize> = (0..set.num_lidar).filter(|&i| !round.removed[i]).collect();
    let sum = |pairs: Vec<(f64, f64)>| {
        let known = pairs.iter().any(|&pair| pair != (0.0, 0.0));
        known.then(|| pairs.iter().map(|(old, new)| new - old).sum())
    };
    let prune = |&i: &u32| {
        let near = around(set, i as usize, kept.iter().copied(), config.neighbours);
        let place = |j: usize| kept.iter().position(|&kept| kept == j).map_or(usize::MAX, |place| place);
        let pair = |j| (response_of(&before[j], &largest(&before)), response_of(&without[place(j)], &by(&without)));
        sum(near.into_iter().map(pair).collect())
    };
    let add = |&i: &u32| {
        let near = around(set, i as usize, 0..set.num_lidar, config.neighbours);
        let pair = |j: usize| (response_of(&before[j], &largest(&before)), response_of(&with[j], &by(&with)));
        sum(near.into_iter().map(pair).collect())
    };
    ActionDeltas { prune: round.chosen.iter().map(prune).collect(), add: round.chosen.iter().map(add).collect() }
}

fn magnitude(problem: &Problem<'_>, round: &Round) -> ActionDeltas {
    let before = gradients(problem, problem.set);
    let response = |&i: &u32| Some(response_of(&before[i as usize], &largest(&before))).filter(|&r| r != 0.0);
    let prune: Vec<Option<f64>> = round.chosen.iter().map(response).collect();
    ActionDeltas { add: prune.iter().map(|r| r.map(|r| -r)).collect(), prune }
}

fn footprint(problem: &Problem<'_>, round: &Round) -> ActionDeltas {
    let branches = branches(problem.set, round);
    let splats = to_physical(problem.set);
    let mut sums = vec![[0.0_f64; 2]; round.chosen.len()];
    let mut loss = 0.0;
    for view in problem.views {
        let counts = LossCounts::of(view);
        let map = |set: &GaussianSet| {
            let drawn = render(&to_physical(set), &view.pinhole, BEHIND);
            loss_map(&drawn, view, &problem.weights, &counts)
        };
        let before = map(problem.set);
        loss += before.total / problem.views.len() as f64;
        let state = render_for_gradient(&splats, &view.pinhole, BEHIND);
        for (action, branch) in branches.iter().enumerate() {
            let changes: Vec<f32> = map(branch).values.iter().zip(&before.values).map(|(new, old)| new - old).collect();
            // The gradient by red of an image whose red is weighted by the changes: their sum under the blending weights.
            let rgb = changes.iter().flat_map(|&change| [change, 0.0, 0.0]).collect();
            let by_colour =
                backward(&splats, &view.pinhole, &state, &ImageGradient { rgb, ..ImageGradient::default() });
            for (sum, &i) in sums.iter_mut().zip(&round.chosen) {
                sum[action] += f64::from(by_colour[i as usize].colour[0]);
            }
        }
    }
    let share_of_loss = |action: usize| sums.iter().map(|sum| Some(sum[action] / loss).filter(|&d| d != 0.0)).collect();
    ActionDeltas { prune: share_of_loss(0), add: share_of_loss(1) }
}

/// Targets of raw deltas, `None` where masked.
pub fn targets(deltas: [&[Option<f64>]; 2], config: &TargetsConfig) -> [Vec<Option<f64>>; 2] {
    let log = |d: f64| if d < 0.0 { -(1.0 - d / config.log_scale).ln() } else { (1.0 + d / config.log_scale).ln() };
    let own = |a: usize| deltas[a].iter().flatten().map(|&d| log(d)).collect::<Vec<f64>>();
    [0, 1].map(|a| {
        let population = if config.zscore == ZScore::Joint { [own(0), own(1)].concat() } else { own(a) };
        let mean = population.iter().sum::<f64>() / population.len() as f64;
        let variance = population.iter().map(|t| (t - mean).powi(2)).sum::<f64>() / population.len() as f64;
        let y = |d: &Option<f64>| d.map(|d| 1.0 / (1.0 + ((log(d) - mean) / variance.sqrt()).exp()));
        deltas[a].iter().map(y).collect()
    })
}
