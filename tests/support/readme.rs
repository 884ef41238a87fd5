//! The commands, the promised files, the links and the headings of a Markdown page.

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
/// form `cargo run --release [-q] [-p PACKAGE] --bin NAME -- ARGUMENTS`. Quotes around a whole argument go, as in a shell; none has a space in it.
pub fn built_binary(command: &str) -> Option<(String, Vec<String>)> {
    let (cargo, arguments) = command.strip_prefix("cargo run ")?.split_once(" -- ")?;
    let mut words = cargo.split_whitespace();
    words.find(|word| *word == "--bin")?;
    let name = words.next()?.to_owned();
    let unquoted = |word: &str| {
        let inner = word.strip_prefix('\'').and_then(|word| word.strip_suffix('\''));
        inner.unwrap_or(word).to_owned()
    };
    Some((name, arguments.split_whitespace().map(unquoted).collect()))
}

/// A link of a page.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Link {
    /// Its line, from 1.
    pub line: usize,
    /// Where it leads, as the page has it.
    pub target: String,
}

/// The links and pictures of a page; those in code are none.
pub fn links(page: &str) -> Vec<Link> {
    let prose = without_code(&without_fences(page));
    let link = |(at, _): (usize, &str)| {
        let (target, _) = prose[at + 2..].split_once(')')?;
        Some(Link { line: 1 + prose[..at].matches('\n').count(), target: target.to_owned() })
    };
    prose.match_indices("](").filter_map(link).collect()
}

/// What links to the headings of a page have behind `#`: lower case, hyphens for spaces, no punctuation, and a number behind those that
/// are there already.
pub fn anchors(page: &str) -> Vec<String> {
    let mut slugs: Vec<String> = Vec::new();
    let mut anchors = Vec::new();
    for line in without_fences(page).lines() {
        let title = line.trim_start_matches('#');
        if title.len() == line.len() || !title.starts_with(' ') {
            continue;
        }
        let kept = title.trim().chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
        let slug: String = kept.flat_map(char::to_lowercase).map(|c| if c == ' ' { '-' } else { c }).collect();
        let before = slugs.iter().filter(|other| **other == slug).count();
        anchors.push(if before == 0 { slug.clone() } else { format!("{slug}-{before}") });
        slugs.push(slug);
    }
    anchors
}

/// The page with the lines of fenced blocks empty.
fn without_fences(page: &str) -> String {
    let mut fenced = false;
    let mut text = String::new();
    for line in page.lines() {
        let fence = line.trim_start().starts_with("```");
        fenced ^= fence;
        text.push_str(if fence || fenced { "" } else { line });
        text.push('\n');
    }
    text
}

/// The text without inline code, with all its lines.
fn without_code(text: &str) -> String {
    let mut prose = String::new();
    let mut rest = text;
    while let Some((before, behind)) = rest.split_once('`') {
        prose.push_str(before);
        rest = behind.trim_start_matches('`');
        let end = end_of_code(rest, 1 + behind.len() - rest.len()).unwrap_or(0);
        prose.extend(rest[..end].chars().filter(|c| *c == '\n'));
        rest = &rest[end..];
    }
    prose + rest
}

/// Where the code ends that so many backticks open: behind the next run of as many in the same paragraph.
fn end_of_code(rest: &str, ticks: usize) -> Option<usize> {
    let paragraph = rest.split("\n\n").next()?;
    let mut end = 0;
    while let Some(start) = paragraph[end..].find('`') {
        let run = paragraph[end + start..].bytes().take_while(|byte| *byte == b'`').count();
        end += start + run;
        if run == ticks {
            return Some(end);
        }
    }
    None
}
