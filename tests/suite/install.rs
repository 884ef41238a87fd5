//! The ways of `docs/install.md`: each gives programs that run in any folder, with their weights.

use std::env;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use lgs_engine::network::shipped;
use lgs_engine::network::source::load_model;
use lgs_tests::process::{binary, run};
use lgs_tests::readme::shell_blocks;
use lgs_tests::{Needed, Outcome, case, case_if, clips, metrics, places};
use libtest_mimic::Trial;

/// The page whose commands run here.
const PAGE: &str = "docs/install.md";
/// The programs of all packages.
const PROGRAMS: [&str; 6] = ["lgs-clip", "lgs-eval", "lgs-infer", "lgs-sweep", "lgs-targetgen", "lgs-train"];
/// Flags of a run of a second.
const SMALL: [&str; 6] = ["--image-size", "48x80", "--frames", "0..2", "--views", "none"];

pub(crate) fn cases() -> Vec<Trial> {
    let patience = match env::var_os("LGS_INSTALL") {
        Some(_) => Needed::Here,
        None => Needed::Missing("LGS_INSTALL to be set, since it builds for minutes".to_owned()),
    };
    vec![
        case("install::a_program_needs_nothing_of_the_repository", || {
            let place = tempfile::tempdir()?;
            let copied = place.path().join(format!("moved{}", env::consts::EXE_SUFFIX));
            fs::copy(binary("lgs-infer")?, &copied)?;
            names_no_model(&copied)?;
            reconstructs(&copied)
        }),
        case("install::the_package_of_all_programs_has_all", has_all),
        case_if(&patience, "install::with_cargo", with_cargo),
        case_if(&on_path("maturin"), "install::as_a_wheel", as_a_wheel),
        case_if(&docker(), "install::in_a_container", in_a_container),
    ]
}

/// A client without its server can do nothing.
fn docker() -> Needed {
    if env::var_os("LGS_INSTALL").is_none() {
        return Needed::Missing("LGS_INSTALL to be set, since it builds for minutes".to_owned());
    }
    let answers = Command::new("docker").arg("info").stdout(Stdio::null()).stderr(Stdio::null()).status();
    match answers {
        Ok(status) if status.success() => Needed::Here,
        _ => Needed::Missing("docker with its server".to_owned()),
    }
}

fn on_path(program: &str) -> Needed {
    let paths = env::var_os("PATH").unwrap_or_default();
    let found = env::split_paths(&paths).any(|dir| dir.join(format!("{program}{}", env::consts::EXE_SUFFIX)).is_file());
    if found { Needed::Here } else { Needed::Missing(program.to_owned()) }
}

/// The commands of the page that begin with `start`.
fn commands(start: &str) -> Result<Vec<String>, String> {
    let text = fs::read_to_string(places::repository().join(PAGE)).map_err(|e| format!("{PAGE}: {e}"))?;
    let all = shell_blocks(&text).into_iter().flat_map(|block| block.commands);
    let found: Vec<String> = all.filter(|command| command.starts_with(start)).collect();
    if found.is_empty() { Err(format!("{PAGE} has no command that begins with `{start}`")) } else { Ok(found) }
}

/// Fails when the program would read a file of the repository's models.
fn names_no_model(program: &Path) -> Outcome {
    let models = places::repository().join("models").into_os_string().into_encoded_bytes();
    let bytes = fs::read(program)?;
    if bytes.windows(models.len()).any(|window| window == models) {
        return Err(format!("{} names the repository's folder of models", program.display()).into());
    }
    Ok(())
}

/// Fails unless the program reconstructs a clip with the weights that ship, in a folder that has nothing else.
fn reconstructs(program: &Path) -> Outcome {
    let place = tempfile::tempdir()?;
    clips::copy(&clips::street(), &place.path().join("clip"))?;
    let arguments: Vec<&str> = ["clip", "--out", "out"].into_iter().chain(SMALL).collect();
    run(program, &arguments, place.path())?.expect_success()?;
    has_used_the_weights(&place.path().join("out"))
}

