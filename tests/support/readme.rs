//! The commands and the promised files of a Markdown page.

/// A fenced `sh` block.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Block {
    /// Line of its fence, from 1.
    pub line: usize,
    /// Its commands: lines, with continued ones joined; comments and empty lines left out.
    pub commands: Vec<String>,
}

/// The `sh` blocks of a page.
pub fn shell_blocks(page: &str) -> Vec<Block> {
    let mut blocks: Vec<Block> = Vec::new();
    let mut open = false;
    let mut continued = false;
    for (line, text) in (1..).zip(page.lines()) {
        if text.trim_start().starts_with("```") {
            open = !open && text.trim() == "```sh";
            if open {
                blocks.push(Block { line, commands: Vec::new() });
            }
            continued = false;
            continue;
        }
        let Some(block) = blocks.last_mut().filter(|_| open) else { continue };
        let (command, more) = match text.trim().strip_suffix('\\') {
            Some(start) => (start.trim_end(), true),
            None => (text.trim(), false),
        };
        match block.commands.last_mut().filter(|_| continued) {
            Some(last) => *last = format!("{last} {command}"),
            None if command.is_empty() || command.starts_with('#') => {}
            None => block.commands.push(command.to_owned()),
        }
        continued = more;
    }
    blocks
}

/// The paths under `directory` that a page names as inline code.
pub fn named_paths(page: &str, directory: &str) -> Vec<String> {
    let prefix = format!("{directory}/");
    let codes = page.split('`').skip(1).step_by(2);
    let mut paths: Vec<String> =
        codes.filter(|c| c.starts_with(&prefix) && !c.contains([' ', '\n', '<', '*'])).map(str::to_owned).collect();
    paths.sort();
    paths.dedup();
    paths
}

/// What a command becomes when the binaries are built already: the binary's name and its arguments, for a command of the
/// form `cargo run --release [-q] [-p PACKAGE] --bin NAME -- ARGUMENTS`.
pub fn built_binary(command: &str) -> Option<(String, Vec<String>)> {
    let (cargo, arguments) = command.strip_prefix("cargo run ")?.split_once(" -- ")?;
    let mut words = cargo.split_whitespace();
    words.find(|word| *word == "--bin")?;
    let name = words.next()?.to_owned();
    Some((name, arguments.split_whitespace().map(str::to_owned).collect()))
}
