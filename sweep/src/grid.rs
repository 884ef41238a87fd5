//! From values along several axes to the configurations that differ.

use std::num::NonZeroUsize;

use clap::ValueEnum;
use lgs_engine::{
    densify::{Density, Limit, Thresholds},
    gaussians::{Coarseness, Start, background::Mode},
    recipe::Recipe,
    refine::LineSearch,
};

use super::setting::{Setting, Weights};

/// Whether a part runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Switch {
    /// It does.
    On,
    /// It does not.
    Off,
}

/// What is tried along each axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Axes {
    /// Backgrounds.
    pub background: Vec<Mode>,
    /// How coarse scenes are to begin with.
    pub coarseness: Vec<Coarseness>,
    /// Steps of the learned refinement.
    pub refine_steps: Vec<usize>,
    /// Whether the query runs.
    pub query: Vec<Switch>,
    /// Who prunes and adds.
    pub density: Vec<Density>,
    /// Scores above which the policy acts.
    pub theta: Vec<f32>,
    /// Budgets of the set update; `None` for none.
    pub max_gaussians: Vec<Option<Limit>>,
    /// Numbers of steps of per-scene optimisation from the initial Gaussians.
    pub adam: Vec<usize>,
    /// Numbers of steps of per-scene optimisation after the learned refinement.
    pub then_adam: Vec<usize>,
    /// Views that a step of a refinement looks at; `None` for all.
    pub refine_views: Vec<Option<NonZeroUsize>>,
    /// How many times smaller in width and height the images are that a step looks at.
    pub refine_reduce: Vec<usize>,
    /// Learned steps whose lengths are searched for.
    pub line_search: Vec<LineSearch>,
}

/// Weights, and which of the optional parts their model has.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Parts {
    /// The weights.
    pub weights: Weights,
    /// Whether there is a query.
    pub query: bool,
    /// Whether there is a policy.
    pub policy: bool,
    /// Whether lengths of steps are searched for.
    pub line_search: bool,
}

/// Configurations that one run of the pipeline passes through: the same but for ascending numbers of steps of per-scene optimisation. After
/// learned steps, none is a run of its own: where some follow, the last learned one is measured with the gradient that the first of them takes.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    /// Which of the networks it uses; `None` for none.
    pub network: Option<usize>,
    /// The configurations, in the order in which the run comes to them.
    pub settings: Vec<Setting>,
}

impl Run {
    /// About what it costs, to weigh progress: steps of refinement, and what comes before them.
    pub fn weight(&self) -> u64 {
        3 + self.settings.iter().map(Setting::steps).max().unwrap_or(0) as u64
    }
}

/// The runs that come to every configuration of several grids once, in the order of the grids.
pub fn runs_of(grids: &[Axes], models: &[Parts]) -> Vec<Run> {
    let mut all: Vec<Run> = Vec::new();
    for mut run in grids.iter().flat_map(|axes| runs(axes, models)) {
        run.settings.retain(|setting| !all.iter().any(|other| other.settings.contains(setting)));
        if !run.settings.is_empty() {
            all.push(run);
        }
    }
    all
}

/// The runs that come to every configuration of the grid once: what a model has no part for is not told apart, and what a refinement looks
/// at is not where there is none.
pub fn runs(axes: &Axes, models: &[Parts]) -> Vec<Run> {
    let mut runs: Vec<Run> = Vec::new();
    let mut add = |index: Option<usize>, setting: Setting, learned: &[usize], adam: &[usize]| {
        let searches = index.is_some_and(|index| models[index].line_search);
        for &refine_steps in learned {
            for line_search in line_searches(axes, searches, refine_steps) {
                let base = Recipe { refine_steps, line_search, ..setting.recipe };
                for recipes in refinements(axes, base, adam) {
                    let of = |recipe| Setting { recipe, ..setting.clone() };
                    let run = Run { network: index, settings: recipes.into_iter().map(of).collect() };
                    if !run.settings.is_empty() && !runs.contains(&run) {
                        runs.push(run);
                    }
                }
            }
        }
    };
    for start in starts(axes) {
        for (index, model) in models.iter().enumerate() {
            for recipe in networks(axes, model, start) {
                let setting = Setting { weights: Some(model.weights.clone()), recipe };
                add(Some(index), setting, &axes.refine_steps, &axes.then_adam);
            }
        }
        let recipe = Recipe { query: false, density: Density::Off, ..Recipe::initial(start) };
        add(None, Setting { weights: None, recipe }, &[0], &axes.adam);
    }
    runs
}