fn has_used_the_weights(out: &Path) -> Outcome {
    let used = metrics::read(out)?["weights"].clone();
    let want = load_model(&places::repository().join(shipped::FILE)).map_err(|e| e.to_string())?.digest;
    if used == want.as_str() { Ok(()) } else { Err(format!("used the weights {used}, want {want}").into()) }
}

fn has_all() -> Outcome {
    let manifest = fs::read_to_string(places::repository().join("programs/Cargo.toml"))?;
    let named: Vec<&str> = manifest.lines().filter_map(|line| line.strip_prefix("path = \"../")).collect();
    let mut found = Vec::new();
    for entry in fs::read_dir(places::repository())? {
        let package = entry?.file_name().to_string_lossy().into_owned();
        for program in fs::read_dir(places::repository().join(&package).join("src/bin")).into_iter().flatten() {
            found.push(format!("{package}/src/bin/{}/main.rs\"", program?.file_name().to_string_lossy()));
        }
    }
    let missing: Vec<&String> = found.iter().filter(|path| !named.contains(&path.as_str())).collect();
    if found.len() == PROGRAMS.len() && missing.is_empty() {
        return Ok(());
    }
    Err(format!("found {found:?}; programs/Cargo.toml misses {missing:?}").into())
}

/// Runs a command of the page that builds, in a folder of its own: it would take away the programs that other cases run.
fn build(command: &str, more: &str, place: &Path) -> Outcome {
    let target = places::repository().join("target/install");
    let line = format!("CARGO_TARGET_DIR='{}' {command} --offline {more} '{}'", target.display(), place.display());
    run("bash".as_ref(), &["-ec", &line], places::repository())?.expect_success()
}

fn with_cargo() -> Outcome {
    for command in commands("cargo install")? {
        let place = tempfile::tempdir()?;
        build(&command, "--root", place.path())?;
        let program = place.path().join("bin").join(format!("lgs-infer{}", env::consts::EXE_SUFFIX));
        names_no_model(&program)?;
        reconstructs(&program)?;
    }
    Ok(())
}

fn as_a_wheel() -> Outcome {
    let place = tempfile::tempdir()?;
    for command in commands("maturin")? {
        build(&command, "--out", place.path())?;
    }
    let wheels: Vec<PathBuf> = fs::read_dir(place.path())?.map(|e| Ok(e?.path())).collect::<std::io::Result<_>>()?;
    let [wheel] = wheels.as_slice() else { return Err(format!("wheels {wheels:?}, want one").into()) };
    let folder = place.path().join("venv");
    run("python3".as_ref(), &["-m".as_ref(), "venv".as_ref(), folder.as_os_str()], place.path())?.expect_success()?;
    let scripts = folder.join(if cfg!(windows) { "Scripts" } else { "bin" });
    let program = |name: &str| scripts.join(format!("{name}{}", env::consts::EXE_SUFFIX));
    let install = ["-m", "pip", "install", "--no-index", "--quiet"].map(OsStr::new);
    let arguments: Vec<&OsStr> = install.into_iter().chain([wheel.as_os_str()]).collect();
    run(&program("python"), &arguments, place.path())?.expect_success()?;
    for name in PROGRAMS {
        let said = run(&program(name), &["--version"], place.path())?;
        said.expect_success()?;
        if !said.stdout.starts_with(name) {
            return Err(format!("{name} --version says {:?}", said.stdout).into());
        }
    }
    names_no_model(&program("lgs-infer"))?;
    reconstructs(&program("lgs-infer"))
}

fn in_a_container() -> Outcome {
    for command in commands("docker build")? {
        run("bash".as_ref(), &["-ec", &command], places::repository())?.expect_success()?;
    }
    let place = tempfile::tempdir()?;
    clips::copy(&clips::street(), &place.path().join("clips/street"))?;
    for command in commands("docker run")? {
        run("bash".as_ref(), &["-ec", &command], place.path())?.expect_success()?;
    }
    has_used_the_weights(&place.path().join("out/street"))
}
