//! `lgs-train scenes`: the clip that ships is what the code makes, and threads do not matter.

use std::fs;
use std::path::Path;

use lgs_tests::process::{binary, run};
use lgs_tests::sources::all_files;
use lgs_tests::{Outcome, case, clips};
use libtest_mimic::Trial;

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("cli::scenes::street_is_what_the_code_makes", street_is_what_the_code_makes),
        case("cli::scenes::an_existing_clip_is_kept", an_existing_clip_is_kept),
    ]
}

fn street_is_what_the_code_makes() -> Outcome {
    for threads in ["1", "2"] {
        let place = tempfile::tempdir()?;
        make_street(place.path(), threads)?.expect_success()?;
        same_files(&place.path().join("street"), &clips::street())?;
    }
    Ok(())
}

fn make_street(out: &Path, threads: &str) -> Result<lgs_tests::process::Finished, String> {
    let flags = ["scenes", "--preset", "street", "--name", "street", "--threads", threads, "--out"];
    let mut arguments: Vec<&std::ffi::OsStr> = flags.iter().map(|flag| flag.as_ref()).collect();
    arguments.push(out.as_os_str());
    run(&binary("lgs-train")?, &arguments, out)
}

fn same_files(got: &Path, want: &Path) -> Outcome {
    let names = |root: &Path| {
        all_files(root).map(|mut files| {
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
    make_street(place.path(), "1")?.expect_refusal(&["street"])?;
    let kept = fs::read_to_string(clip.join("clip.json"))? == "mine" && all_files(&clip)?.len() == 1;
    if kept { Ok(()) } else { Err("the clip that was there was changed".into()) }
}
