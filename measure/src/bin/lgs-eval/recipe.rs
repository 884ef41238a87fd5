//! Flags of the recipe: one for each option of the engine's table.

use clap::{Arg, ArgMatches, Args, Command, Error, FromArgMatches, builder::PossibleValue};
use lgs_engine::recipe::{KNOBS, Knob, Recipe};

/// What of the recipe was asked for, in the order of the table.
#[derive(Clone, Debug, Default)]
pub(crate) struct RecipeArgs(Vec<(&'static Knob, String)>);

impl RecipeArgs {
    /// `base`, but for what the flags say.
    pub(crate) fn of(&self, base: Recipe) -> Recipe {
        let mut recipe = base;
        for (knob, value) in &self.0 {
            // A value that could not be read was refused before.
            let _ = (knob.set)(&mut recipe, value);
        }
        recipe
    }

    /// The first flag that was given.
    pub(crate) fn first(&self) -> Option<&'static str> {
        self.0.first().map(|(knob, _)| knob.name)
    }

    /// The value that was asked for.
    pub(crate) fn value(&self, name: &str) -> Option<&str> {
        self.0.iter().find(|(knob, _)| knob.name == name).map(|(_, value)| value.as_str())
    }
}

fn flag(knob: &'static Knob) -> Arg {
    let flag = Arg::new(knob.name).long(knob.name).help(knob.help).value_name(knob.value);
    if knob.words.is_empty() {
        let read = |text: &str| (knob.set)(&mut Recipe::default(), text).map(|()| text.to_owned());
        return flag.value_parser(read);
    }
    let word =
        |&(word, help): &(&'static str, &'static str)| PossibleValue::new(word).help(help).aliases(knob.aliases(word));
    flag.value_parser(knob.words.iter().map(word).collect::<Vec<_>>())
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
        let given = KNOBS.iter().filter_map(|knob| Some((knob, matches.get_one::<String>(knob.name)?.clone())));
        Ok(Self(given.collect()))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}
