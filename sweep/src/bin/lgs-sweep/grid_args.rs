//! Flags of the grid: the values along each axis.

use clap::{Args, Parser};
use lgs_engine::{
    densify::Density,
    gaussians::{Coarseness, background::Mode},
    refine::LineSearch,
};
use lgs_sweep::grid::{Axes, Switch};

use crate::values::{Most, Views, most, reduce, steps, theta, views};

/// What is tried along each axis.
#[derive(Clone, Debug, Args)]
pub(crate) struct GridArgs {
    /// Steps of the learned refinement
    #[arg(long, value_name = "A,B", value_delimiter = ',', default_value = "0,1,3", value_parser = steps::<1000>)]
    refine_steps: Vec<usize>,

    /// Whether primitives ask their nearest of other timestamps, for weights that have a query
    #[arg(long, value_name = "on,off", value_delimiter = ',', default_value = "on")]
    query: Vec<Switch>,

    /// Who prunes and adds primitives, for weights that have a policy
    #[arg(long, value_name = "A,B", value_delimiter = ',', default_value = "policy,off")]
    density: Vec<Density>,

    /// Scores above which the policy prunes, and adds, 0 to 1
    #[arg(long, value_name = "A,B", value_delimiter = ',', default_value = "0.7", value_parser = theta)]
    theta: Vec<f32>,

    /// Largest numbers of LiDAR Gaussians after pruning and adding, shares of those before, or `none`, where a policy acts
    #[arg(long, value_name = "N,P%,none", value_delimiter = ',', default_value = "none", value_parser = most)]
    max_gaussians: Vec<Most>,

    /// Backgrounds
    #[arg(long, value_name = "A,B", value_delimiter = ',', default_value = "auto,gaps")]
    background: Vec<Mode>,

    /// How coarse scenes are to begin with, 0 to 8
    #[arg(long, value_name = "A,B", value_delimiter = ',', default_value = "1")]
    coarseness: Vec<Coarseness>,

    /// Steps of per-scene optimisation from the initial Gaussians, the reference; `--no-adam` leaves it out
    #[arg(long, value_name = "A,B", value_delimiter = ',', default_value = "0,2,5,10,20,30", value_parser = steps::<100_000>)]
    adam: Vec<usize>,

    /// Leave the reference out
    #[arg(long)]
    no_adam: bool,

    /// Steps of per-scene optimisation after the learned refinement
    #[arg(long, value_name = "A,B", value_delimiter = ',', default_value = "0,2,5,10", value_parser = steps::<100_000>)]
    then_adam: Vec<usize>,

    /// Input views that a step of a refinement looks at, or `all`
    #[arg(long, value_name = "N,all", value_delimiter = ',', default_value = "all", value_parser = views)]
    refine_views: Vec<Views>,

    /// How many times smaller in width and height the images are that a step looks at, 1 to 64
    #[arg(long, value_name = "A,B", value_delimiter = ',', default_value = "1", value_parser = reduce)]
    refine_reduce: Vec<usize>,

    /// Learned steps after which every Gaussian's length of the step is searched for, with weights that do so
    #[arg(long, value_name = "A,B", value_delimiter = ',', default_value = "every")]
    line_search: Vec<LineSearch>,
}

/// A grid in one value.
#[derive(Debug, Parser)]
#[command(no_binary_name = true, disable_help_flag = true)]
struct Also {
    #[command(flatten)]
    grid: GridArgs,
}

/// The grid that flags in one text ask for.
pub(crate) fn also(text: &str) -> Result<GridArgs, String> {
    let parsed = Also::try_parse_from(text.split_whitespace());
    parsed.map(|also| also.grid).map_err(|error| {
        let said = error.to_string();
        said.lines().next().unwrap_or_default().trim_start_matches("error: ").to_owned()
    })
}

impl GridArgs {
    /// What is tried.
    pub(crate) fn axes(&self) -> Axes {
        Axes {
            background: self.background.clone(),
            coarseness: self.coarseness.clone(),
            refine_steps: self.refine_steps.clone(),
            query: self.query.clone(),
            density: self.density.clone(),
            theta: self.theta.clone(),
            max_gaussians: self.max_gaussians.iter().map(|most| most.0).collect(),
            adam: if self.no_adam { Vec::new() } else { self.adam.clone() },
            then_adam: self.then_adam.clone(),
            refine_views: self.refine_views.iter().map(|views| views.0).collect(),
            refine_reduce: self.refine_reduce.clone(),
            line_search: self.line_search.clone(),
        }
    }
}
