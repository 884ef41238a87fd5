//! `lgs-train scenes`: the clip that ships is what the code makes, and threads do not matter.

use std::fs;
use std::path::Path;

use lgs_tests::process::{binary, run};
use lgs_tests::readme::{built_binary, shell_blocks};
use lgs_tests::sources::all_files;
use lgs_tests::{Outcome, case, clips};
use libtest_mimic::Trial;

/// The page of the shipped clip.
const PAGE: &str = "README.md";

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("cli::scenes::street_is_what_the_code_makes", street_is_what_the_code_makes),
        case("cli::scenes::an_existing_clip_is_kept", an_existing_clip_is_kept),
    ]
}

/// Runs the command of the clip's own page and compares every file but that page.
fn street_is_what_the_code_makes() -> Outcome {
    let page = fs::read_to_string(clips::street().join(PAGE))?;
    let block = shell_blocks(&page).into_iter().next().ok_or("the clip's page has no command")?;
    let (name, words) =
        block.commands.first().and_then(|c| built_binary(c)).ok_or("its command is not of cargo run")?;
    for threads in ["1", "2"] {
        let place = tempfile::tempdir()?;
        let arguments = [words.as_slice(), &["--threads".to_owned(), threads.to_owned()]].concat();
        run(&binary(&name)?, &arguments, place.path())?.expect_success()?;
        same_files(&place.path().join("out/street"), &clips::street())?;
    }
    Ok(())
}

fn same_files(got: &Path, want: &Path) -> Outcome {
    let names = |root: &Path| {
        all_files(root).map(|mut files| {
            files.retain(|path| path.as_path() != Path::new(PAGE));
            files.sort();
            files
        })
    };
    if names(got)? != names(want)? {
        return Err(format!("files {:?}, want {:?}", names(got)?, names(want)?).into());
    }
    for name in names(want)? {
        if fs::read(got.join(&name))? != fs::read(want.join(&name))? {
            return Err(format!("{} is not what the code makes", name.display()).into());
        }
    }
    Ok(())
}

fn an_existing_clip_is_kept() -> Outcome {
    let place = tempfile::tempdir()?;
    let clip = place.path().join("street");
    fs::create_dir(&clip)?;
    fs::write(clip.join("clip.json"), "mine")?;
    let flags = ["scenes", "--preset", "street", "--name", "street", "--out", "."];
    run(&binary("lgs-train")?, &flags, place.path())?.expect_refusal(&["street"])?;
    let kept = fs::read_to_string(clip.join("clip.json"))? == "mine" && all_files(&clip)?.len() == 1;
    if kept { Ok(()) } else { Err("the clip that was there was changed".into()) }
}
