//! Flags that a program makes from a table of its library, one for each row.

use std::marker::PhantomData;

use clap::{Arg, ArgMatches, Args, Command, Error, FromArgMatches, builder::PossibleValue};

/// One flag of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FlagRow {
    /// Its name, without the dashes.
    pub name: &'static str,
    /// What stands for its value in help texts.
    pub value: &'static str,
    /// What it is, for help texts, and its default.
    pub help: &'static str,
    /// The words that it takes, with what each means; none where [`FlagTable::set`] alone decides.
    pub words: &'static [(&'static str, &'static str)],
    /// Other words that are understood, each with the one that it stands for.
    pub aliases: &'static [(&'static str, &'static str)],
    /// The argument beside which it may not stand.
    pub conflicts_with: Option<&'static str>,
}

/// A table of flags, each of which changes one thing of a target.
pub trait FlagTable: 'static {
    /// What the flags change.
    type Target: Default;

    /// The rows, in the order in which the flags are listed and applied.
    fn rows() -> Vec<FlagRow>;

    /// Changes the target as the flag of this name asks.
    ///
    /// # Errors
    /// What was expected instead of the value.
    fn set(target: &mut Self::Target, name: &str, value: &str) -> Result<(), String>;
}

/// The flags of a table that were given, in the table's order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TableArgs<T>(Vec<(&'static str, String)>, PhantomData<T>);

impl<T: FlagTable> TableArgs<T> {
    /// `base`, but for what the flags say.
    pub fn of(&self, base: T::Target) -> T::Target {
        let mut target = base;
        for (name, value) in &self.0 {
            // A value that could not be read was refused before.
            let _ = T::set(&mut target, name, value);
        }
        target
    }

    /// The first flag that was given.
    pub fn first(&self) -> Option<&'static str> {
        self.0.first().map(|(name, _)| *name)
    }

    /// Whether one of these was given.
    pub fn any(&self, names: &[&str]) -> bool {
        names.iter().any(|name| self.value(name).is_some())
    }

    /// The value that was asked for.
    pub fn value(&self, name: &str) -> Option<&str> {
        self.0.iter().find(|(other, _)| *other == name).map(|(_, value)| value.as_str())
    }
}

fn flag<T: FlagTable>(row: FlagRow) -> Arg {
    let flag = Arg::new(row.name).long(row.name).help(row.help).value_name(row.value);
    let flag = if let Some(other) = row.conflicts_with { flag.conflicts_with(other) } else { flag };
    if row.words.is_empty() {
        let read = move |text: &str| T::set(&mut T::Target::default(), row.name, text).map(|()| text.to_owned());
        return flag.value_parser(read);
    }
    let word = |&(word, help): &(&'static str, &'static str)| {
        let aliases = row.aliases.iter().filter(|(_, known)| *known == word).map(|(alias, _)| *alias);
        PossibleValue::new(word).help(help).aliases(aliases)
    };
    flag.value_parser(row.words.iter().map(word).collect::<Vec<_>>())
}

impl<T: FlagTable> Args for TableArgs<T> {
    fn augment_args(command: Command) -> Command {
        command.args(T::rows().into_iter().map(flag::<T>))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl<T: FlagTable> FromArgMatches for TableArgs<T> {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, Error> {
        let given = |row: FlagRow| Some((row.name, matches.get_one::<String>(row.name)?.clone()));
        Ok(Self(T::rows().into_iter().filter_map(given).collect(), PhantomData))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    /// A size, and whether it is kept.
    #[derive(Clone, Debug)]
    struct Sizes;

    impl FlagTable for Sizes {
        type Target = (u32, bool);

        fn rows() -> Vec<FlagRow> {
            let size = FlagRow {
                name: "size",
                value: "N",
                help: "Size [default: 0]",
                words: &[],
                aliases: &[],
                conflicts_with: Some("all"),
            };
            let words = &[("yes", "Kept"), ("no", "Not kept")];
            vec![size, FlagRow { name: "keep", words, aliases: &[("never", "no")], conflicts_with: None, ..size }]
        }

        fn set(target: &mut Self::Target, name: &str, value: &str) -> Result<(), String> {
            match name {
                "size" => target.0 = value.parse().map_err(|_error| format!("expected a size, found {value}"))?,
                _ => target.1 = value == "yes",
            }
            Ok(())
        }
    }

    #[derive(Debug, Parser)]
    struct Line {
        #[arg(long)]
        all: bool,
        #[command(flatten)]
        sizes: TableArgs<Sizes>,
    }

    fn parse(line: &str) -> Result<Line, Error> {
        Line::try_parse_from(line.split(' '))
    }

    #[test]
    fn given_flags_change_the_target_and_no_others_do() {
        let Ok(Line { all, sizes }) = parse("p --keep never --size 3") else { panic!("the line is sound") };
        assert_eq!((all, sizes.of((7, true)), sizes.first()), (false, (3, false), Some("size")));
        assert_eq!((sizes.value("keep"), sizes.value("size")), (Some("never"), Some("3")));
        assert!(parse("p --all").is_ok_and(|line| line.all && line.sizes.of((7, true)) == (7, true)));
    }

    #[test]
    fn what_the_table_refuses_is_refused_with_its_reason() {
        let said = |line: &str| parse(line).err().map_or(String::new(), |error| error.to_string());
        assert!(said("p --size big").contains("expected a size, found big"));
        assert!(said("p --keep maybe").contains("possible values: yes, no"));
        assert!(said("p --all --size 3").contains("cannot be used with"));
    }
}
