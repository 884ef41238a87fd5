//! Values of flags that are one of a few words.

use std::{ffi::OsStr, fmt::Debug};

use clap::{
    Arg, Command, Error,
    builder::{PossibleValue, PossibleValuesParser, TypedValueParser},
};

/// Reads a flag whose value is one of a few words.
#[derive(Clone, Debug)]
pub struct WordParser<T: 'static>(&'static [(&'static str, T, &'static str)]);

/// A reader of the words of a table: word, value, help.
pub const fn words<T>(table: &'static [(&'static str, T, &'static str)]) -> WordParser<T> {
    WordParser(table)
}

impl<T> WordParser<T> {
    fn possible(&self) -> impl Iterator<Item = PossibleValue> {
        self.0.iter().map(|(word, _, help)| PossibleValue::new(*word).help(*help))
    }
}

impl<T: Clone + Debug + Send + Sync + 'static> TypedValueParser for WordParser<T> {
    type Value = T;

    fn parse_ref(&self, command: &Command, arg: Option<&Arg>, value: &OsStr) -> Result<T, Error> {
        let text = PossibleValuesParser::new(self.possible()).parse_ref(command, arg, value)?;
        let known = self.0.iter().find(|(word, ..)| *word == text);
        known.map(|(_, value, _)| value.clone()).ok_or_else(|| Error::new(clap::error::ErrorKind::InvalidValue))
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        Some(Box::new(self.possible()))
    }
}
