//! From values along several axes to the configurations that differ.

use lgs_engine::{
    densify::{Density, Limit, Scope, Thresholds},
    recipe::Recipe,
    refine::{LineSearch, PixelStride},
};

use super::setting::{Setting, Weights};

/// An axis of a grid: options of a recipe that have one value together.
#[derive(Clone, Copy, Debug)]
pub struct Axis {
    /// Its name, as flags have it but for the dashes in front.
    pub name: &'static str,
    /// Names of the options.
    pub knobs: &'static [&'static str],
    /// The word that leaves the recipe as it is; empty where there is none.
    pub none: &'static str,
    /// The values that are tried where nobody says otherwise, separated by commas.
    pub usual: &'static str,
    /// What it is, for help texts.
    pub help: &'static str,
}

/// All of them but those of per-scene optimisation.
pub const AXES: [Axis; 12] = [
    Axis { name: "background", knobs: &["background"], none: "", usual: "auto,gaps", help: "Backgrounds" },
    Axis {
        name: "coarseness",
        knobs: &["coarseness"],
        none: "",
        usual: "1",
        help: "How coarse scenes are to begin with, 0 to 8",
    },
    Axis {
        name: "query",
        knobs: &["query"],
        none: "",
        usual: "on",
        help: "Whether primitives ask their nearest of other timestamps, for weights that have a query",
    },
    Axis {
        name: "density",
        knobs: &["density"],
        none: "",
        usual: "exact,off",
        help: "Who prunes and adds primitives: exact, off; policy and random for weights that have a policy",
    },
    Axis {
        name: "density-scope",
        knobs: &["density-scope"],
        none: "",
        usual: "all",
        help: "Which Gaussians exact pruning may take",
    },
    Axis {
        name: "theta",
        knobs: &["theta-prune", "theta-add"],
        none: "",
        usual: "0.7",
        help: "Scores above which the policy prunes, and adds, 0 to 1",
    },
    Axis {
        name: "max-gaussians",
        knobs: &["max-gaussians"],
        none: "usual",
        usual: "usual",
        help: "Largest numbers of Gaussians after pruning and adding, of those that the density may change, shares of those before, none, or \
               usual: 70% with exact effects, else none",
    },
    Axis {
        name: "refine-steps",
        knobs: &["refine-steps"],
        none: "",
        usual: "0,1,3",
        help: "Steps of the learned refinement",
    },
    Axis {
        name: "line-search",
        knobs: &["line-search"],
        none: "",
        usual: "auto",
        help: "Learned steps after which every Gaussian's length of the step is searched for",
    },
    Axis {
        name: "refine-views",
        knobs: &["refine-views"],
        none: "all",
        usual: "all",
        help: "Input views that a step of a refinement looks at, or all",
    },
    Axis {
        name: "pixel-stride",
        knobs: &["pixel-stride"],
        none: "",
        usual: "auto",
        help: "How far apart the pixels are that a step draws: auto or 1 to 64",
    },
    Axis {
        name: "device",
        knobs: &["device"],
        none: "",
        usual: "auto",
        help: "Where views are drawn: auto, cpu, gpu or gpu:N",
    },
];

impl Axis {
    /// A recipe with a value of this axis.
    ///
    /// # Errors
    /// What was expected instead of the value.
    pub fn apply(&self, recipe: Recipe, value: &str) -> Result<Recipe, String> {
        let mut changed = recipe;
        if self.none.is_empty() || value != self.none {
            self.knobs.iter().try_for_each(|name| changed.set(name, value))?;
        }
        if matches!(changed.max_gaussians, Some(Limit::Count(0) | Limit::Percent(0))) {
            return Err(format!("expected a number or a share above 0, or none, found {value}"));
        }
        Ok(changed)
    }
}

/// What is tried along each axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Axes {
    /// Every combination of the values along [`AXES`].
    pub recipes: Vec<Recipe>,
    /// Numbers of passes of per-scene optimisation from the initial Gaussians.
    pub adam: Vec<usize>,
    /// Numbers of passes of per-scene optimisation after the learned refinement.
    pub then_adam: Vec<usize>,
}

/// Every combination of the values `of` each axis.
///
/// # Errors
/// What was expected instead of a value.
pub fn combinations<'a>(of: impl Fn(&Axis) -> Vec<&'a str>) -> Result<Vec<Recipe>, String> {
    AXES.iter().try_fold(vec![Recipe::default()], |recipes, axis| {
        let values = of(axis);
        recipes.iter().flat_map(|&recipe| values.iter().map(move |value| axis.apply(recipe, value))).collect()
    })
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
    /// How lengths of steps are searched for where nobody says otherwise.
    pub line_search: LineSearch,
}

