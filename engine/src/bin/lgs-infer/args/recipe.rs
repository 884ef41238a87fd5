//! Flags of the recipe: one for each option of the engine's table.

use clap::{Arg, ArgMatches, Args, Command, Error, FromArgMatches, builder::PossibleValue};
use lgs_engine::recipe::{KNOBS, Knob, Recipe};

/// What of the recipe was asked for, in the order of the table.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct RecipeArgs(Vec<(&'static str, String)>);

impl RecipeArgs {
    /// `base`, but for what the flags say.
    pub(crate) fn of(&self, base: Recipe) -> Recipe {
        let mut recipe = base;
        for (knob, value) in KNOBS.iter().filter_map(|knob| Some((knob, self.value(knob.name)?))) {
            // A value that could not be read was refused before.
            let _ = (knob.set)(&mut recipe, value);
        }
        recipe
    }

    /// The value that was asked for.
    pub(crate) fn value(&self, name: &str) -> Option<&str> {
        self.0.iter().find(|(other, _)| *other == name).map(|(_, value)| value.as_str())
    }
}

/// The flag of the time budget.
const TIME_BUDGET: &str = "time_budget";

fn flag(knob: &'static Knob) -> Arg {
    let flag = Arg::new(knob.name).long(knob.name).help(knob.help);
    let flag = if knob.by_budget { flag.conflicts_with(TIME_BUDGET) } else { flag };
    let read = |text: &str| (knob.set)(&mut Recipe::default(), text).map(|()| text.to_owned());
    if knob.words.is_empty() {
        return flag.value_name(knob.value).value_parser(read);
    }
    let words: Vec<PossibleValue> = knob
        .words
        .iter()
        .map(|&(word, help)| PossibleValue::new(word).help(help).aliases(knob.aliases(word)))
        .collect();
    flag.value_name(knob.value).value_parser(words)
}

impl Args for RecipeArgs {
    fn augment_args(command: Command) -> Command {
        command.args(KNOBS.iter().map(flag))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for RecipeArgs {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, Error> {
        let given = KNOBS.iter().filter_map(|knob| Some((knob.name, matches.get_one::<String>(knob.name)?.clone())));
        Ok(Self(given.collect()))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}