/// What scenes begin with.
fn starts(axes: &Axes) -> impl Iterator<Item = Start> {
    let of = |&background| axes.coarseness.iter().map(move |&coarseness| Start { background, coarseness });
    axes.background.iter().flat_map(of)
}

/// The ways to search for the lengths of so many learned steps that differ.
fn line_searches(axes: &Axes, searches: bool, learned: usize) -> Vec<LineSearch> {
    let of = |&line_search: &LineSearch| match line_search {
        _ if !searches || learned == 0 => LineSearch::Every,
        // The only step is the last one.
        LineSearch::Last if learned == 1 => LineSearch::Every,
        other => other,
    };
    axes.line_search.iter().map(of).collect()
}

/// The recipes with as many learned steps as `base`, those of one run together.
fn refinements(axes: &Axes, base: Recipe, adam: &[usize]) -> Vec<Vec<Recipe>> {
    let mut marks = adam.to_vec();
    marks.sort_unstable();
    marks.dedup();
    let learned = base.refine_steps;
    let (mut all, mut unrefined) = (Vec::new(), (learned == 0 && marks.first() == Some(&0)).then_some(base));
    for &refine_views in &axes.refine_views {
        for &refine_reduce in &axes.refine_reduce {
            let of = |&adam_steps: &usize| Recipe { adam_steps, refine_views, refine_reduce, ..base };
            let (none, some): (Vec<_>, Vec<_>) = marks.iter().map(of).partition(|recipe| recipe.adam_steps == 0);
            if learned > 0 {
                all.push(none);
            }
            all.push(unrefined.take().into_iter().chain(some).collect());
        }
    }
    all
}

