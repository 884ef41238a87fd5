//! The README: every command of its `sh` blocks runs, and every file that it promises is there afterwards.

use std::fs;
use std::path::Path;

use lgs_tests::process::{Finished, binary, run};
use lgs_tests::readme::{Block, built_binary, named_paths, shell_blocks};
use lgs_tests::{Outcome, case, clips, places};
use libtest_mimic::Trial;

/// Where the README's commands write.
const OUT: &str = "out";

pub(crate) fn cases() -> Vec<Trial> {
    vec![case("readme::commands_run_and_files_exist", commands_run), case("readme::parser", parser)]
}

fn commands_run() -> Outcome {
    let page = fs::read_to_string(places::repository().join("README.md"))?;
    let place = tempfile::tempdir()?;
    for data in ["clips", "models", "tests/fixtures"] {
        let from = places::repository().join(data);
        if from.is_dir() {
            clips::copy(&from, &place.path().join(data))?;
        }
    }
    let mut num_run = 0;
    for block in shell_blocks(&page) {
        for command in block.commands.iter().filter(|command| !belongs_to_the_caller(command)) {
            let finished = execute(command, place.path())?;
            finished.expect_success().map_err(|e| format!("README.md:{}: {command}: {}", block.line, text(&e)))?;
            num_run += 1;
        }
    }
    if num_run == 0 {
        return Err("README.md has no command that could be run".into());
    }
    let missing: Vec<_> =
        named_paths(&page, OUT).into_iter().filter(|path| !place.path().join(path).exists()).collect();
    if missing.is_empty() { Ok(()) } else { Err(format!("README.md promises {missing:?}").into()) }
}

fn text(failure: &libtest_mimic::Failed) -> String {
    failure.message().unwrap_or_default().to_owned()
}

/// Commands that this run is inside of: getting the repository, and its tests.
fn belongs_to_the_caller(command: &str) -> bool {
    ["git clone", "cd ", "cargo test"].iter().any(|start| command.starts_with(start))
}

fn execute(command: &str, directory: &Path) -> Result<Finished, String> {
    if let Some((name, arguments)) = built_binary(command) {
        return run(&binary(&name)?, &arguments, directory);
    }
    if command.starts_with("cargo ") {
        return run("bash".as_ref(), &["-c", command], places::repository());
    }
    run("bash".as_ref(), &["-ec", command], directory)
}

fn parser() -> Outcome {
    let page = "a\n```sh\n# a comment\ncargo run --release --bin x -- a \\\n  --b 1\n\nls\n```\n```json\n{}\n```\n```sh\npwd\n```\n\
                see `out/a.png`, `out/b c`, `else/x`, `out/a.png`";
    let block = |line, commands: &[&str]| Block { line, commands: commands.iter().map(|&c| c.to_owned()).collect() };
    let want = vec![block(2, &["cargo run --release --bin x -- a --b 1", "ls"]), block(12, &["pwd"])];
    let got = shell_blocks(page);
    if got != want {
        return Err(format!("got {got:#?}, want {want:#?}").into());
    }
    let binary = built_binary(&got[0].commands[0]);
    let want = ("x".to_owned(), ["a", "--b", "1"].map(str::to_owned).to_vec());
    if binary != Some(want) || built_binary("cargo build --release").is_some() {
        return Err(format!("got {binary:?}").into());
    }
    let paths = named_paths(page, OUT);
    if paths == ["out/a.png"] { Ok(()) } else { Err(format!("got {paths:?}").into()) }
}