/// Configurations that one run of the pipeline passes through: the same but for ascending numbers of passes of per-scene optimisation. After
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

/// The runs that come to every configuration of several grids once, in the order of the grids: what a model has no part for is not told apart,
/// and what a refinement looks at is not where there is none.
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

/// The runs of a grid; some come to the same configuration.
fn runs(axes: &Axes, models: &[Parts]) -> Vec<Run> {
    let mut runs = Vec::new();
    for (index, model) in models.iter().enumerate() {
        for &recipe in &axes.recipes {
            let setting = Setting { weights: Some(model.weights.clone()), recipe: with_model(recipe, model) };
            runs.extend(marked(Some(index), &setting, &axes.then_adam));
        }
    }
    for &recipe in &axes.recipes {
        let Recipe { refine_views, pixel_stride, .. } = recipe;
        let initial = Recipe { query: false, ..Recipe::initial(recipe.start()) };
        let recipe = Recipe { refine_views, pixel_stride, ..initial };
        runs.extend(marked(None, &Setting { weights: None, recipe }, &axes.adam));
    }
    runs
}

/// The recipe without what makes no difference to a model.
fn with_model(recipe: Recipe, model: &Parts) -> Recipe {
    let acts = match recipe.density {
        Density::Off => false,
        Density::Exact => true,
        Density::Policy | Density::Random => model.policy,
    };
    let exact = recipe.density == Density::Exact;
    let line_search = match recipe.line_search {
        // The only step is the last one.
        LineSearch::Last if recipe.refine_steps == 1 => LineSearch::Every,
        line_search => line_search,
    };
    Recipe {
        network: true,
        query: recipe.query && model.query,
        density: if acts { recipe.density } else { Density::Off },
        density_scope: if exact { recipe.density_scope } else { Scope::All },
        thresholds: if acts && !exact { recipe.thresholds } else { Thresholds::default() },
        max_gaussians: recipe.max_gaussians.filter(|_| acts),
        line_search: if recipe.refine_steps == 0 || line_search == model.line_search {
            LineSearch::Auto
        } else {
            line_search
        },
        ..recipe
    }
}

/// The runs that come to a configuration with each of these numbers of passes of per-scene optimisation.
fn marked(network: Option<usize>, base: &Setting, adam: &[usize]) -> Vec<Run> {
    let mut marks = adam.to_vec();
    marks.sort_unstable();
    marks.dedup();
    let setting = |&adam_passes: &usize| {
        let recipe = Recipe { adam_passes, ..base.recipe };
        let refine_views = recipe.refine_views.filter(|_| recipe.refines());
        let pixel_stride = if recipe.draws_inputs() { recipe.pixel_stride } else { PixelStride::Auto };
        Setting { recipe: Recipe { refine_views, pixel_stride, ..recipe }, ..base.clone() }
    };
    let settings = marks.iter().map(setting);
    let (none, some): (Vec<_>, Vec<_>) =
        settings.partition(|s| base.recipe.refine_steps > 0 && s.recipe.adam_passes == 0);
    [none, some].into_iter().filter(|all| !all.is_empty()).map(|settings| Run { network, settings }).collect()
}

#[cfg(test)]
mod tests {
    use lgs_engine::gaussians::{Coarseness, background::Mode};

    use super::*;

    /// A grid of these values, an axis that is not named being as few as can be.
    fn axes(values: &[(&str, &str)]) -> Axes {
        let axis_values = |axis: &Axis| {
            let given = values.iter().find(|(name, _)| *name == axis.name).map(|(_, values)| *values);
            given.unwrap_or_else(|| axis.usual.split(',').next().unwrap()).split(',').collect()
        };
        Axes { recipes: combinations(axis_values).unwrap(), adam: vec![30, 10, 10], then_adam: vec![0] }
    }

    const ALL: [(&str, &str); 6] = [
        ("background", "auto,off"),
        ("refine-steps", "0,3"),
        ("query", "on,off"),
        ("density", "policy,off"),
        ("theta", "0.5,0.7"),
        ("max-gaussians", "none,100"),
    ];

    fn runs(axes: &Axes, models: &[Parts]) -> Vec<Run> {
        runs_of(std::slice::from_ref(axes), models)
    }

