//! Which recipe runs.

use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use lgs_engine::{
    densify::Density,
    network::{model::Model, source::ModelSource},
    pipeline::{Begun, Deadline, Reconstruction, Run, Stage, Watch},
    plan::{Budget, ClipWork, REFINER, Record, choose, usual},
    recipe::Recipe,
    refine::LineSearch,
    report::BudgetRecord,
    views::View,
};

use crate::args::Args;

/// What runs, until when, and what is to be said about it.
#[derive(Debug)]
pub(crate) struct Plan {
    pub(crate) recipe: Recipe,
    /// When the scene has to be finished; `None` for no limit.
    pub(crate) until: Option<Instant>,
    /// How the budget was spent, but for the time that it took in the end.
    pub(crate) budget: Option<BudgetRecord>,
}

impl Plan {
    /// What runs. Passes of per-scene optimisation that only time decides on are the deadline's: recorded times are those without.
    pub(crate) fn run<'a>(&self, model: Option<&'a Model>, seed: u64) -> Run<'a> {
        let chosen = self.budget.as_ref().map(|budget| &budget.chosen);
        let adam_passes = chosen.map_or(self.recipe.adam_passes, |chosen| chosen.most_adam_passes);
        let adam_pass_s = chosen.map_or(0.0, |chosen| chosen.adam_pass_s);
        let deadline = self.until.map(|until| Deadline { until, adam_passes, adam_pass_s });
        Run { recipe: self.recipe, model, seed, deadline }
    }

    /// Notes how a budget was spent on `made`, by a run that began at `start`: the flags of the recipe are those that make it again.
    pub(crate) fn record_run(&mut self, made: &Reconstruction, start: Instant) {
        let Some(budget) = &mut self.budget else { return };
        budget.finished_s = start.elapsed().as_secs_f64();
        self.recipe.adam_passes = made.optimisation.as_ref().map_or(0, |summary| summary.losses.len());
        // A step that was taken back would be again.
        if let Some(refine) =
            made.network.as_ref().map(|network| &network.refine).filter(|refine| !refine.stopped_early)
        {
            // Of steps that time cut short, none was the last.
            if refine.steps < self.recipe.refine_steps && self.recipe.line_search == LineSearch::Last {
                self.recipe.line_search = LineSearch::Off;
            }
            self.recipe.refine_steps = refine.steps;
        }
        budget.chosen.recipe = self.recipe;
    }
}

/// What can be said against the flags before any work.
///
/// # Errors
/// A budget for what has no recorded times.
pub(crate) fn check(args: &Args) -> Result<()> {
    match (args.time_budget, &args.weights) {
        (Some(_), _) if args.recipe.value("max-gaussians").is_some() => {
            bail!(
                "--time-budget: expected no --max-gaussians beside it, found one: recorded ways to run have their own"
            )
        }
        (Some(_), weights) if !matches!(weights, ModelSource::Shipped | ModelSource::None) => {
            bail!("--time-budget: expected --weights tiny or none, whose times are recorded, found others")
        }
        _ => Ok(()),
    }
}

/// The plan for a run that began at `start` and has come as far as `begun`.
///
/// # Errors
/// Recorded times that cannot be read or have nothing for these weights.
pub(crate) fn plan(args: &Args, start: Instant, begun: &Begun<'_>, views: &[View], watch: &Watch<'_>) -> Result<Plan> {
    let network = args.weights != ModelSource::None;
    let Some(budget_s) = args.time_budget else {
        let base = match args.preset {
            Some(preset) => Record::shipped()?.preset(preset),
            None => usual(&args.weights, args.recipe.any(REFINER)),
        };
        let recipe = args.recipe.of(base);
        if args.recipe.value("max-gaussians").is_some() && !recipe.network {
            bail!("--max-gaussians: expected a network with a policy, found a preset that goes without one");
        }
        let scored = ["theta-prune", "theta-add"].into_iter().find(|name| args.recipe.value(name).is_some());
        if let Some(name) = scored.filter(|_| recipe.density == Density::Exact) {
            bail!("--{name}: expected --density policy or random beside it, found exact effects, which have no scores");
        }
        return Ok(Plan { recipe: Recipe { network: recipe.network && network, ..recipe }, until: None, budget: None });
    };
    let (now, until) = (Instant::now(), start + Duration::from_secs_f64(budget_s));
    let pixels = views.iter().map(|view| view.pinhole.num_pixels()).sum();
    let budget = Budget {
        work: ClipWork { points: begun.num_points(), pixels, views: views.len() },
        left: until.saturating_duration_since(now),
        begin_s: watch.times.get(Stage::Points),
        network,
    };
    let chosen = choose(&Record::shipped()?, &budget);
    let chosen = chosen.context("--time-budget: expected recorded times for these weights, found none")?;
    let before_s = now.duration_since(start).as_secs_f64();
    Ok(Plan {
        recipe: chosen.recipe,
        until: Some(until),
        budget: Some(BudgetRecord { budget_s, before_s, chosen, finished_s: 0.0 }),
    })
}
