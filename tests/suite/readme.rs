//! The pages for people, which are `README.md`, `ARCHITECTURE.md` and those of `docs`: every command of their `sh` blocks runs, every file
//! that they promise is there afterwards, every link leads somewhere, and the README is short.

use std::fs;
use std::io;
use std::path::Path;

use lgs_tests::process::{Finished, binary, run};
use lgs_tests::readme::{Block, Link, anchors, built_binary, links, named_paths, shell_blocks};
use lgs_tests::sources::{offence, project_files};
use lgs_tests::{Outcome, case, clips, places};
use libtest_mimic::Trial;

/// The page that everybody reads.
const README: &str = "README.md";
/// Most lines of it.
const MAX_LINES: usize = 120;
/// Where the commands write.
const OUT: &str = "out";

pub(crate) fn cases() -> Vec<Trial> {
    let mut cases = vec![
        case("readme::is_short", is_short),
        case("readme::links_lead_somewhere", links_lead_somewhere),
        case("readme::parser", parser),
        case("readme::link_parser", link_parser),
    ];
    match pages() {
        Ok(pages) => cases.extend(pages.into_iter().map(|page| {
            let name = page.trim_end_matches(".md").replace('/', "::").to_lowercase();
            case(format!("readme::commands_run_and_files_exist::{name}"), move || commands_run(&page))
        })),
        Err(error) => cases.push(case("readme::commands_run_and_files_exist", move || Err(error.into()))),
    }
    cases
}

/// The pages, relative to the repository.
fn pages() -> io::Result<Vec<String>> {
    let mut pages = vec![README.to_owned(), "ARCHITECTURE.md".to_owned()];
    for entry in fs::read_dir(places::repository().join("docs"))? {
        let name = entry?.file_name().to_string_lossy().into_owned();
        pages.extend(name.ends_with(".md").then(|| format!("docs/{name}")));
    }
    pages.sort();
    Ok(pages)
}

fn is_short() -> Outcome {
    let lines = fs::read_to_string(places::repository().join(README))?.lines().count();
    if lines <= MAX_LINES { Ok(()) } else { Err(format!("{README}: {lines} lines, at most {MAX_LINES}").into()) }
}

/// Every page of the project, not only those whose commands run.
fn links_lead_somewhere() -> Outcome {
    let root = places::repository();
    let mut offences = Vec::new();
    for page in project_files(root)?.into_iter().filter(|path| path.extension().is_some_and(|e| e == "md")) {
        let text = fs::read_to_string(root.join(&page))?;
        for link in links(&text) {
            offences.extend(dead(root, &page, &text, &link).map(|why| offence(&page, link.line, &why)));
        }
    }
    if offences.is_empty() { Ok(()) } else { Err(offences.join("\n").into()) }
}

/// Why a link of a page leads nowhere; `None` where it leads somewhere, or out of the repository.
fn dead(root: &Path, page: &Path, text: &str, link: &Link) -> Option<String> {
    if link.target.contains(':') {
        return None;
    }
    let (file, anchor) = link.target.split_once('#').map_or((link.target.as_str(), None), |(f, a)| (f, Some(a)));
    let path = root.join(page.parent().unwrap_or(page)).join(file);
    if !file.is_empty() && !path.exists() {
        return Some(format!("links to {file}, which does not exist"));
    }
    let headings =
        if file.is_empty() { anchors(text) } else { fs::read_to_string(path).map_or(Vec::new(), |t| anchors(&t)) };
    let anchor = anchor.filter(|anchor| !headings.iter().any(|heading| heading == anchor))?;
    Some(format!("links to {}, but there is no heading {anchor} among {headings:?}", link.target))
}

fn commands_run(page: &str) -> Outcome {
    let text = fs::read_to_string(places::repository().join(page))?;
    let place = tempfile::tempdir()?;
    for data in ["clips", "models", "tests/fixtures"] {
        let from = places::repository().join(data);
        if from.is_dir() {
            clips::copy(&from, &place.path().join(data))?;
        }
    }
    let mut num_run = 0;
    for block in shell_blocks(&text) {
        for command in block.commands.iter().filter(|command| !runs_elsewhere(command)) {
            let finished = execute(command, place.path())?;
            finished.expect_success().map_err(|e| format!("{page}:{}: {command}: {}", block.line, message(&e)))?;
            num_run += 1;
        }
    }
    if num_run == 0 && page == README {
        return Err(format!("{page} has no command that could be run").into());
    }
    let missing: Vec<_> =
        named_paths(&text, OUT).into_iter().filter(|path| !place.path().join(path).exists()).collect();
    if missing.is_empty() { Ok(()) } else { Err(format!("{page} promises {missing:?}").into()) }
}

fn message(failure: &libtest_mimic::Failed) -> String {
    failure.message().unwrap_or_default().to_owned()
}

/// Commands that this run is inside of, which get the repository and test it; those that install, which the cases of `install` run.
fn runs_elsewhere(command: &str) -> bool {
    let starts = ["git clone", "cd ", "cargo test", "cargo install", "pip install", "maturin ", "docker "];
    starts.iter().any(|start| command.starts_with(start))
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
    let page = "a\n```sh\n# a comment\ncargo run --release --bin x -- 'a;c=1' \\\n  --b 1\n\nls\n```\n```json\n{}\n```\n```sh\npwd\n```\n\
                see `out/a.png`, `out/b c`, `else/x`, `out/a.png`";
    let block = |line, commands: &[&str]| Block { line, commands: commands.iter().map(|&c| c.to_owned()).collect() };
    let want = vec![block(2, &["cargo run --release --bin x -- 'a;c=1' --b 1", "ls"]), block(12, &["pwd"])];
    let got = shell_blocks(page);
    if got != want {
        return Err(format!("got {got:#?}, want {want:#?}").into());
    }
    let binary = built_binary(&got[0].commands[0]);
    let want = ("x".to_owned(), ["a;c=1", "--b", "1"].map(str::to_owned).to_vec());
    if binary != Some(want) || built_binary("cargo build --release").is_some() {
        return Err(format!("got {binary:?}").into());
    }
    let paths = named_paths(page, OUT);
    if paths == ["out/a.png"] { Ok(()) } else { Err(format!("got {paths:?}").into()) }
}

fn link_parser() -> Outcome {
    let page = "# A `b.c`: d-e\n[x](y.md) `[no](code\n.md)` [`z`](#a-bc-d-e)\n```sh\n# none\n[no](code.md)\n```\n\n## Two\n## Two\n\
                ``a ` [no](b)`` ![p](q.png)\n#none\nan open ` and [w](https://w)\n";
    let link = |line, target: &str| Link { line, target: target.to_owned() };
    let want = [link(2, "y.md"), link(3, "#a-bc-d-e"), link(11, "q.png"), link(13, "https://w")];
    let got = links(page);
    if got != want {
        return Err(format!("got {got:#?}, want {want:#?}").into());
    }
    let headings = anchors(page);
    if headings != ["a-bc-d-e", "two", "two-1"] {
        return Err(format!("got {headings:?}").into());
    }
    let root = tempfile::tempdir()?;
    fs::write(root.path().join("y.md"), "# Y\n")?;
    let found = ["y.md", "y.md#y", "#two-1", "https://w#v", "z.md", "y.md#z", "#y"]
        .map(|target| dead(root.path(), Path::new("x.md"), page, &link(1, target)).is_some());
    if found == [false, false, false, false, true, true, true] { Ok(()) } else { Err(format!("got {found:?}").into()) }
}