    fn model(query: bool, policy: bool) -> Parts {
        Parts {
            weights: Weights { name: "w".to_owned(), sha256: "00".to_owned() },
            query,
            policy,
            line_search: LineSearch::Every,
        }
    }

    #[test]
    fn what_a_model_lacks_is_not_told_apart() {
        let learned = |model| runs(&axes(&ALL), &[model]).iter().filter(|run| run.network.is_some()).count();
        // Of the policy's four ways and the one without it.
        assert_eq!(learned(model(true, true)), 2 * 2 * 2 * (4 + 1));
        assert_eq!(learned(model(true, false)), 2 * 2 * 2);
        assert_eq!(learned(model(false, false)), 2 * 2);
    }

    #[test]
    fn the_reference_is_one_run_for_all_of_its_marks() {
        let all = runs(&axes(&ALL), &[]);
        assert_eq!(all.len(), 2);
        assert_eq!(all[0].settings.iter().map(Setting::steps).collect::<Vec<_>>(), [10, 30]);
        assert!(runs(&Axes { adam: Vec::new(), ..axes(&ALL) }, &[]).is_empty());
    }

    #[test]
    fn every_background_is_as_coarse_as_every_value_says() {
        let coarseness = [Coarseness::FINEST, Coarseness::default()];
        let all = runs(&axes(&[("background", "auto,off"), ("coarseness", "0,1")]), &[]);
        let found: Vec<(Mode, Coarseness)> =
            all.iter().map(|run| (run.settings[0].recipe.background, run.settings[0].recipe.coarseness)).collect();
        assert_eq!(found, [Mode::Auto, Mode::Off].map(|mode| [0, 1].map(|k| (mode, coarseness[k]))).concat());
    }

    #[test]
    fn what_two_grids_share_is_measured_once() {
        let quick = Axes { adam: vec![0, 10], then_adam: vec![0], ..axes(&ALL) };
        let all = runs_of(&[axes(&ALL), quick.clone(), quick], &[]);
        let steps: Vec<Vec<usize>> = all.iter().map(|run| run.settings.iter().map(Setting::steps).collect()).collect();
        assert_eq!(steps, [vec![10, 30], vec![10, 30], vec![0], vec![0]]);
    }

    #[test]
    fn what_a_refinement_looks_at_is_told_apart_where_there_is_one() {
        let numbers = |stride, steps: &[[usize; 2]]| -> Vec<[usize; 3]> {
            steps.iter().map(|&[learned, adam]| [learned, adam, stride]).collect()
        };
        let steps = |setting: &Setting| {
            let Recipe { refine_steps, adam_passes, pixel_stride, .. } = setting.recipe;
            [refine_steps, adam_passes, if pixel_stride == PixelStride::Auto { 0 } else { pixel_stride.of(&[]) }]
        };
        let found = |density| -> Vec<Vec<[usize; 3]>> {
            let few = [("refine-steps", "0,3"), ("pixel-stride", "1,2"), ("density", density)];
            let axes = Axes { adam: Vec::new(), then_adam: vec![10, 0], ..axes(&few) };
            let all = runs(&axes, &[model(true, false)]);
            all.iter().map(|run| run.settings.iter().map(steps).collect()).collect()
        };
        // Without any step there is nothing to look at; what comes after three steps is told apart from the first on.
        let unrefined_first = [numbers(0, &[[0, 0]]), numbers(1, &[[0, 10]])].concat();
        let learned = |stride| [numbers(stride, &[[3, 0]]), numbers(stride, &[[3, 10]])];
        let refined = [learned(1), learned(2)].concat();
        assert_eq!(found("off"), [vec![unrefined_first, numbers(2, &[[0, 10]])], refined.clone()].concat());
        // Who is needed is seen in the views.
        let pruned = [1, 2].map(|stride| numbers(stride, &[[0, 0], [0, 10]]));
        assert_eq!(found("exact"), [pruned.to_vec(), refined].concat());
    }

    #[test]
    fn a_line_search_is_told_apart_where_there_are_steps_to_search_along() {
        let few = [("refine-steps", "0,1,3"), ("line-search", "auto,every,last,off")];
        let axes = Axes { adam: Vec::new(), ..axes(&few) };
        let num_runs = |line_search| runs(&axes, &[Parts { line_search, ..model(true, false) }]).len();
        assert_eq!([num_runs(LineSearch::Every), num_runs(LineSearch::Off)], [1 + 2 + 3; 2]);
    }
}
