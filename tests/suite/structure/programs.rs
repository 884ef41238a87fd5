//! The command line is a matter of programs: libraries name no flag, and do not know how one is parsed.

use std::fs;
use std::path::Path;

use lgs_tests::sources::{code_of, offence, project_files, rust_files};
use lgs_tests::{Outcome, case, places};
use libtest_mimic::Trial;

/// The crates whose programs have flags.
const CRATES: [&str; 6] = ["pages", "formats", "engine", "targetgen", "train", "measure"];
/// What parses command lines, and what shows how far a program is.
const OF_PROGRAMS: [&str; 3] = ["clap", "lgs_cli", "indicatif"];

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("structure::flags_are_named_by_programs", || report(&offences(places::repository(), flags_of)?)),
        case("structure::command_lines_are_parsed_by_programs", || {
            report(&offences(places::repository(), parsers_of)?)
        }),
        case("structure::the_test_of_programs_finds_offences", finds_offences),
    ]
}

fn report(offences: &[String]) -> Outcome {
    if offences.is_empty() { Ok(()) } else { Err(offences.join("\n").into()) }
}

/// What `wrong` says of a line of code of a library, for all of them.
fn offences(root: &Path, wrong: fn(&str) -> Option<String>) -> Result<Vec<String>, String> {
    let files = project_files(root)?;
    let mut offences = Vec::new();
    for path in rust_files(&files) {
        let is_of_library = CRATES.iter().any(|name| path.starts_with(Path::new(name).join("src")));
        if !is_of_library || path.components().any(|part| part.as_os_str() == "bin") {
            continue;
        }
        let text = fs::read_to_string(root.join(path)).map_err(|e| format!("{}: {e}", path.display()))?;
        let code = code_of(&text);
        let lines = (1..).zip(code.lines());
        offences.extend(lines.filter_map(|(number, line)| Some(offence(path, number, &wrong(line)?))));
    }
    Ok(offences)
}

/// A flag in the line, which only a text can hold: one that goes on from the line before has no quote in front.
fn flags_of(line: &str) -> Option<String> {
    let mut after_dashes = line.split("--").skip(1);
    let named = after_dashes.find(|word| word.starts_with(|c: char| c.is_ascii_lowercase()))?;
    let name: String = named.chars().take_while(|c| c.is_ascii_lowercase() || *c == '-').collect();
    Some(format!("names --{name}, which is a matter of programs"))
}

/// A crate of the command line in the line.
fn parsers_of(line: &str) -> Option<String> {
    let is_named = |name: &&&str| line.contains(&format!("{name}::"));
    OF_PROGRAMS.iter().find(is_named).map(|name| format!("uses {name}, which programs alone may"))
}

/// The rules on a made-up repository that breaks them.
fn finds_offences() -> Outcome {
    let root = tempfile::tempdir()?;
    let write = |path: &str, text: &str| {
        let full = root.path().join(path);
        full.parent().map_or(Ok(()), fs::create_dir_all).and_then(|()| fs::write(full, text))
    };
    write(
        "engine/src/a.rs",
        "// \"--frames\"\nfn f() { g(\"a -- b\", \"see --frames: 3\"); }\nconst T: &str = \"a \\\n  or --size\";\n",
    )?;
    write("engine/src/b.rs", "#[derive(clap::ValueEnum)]\nenum E {}\nuse lgs_cli::run;\n")?;
    write("engine/src/bin/c.rs", "use clap::Parser;\nconst F: &str = \"--frames\";\n")?;
    write("tests/suite/d.rs", "const F: &str = \"--frames\";\n")?;
    let found = [offences(root.path(), flags_of)?, offences(root.path(), parsers_of)?].concat();
    let wanted = [
        "engine/src/a.rs:2: names --frames,",
        "engine/src/a.rs:4: names --size,",
        "engine/src/b.rs:1: uses clap,",
        "engine/src/b.rs:3: uses lgs_cli,",
    ];
    let as_wanted = found.len() == wanted.len() && found.iter().zip(wanted).all(|(got, want)| got.starts_with(want));
    if as_wanted { Ok(()) } else { Err(format!("got {found:#?}, want {wanted:#?}").into()) }
}