/// The ways to use a model that differ.
fn networks(axes: &Axes, model: &Parts, start: Start) -> Vec<Recipe> {
    let mut found: Vec<Recipe> = Vec::new();
    for &query in &axes.query {
        for &density in &axes.density {
            for &theta in &axes.theta {
                for &max_gaussians in &axes.max_gaussians {
                    let acts = model.policy && density != Density::Off;
                    let recipe = Recipe {
                        network: true,
                        query: model.query && query == Switch::On,
                        density: if acts { density } else { Density::Off },
                        thresholds: if acts { Thresholds { prune: theta, add: theta } } else { Thresholds::default() },
                        max_gaussians: max_gaussians.filter(|_| acts),
                        ..Recipe::initial(start)
                    };
                    if !found.contains(&recipe) {
                        found.push(recipe);
                    }
                }
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axes() -> Axes {
        Axes {
            background: vec![Mode::Auto, Mode::Off],
            coarseness: vec![Coarseness::default()],
            refine_steps: vec![0, 3],
            query: vec![Switch::On, Switch::Off],
            density: vec![Density::Policy, Density::Off],
            theta: vec![0.5, 0.7],
            max_gaussians: vec![None, Some(Limit::Count(100))],
            adam: vec![30, 10, 10],
            then_adam: vec![0],
            refine_views: vec![None],
            refine_reduce: vec![1],
            line_search: vec![LineSearch::Every],
        }
    }

    fn model(query: bool, policy: bool) -> Parts {
        Parts { weights: Weights { name: "w".to_owned(), sha256: "00".to_owned() }, query, policy, line_search: true }
    }

    #[test]
    fn what_a_model_lacks_is_not_told_apart() {
        let learned = |model| runs(&axes(), &[model]).iter().filter(|run| run.network.is_some()).count();
        // Of the policy's four ways and the one without it.
        assert_eq!(learned(model(true, true)), 2 * 2 * 2 * (4 + 1));
        assert_eq!(learned(model(true, false)), 2 * 2 * 2);
        assert_eq!(learned(model(false, false)), 2 * 2);
    }

    #[test]
    fn the_reference_is_one_run_for_all_of_its_marks() {
        let all = runs(&axes(), &[]);
        assert_eq!(all.len(), 2);
        assert_eq!(all[0].settings.iter().map(Setting::steps).collect::<Vec<_>>(), [10, 30]);
        assert!(runs(&Axes { adam: Vec::new(), ..axes() }, &[]).is_empty());
    }

    #[test]
    fn every_background_is_as_coarse_as_every_value_says() {
        let coarseness = vec![Coarseness::FINEST, Coarseness::default()];
        let all = runs(&Axes { coarseness: coarseness.clone(), ..axes() }, &[]);
        let found: Vec<(Mode, Coarseness)> =
            all.iter().map(|run| (run.settings[0].recipe.background, run.settings[0].recipe.coarseness)).collect();
        assert_eq!(found, [Mode::Auto, Mode::Off].map(|mode| [0, 1].map(|k| (mode, coarseness[k]))).concat());
    }

    #[test]
    fn what_two_grids_share_is_measured_once() {
        let quick = Axes { adam: vec![0, 10], then_adam: vec![0], ..axes() };
        let all = runs_of(&[axes(), quick.clone(), quick], &[]);
        let steps: Vec<Vec<usize>> = all.iter().map(|run| run.settings.iter().map(Setting::steps).collect()).collect();
        assert_eq!(steps, [vec![10, 30], vec![10, 30], vec![0], vec![0]]);
    }

    #[test]
    fn what_a_refinement_looks_at_is_told_apart_where_there_is_one() {
        let axes = Axes {
            background: vec![Mode::Auto],
            query: vec![Switch::On],
            density: vec![Density::Off],
            adam: Vec::new(),
            then_adam: vec![10, 0],
            refine_reduce: vec![1, 2],
            ..axes()
        };
        let all = runs(&axes, &[model(true, false)]);
        let of = |reduce, steps: &[[usize; 2]]| -> Vec<[usize; 3]> {
            steps.iter().map(|&[learned, adam]| [learned, adam, reduce]).collect()
        };
        let steps = |setting: &Setting| {
            let Recipe { refine_steps, adam_steps, refine_reduce, .. } = setting.recipe;
            [refine_steps, adam_steps, refine_reduce]
        };
        let found: Vec<Vec<[usize; 3]>> = all.iter().map(|run| run.settings.iter().map(steps).collect()).collect();
        // Without any step there is nothing to look at; what comes after three steps is told apart from the first on.
        let unrefined_first = [of(1, &[[0, 0]]), of(1, &[[0, 10]])].concat();
        let learned = |reduce| [of(reduce, &[[3, 0]]), of(reduce, &[[3, 10]])];
        assert_eq!(found, [vec![unrefined_first, of(2, &[[0, 10]])], [learned(1), learned(2)].concat()].concat());
    }

    #[test]
    fn a_line_search_is_told_apart_where_there_are_steps_to_search_along() {
        let axes = Axes {
            background: vec![Mode::Auto],
            refine_steps: vec![0, 1, 3],
            query: vec![Switch::On],
            density: vec![Density::Off],
            adam: Vec::new(),
            line_search: vec![LineSearch::Every, LineSearch::Last, LineSearch::Off],
            ..axes()
        };
        let of = |line_search| runs(&axes, &[Parts { line_search, ..model(true, false) }]).len();
        assert_eq!((of(true), of(false)), (1 + 2 + 3, 3));
    }
}
