//! Whether the definition of a command line keeps the rules of the programs.

use clap::Command;

/// The flags, of a command and of those below it, that take a value and need not be given, but tell no default: in their help, or by a value that
/// stands for them. Hidden ones are left out.
pub fn flags_without_default(command: &Command) -> Vec<String> {
    let is_asked = |flag: &&clap::Arg| {
        flag.get_long().is_some() && flag.get_action().takes_values() && !flag.is_required_set() && !flag.is_hide_set()
    };
    let tells = |flag: &clap::Arg| {
        let help = flag.get_help().map_or(String::new(), ToString::to_string);
        help.contains("[default: ") || !flag.get_default_values().is_empty()
    };
    let own = command.get_arguments().filter(is_asked).filter(|flag| !tells(flag));
    let name = |flag: &clap::Arg| format!("{} --{}", command.get_name(), flag.get_id());
    own.map(name).chain(command.get_subcommands().flat_map(flags_without_default)).collect()
}

#[cfg(test)]
mod tests {
    use clap::{Arg, ArgAction};

    use super::*;

    #[test]
    fn silent_flags_are_found_in_commands_and_below() {
        let silent = || Arg::new("silent").long("silent").help("Something");
        let command = Command::new("p")
            .arg(silent())
            .arg(Arg::new("told").long("told").help("Something [default: none]"))
            .arg(Arg::new("set").long("set").default_value("3"))
            .arg(Arg::new("switch").long("switch").action(ArgAction::SetTrue))
            .arg(Arg::new("asked").long("asked").required(true))
            .arg(Arg::new("hidden").long("hidden").hide(true))
            .arg(Arg::new("place"))
            .subcommand(Command::new("below").arg(silent()));
        assert_eq!(flags_without_default(&command), ["p --silent", "below --silent"]);
    }
}
