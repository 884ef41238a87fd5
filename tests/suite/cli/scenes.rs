//! `lgs-train scenes`: the clip that ships is what the code makes, and threads do not matter.

use std::fs;
use std::path::Path;

use lgs_formats::digest::sha256;
use lgs_tests::process::{binary, run};
use lgs_tests::readme::{built_binary, shell_blocks};
use lgs_tests::sources::all_files;
use lgs_tests::{Outcome, case, clips};
use libtest_mimic::{Failed, Trial};

/// Scenes of splits that figures rest on, and the SHA-256 of all their files, one behind the other in the order of their names.
const KNOWN: [(&str, &str, &str); 3] = [
    ("train", "5", "62c69775635933f76ec4e9c4cd3ff0c899091e2b1c3f3d48045c6c584551ef35"),
    ("validation", "3", "a7d004a87c0a854c8e85bea169d4716992dc1d8dbf617886423acbc27dce06dc"),
    ("test", "0", "e9966d7bce4c50a8e908fdbc8ddae2c1a6c7e550b2ce20bb4ca95be0b8ec5eb6"),
];
/// What makes them small.
const SMALL: [&str; 9] = ["--image-size", "24x48", "--beams", "8", "--azimuths", "90", "--frames", "2", "--masks"];

/// The page of the shipped clip.
const PAGE: &str = "README.md";

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("cli::scenes::street_is_what_the_code_makes", street_is_what_the_code_makes),
        case("cli::scenes::splits_stay_as_they_are", splits_stay_as_they_are),
        case("cli::scenes::traffic_is_a_split_of_its_own", traffic_is_a_split_of_its_own),
        case("cli::scenes::an_existing_clip_is_kept", an_existing_clip_is_kept),
    ]
}

/// Runs the command of the clip's own page and compares every file but that page.
fn street_is_what_the_code_makes() -> Outcome {
    let page = fs::read_to_string(clips::street().join(PAGE))?;
    let block = shell_blocks(&page).into_iter().next().ok_or("the clip's page has no command")?;
    let (name, words) =
        block.commands.first().and_then(|c| built_binary(c)).ok_or("its command is not of cargo run")?;
    let place = tempfile::tempdir()?;
    run(&binary(&name)?, &words, place.path())?.expect_success()?;
    same_files(&place.path().join("out/street"), &clips::street())
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

/// Figures of the past rest on these scenes.
fn splits_stay_as_they_are() -> Outcome {
    for (split, number, want) in KNOWN {
        let got = digest(split, number, "2")?;
        if got != want {
            return Err(format!("scene {number} of {split} has changed: {got}, want {want}").into());
        }
    }
    Ok(())
}

fn traffic_is_a_split_of_its_own() -> Outcome {
    let [train, test, again] =
        [("traffic", "1"), ("traffic-test", "2"), ("traffic", "2")].map(|(split, threads)| digest(split, "5", threads));
    let (train, test, again) = (train?, test?, again?);
    if train == again && train != test && KNOWN.iter().all(|known| known.2 != train) {
        return Ok(());
    }
    Err(format!("traffic {train} and {again}, traffic-test {test}").into())
}

/// SHA-256 of all files of a small scene.
fn digest(split: &str, number: &str, threads: &str) -> Result<String, Failed> {
    let place = tempfile::tempdir()?;
    let asked =
        ["scenes", "--out", "made", "--name", "scene", "--split", split, "--seed", number, "--threads", threads];
    run(&binary("lgs-train")?, &[asked.as_slice(), &SMALL].concat(), place.path())?.expect_success()?;
    let root = place.path().join("made/scene");
    let mut files = all_files(&root)?;
    files.sort();
    let mut bytes = Vec::new();
    for file in files {
        bytes.extend(fs::read(root.join(file))?);
    }
    Ok(sha256(&bytes))
}
