//! Flags of the grid: the values along each axis.

use clap::{Arg, ArgMatches, Args, Command, Error, FromArgMatches, Parser};
use lgs_engine::recipe::Recipe;
use lgs_measure::sweep::grid::{AXES, Axes, Axis, combinations};

use crate::values::steps;

/// What is tried along each axis.
#[derive(Clone, Debug, Args)]
pub(crate) struct GridArgs {
    #[command(flatten)]
    recipes: RecipesArgs,

    /// Passes of per-scene optimisation from the initial Gaussians, the reference; `--no-adam` leaves it out
    #[arg(long, value_name = "A,B", value_delimiter = ',', default_value = "0,2,5,10,20,30", value_parser = steps::<100_000>)]
    adam: Vec<usize>,

    /// Leave the reference out
    #[arg(long)]
    no_adam: bool,

    /// Passes of per-scene optimisation after the learned refinement
    #[arg(long, value_name = "A,B", value_delimiter = ',', default_value = "0,2,5,10", value_parser = steps::<100_000>)]
    then_adam: Vec<usize>,
}

/// Every combination of the values of the options of a recipe.
#[derive(Clone, Debug)]
struct RecipesArgs(Vec<Recipe>);

fn flag(axis: &'static Axis) -> Arg {
    let read = |text: &str| axis.apply(Recipe::default(), text).map(|_| text.to_owned());
    let flag = Arg::new(axis.name).long(axis.name).help(axis.help).value_name("A,B").value_delimiter(',');
    flag.default_value(axis.usual).value_parser(read)
}

impl Args for RecipesArgs {
    fn augment_args(command: Command) -> Command {
        command.args(AXES.iter().map(flag))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for RecipesArgs {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, Error> {
        let axis_values = |axis: &Axis| {
            let values = matches.get_many::<String>(axis.name).into_iter().flatten();
            values.map(String::as_str).collect()
        };
        combinations(axis_values).map(Self).map_err(|wrong| Error::raw(clap::error::ErrorKind::InvalidValue, wrong))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
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
            recipes: self.recipes.0.clone(),
            adam: if self.no_adam { Vec::new() } else { self.adam.clone() },
            then_adam: self.then_adam.clone(),
        }
    }
}
