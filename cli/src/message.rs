//! What people are told on standard error: one line, in which settings have the names of this program's flags.

use std::{
    error::Error,
    io::{self, Write},
};

use clap::{Command, error::ErrorKind};

/// The setting that an error is about, as the error's text names it; `None` where it is about something else.
pub type SettingOf = for<'e> fn(&'e (dyn Error + 'static)) -> Option<&'e str>;

/// Prints a message as one line. When even that is impossible the exit code says it alone.
pub(crate) fn tell(name: &str, message: &str) {
    let line: Vec<&str> = message.split_whitespace().collect();
    let _ = writeln!(io::stderr(), "{name}: {}", line.join(" "));
}

/// What is wrong with the command line, without the usage that clap puts below it.
pub(crate) fn usage(error: &clap::Error) -> String {
    if error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        return "expected a command, found none (see --help)".to_owned();
    }
    let text = error.to_string();
    let what = text.split("\n\n").next().unwrap_or(&text);
    format!("{} (see --help)", what.trim_start_matches("error: "))
}

/// The error and its causes, each once, as some errors name their cause themselves. Settings that are flags of `command` have their dashes.
pub(crate) fn chain(error: &(dyn Error + 'static), setting: SettingOf, command: &Command) -> String {
    let text = |error: &(dyn Error + 'static)| match setting(error) {
        Some(name) => with_flags(&error.to_string(), name, command),
        None => error.to_string(),
    };
    let (mut line, mut cause) = (text(error), error.source());
    while let Some(next) = cause {
        let text = text(next);
        if !line.ends_with(&text) {
            line = line + ": " + &text;
        }
        cause = next.source();
    }
    line
}

/// The text of an error about a setting, with the flags for the setting and for others that it names in backticks.
fn with_flags(text: &str, setting: &str, command: &Command) -> String {
    let mut text = text.to_owned();
    if is_flag(command, setting) {
        text = text.replacen(&format!("{setting}: "), &format!("--{setting}: "), 1);
    }
    let quoted = |text: &str| text.split('`').skip(1).step_by(2).map(str::to_owned).collect::<Vec<_>>();
    for name in quoted(&text) {
        let word = name.split(' ').next().unwrap_or_default();
        if is_flag(command, word) {
            text = text.replacen(&format!("`{name}`"), &format!("--{name}"), 1);
        }
    }
    text
}

/// Whether a program, or one of its commands, has a flag of this name.
fn is_flag(command: &Command, name: &str) -> bool {
    command.get_arguments().any(|arg| arg.get_long() == Some(name))
        || command.get_subcommands().any(|command| is_flag(command, name))
}

#[cfg(test)]
mod tests {
    use clap::{Arg, Parser};

    use super::*;

    /// A setting does not fit.
    #[derive(Debug, thiserror::Error)]
    #[error("clip: {0}: expected {1}, found none")]
    struct SettingError(&'static str, &'static str);

    fn setting<'e>(error: &'e (dyn Error + 'static)) -> Option<&'e str> {
        error.downcast_ref::<SettingError>().map(|error| error.0)
    }

    fn command() -> Command {
        let flags = |name: &'static str| Arg::new(name).long(name);
        Command::new("program").arg(flags("frames")).subcommand(Command::new("go").arg(flags("image-size")))
    }

    #[test]
    fn a_cause_is_named_once() {
        let error = anyhow::anyhow!("no such file").context("clip.json: read: no such file").context("clip");
        assert_eq!(chain(error.as_ref(), setting, &command()), "clip: clip.json: read: no such file");
    }

    #[test]
    fn settings_have_the_names_of_flags_where_there_are_such_flags() {
        let text = |name, expected| {
            let error = anyhow::Error::from(SettingError(name, expected)).context("went wrong");
            chain(error.as_ref(), setting, &command())
        };
        let known = text("frames", "fewer, or `image-size 2x2` or `others`");
        assert_eq!(known, "went wrong: clip: --frames: expected fewer, or --image-size 2x2 or `others`, found none");
        assert_eq!(text("voxels", "few"), "went wrong: clip: voxels: expected few, found none");
    }

    #[test]
    fn a_refused_flag_is_one_line_without_the_usage_below_it() {
        #[derive(Parser)]
        struct Args {}
        let error = Args::try_parse_from(["program", "--no-such-flag"]).err().unwrap();
        assert_eq!(usage(&error), "unexpected argument '--no-such-flag' found (see --help)");
    }
}
