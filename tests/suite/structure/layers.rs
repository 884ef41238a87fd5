//! Dependencies point downward only: between crates, and between the engine's modules.

use std::fs;
use std::path::{Path, PathBuf};

use lgs_tests::sources::{code_of, names_after, offence, project_files, rust_files};
use lgs_tests::{Outcome, case, places};
use libtest_mimic::Trial;

/// The crates from the lowest layer up; each may use those before it. Nothing may use `tests`.
const CRATES: [&str; 9] = ["cli", "pages", "formats", "engine", "targetgen", "train", "measure", "programs", "tests"];
/// What `formats` must do without: it turns bytes into structs, on one thread.
const NOT_IN_FORMATS: [&str; 3] = ["candle-core", "candle-nn", "rayon"];

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("structure::crates_depend_downward", || report(&crate_offences(places::repository())?)),
        case("structure::engine_modules_use_earlier_ones", || report(&module_offences(places::repository())?)),
        case("structure::layering_test_finds_offences", finds_offences),
    ]
}

fn report(offences: &[String]) -> Outcome {
    if offences.is_empty() { Ok(()) } else { Err(offences.join("\n").into()) }
}

fn read(root: &Path, path: &Path) -> Result<String, String> {
    fs::read_to_string(root.join(path)).map_err(|e| format!("{}: {e}", path.display()))
}

/// Manifest lines and `use` lines by which a crate depends on one that is not below it.
fn crate_offences(root: &Path) -> Result<Vec<String>, String> {
    let files = project_files(root)?;
    let mut offences = Vec::new();
    for manifest in files.iter().filter(|p| p.ends_with("Cargo.toml") && p.components().count() == 2) {
        let member = first_component(manifest);
        if !CRATES.contains(&member.as_str()) {
            offences.push(offence(manifest, 1, &format!("crate {member} has no layer")));
        }
        for (number, line) in (1..).zip(read(root, manifest)?.lines()) {
            let dependency = line.split(['.', '=', ' ']).next().unwrap_or_default();
            let upward = dependency.strip_prefix("lgs-").is_some_and(|lower| !is_below(lower, &member));
            if upward || (member == "formats" && NOT_IN_FORMATS.contains(&dependency)) {
                offences.push(offence(manifest, number, &format!("{member} may not depend on {dependency}")));
            }
        }
    }
    for path in rust_files(&files) {
        let (member, code) = (first_component(path), code_of(&read(root, path)?));
        for other in CRATES.iter().filter(|other| **other != member && !is_below(other, &member)) {
            for named in names_after(&code, &format!("lgs_{other}::")) {
                offences.push(offence(path, named.line, &format!("{member} may not use lgs_{other}")));
            }
        }
    }
    Ok(offences)
}

fn first_component(path: &Path) -> String {
    path.components().next().map(|c| c.as_os_str().to_string_lossy().into_owned()).unwrap_or_default()
}

fn is_below(lower: &str, member: &str) -> bool {
    let layer = |name: &str| CRATES.iter().position(|c| *c == name);
    matches!((layer(lower), layer(member)), (Some(low), Some(own)) if low < own)
}

/// Lines by which a module of the engine uses one that `lib.rs` declares after it.
fn module_offences(root: &Path) -> Result<Vec<String>, String> {
    let source = Path::new("engine/src");
    let order = declared_modules(&read(root, &source.join("lib.rs"))?);
    let files = project_files(root)?;
    let mut offences = Vec::new();
    for path in rust_files(&files) {
        let Ok(inside) = path.strip_prefix(source) else { continue };
        let modules = module_path(inside);
        let Some(own) = modules.first().filter(|m| *m != "bin" && *m != "lib") else { continue };
        let code = code_of(&read(root, path)?);
        let mut named = names_after(&code, "crate::");
        named.extend(names_after(&code, &"super::".repeat(modules.len())));
        let rank = |name: &str| order.iter().position(|m| m == name);
        for other in named {
            let upward = rank(&other.name).is_some_and(|r| rank(own).is_none_or(|o| r > o));
            if upward {
                let what = format!("module {own} may not use {}, which lib.rs declares after it", other.name);
                offences.push(offence(path, other.line, &what));
            }
        }
    }
    Ok(offences)
}

/// The modules in the order in which `lib.rs` declares them.
fn declared_modules(lib: &str) -> Vec<String> {
    let declaration = |line: &str| {
        let name = line.strip_prefix("pub ").unwrap_or(line).strip_prefix("mod ")?.strip_suffix(';')?;
        Some(name.to_owned())
    };
    lib.lines().filter_map(declaration).collect()
}

/// `["loss", "ssim"]` for `loss/ssim.rs`, `["loss"]` for `loss/mod.rs` and `loss.rs`.
fn module_path(inside: &Path) -> Vec<String> {
    let without_suffix: PathBuf = inside.with_extension("");
    let mut names: Vec<String> =
        without_suffix.components().map(|c| c.as_os_str().to_string_lossy().into_owned()).collect();
    if names.len() > 1 && names.last().is_some_and(|name| name == "mod") {
        names.pop();
    }
    names
}

/// The two rules on a made-up repository that breaks them.
fn finds_offences() -> Outcome {
    let root = tempfile::tempdir()?;
    let write = |path: &str, text: &str| {
        let full = root.path().join(path);
        full.parent().map_or(Ok(()), fs::create_dir_all).and_then(|()| fs::write(full, text))
    };
    write("formats/Cargo.toml", "[dependencies]\nlgs-engine.workspace = true\nrayon = \"1\"\n")?;
    write("formats/src/lib.rs", "//! lgs_engine::views in a comment is no use.\nuse lgs_engine::views;\n")?;
    write("engine/Cargo.toml", "[dependencies]\nlgs-formats.workspace = true\n")?;
    write("engine/src/lib.rs", "pub mod points;\n\npub mod render;\npub mod loss;\n")?;
    write("engine/src/points.rs", "use crate::{\n    points::a,\n    loss::{b, render},\n};\n")?;
    write("engine/src/render/tiles.rs", "fn f() {\n    super::super::loss::g();\n    crate::points::h();\n}\n")?;
    write("engine/src/bin/run.rs", "use lgs_engine::loss;\nuse lgs_train::scenes;\n")?;
    write("extra/Cargo.toml", "")?;
    let places = |offences: Vec<String>| -> Vec<String> {
        offences.iter().map(|o| o.split(": ").next().unwrap_or_default().to_owned()).collect()
    };
    let got = [places(crate_offences(root.path())?), places(module_offences(root.path())?)].concat();
    let want = [
        "extra/Cargo.toml:1",
        "formats/Cargo.toml:2",
        "formats/Cargo.toml:3",
        "engine/src/bin/run.rs:2",
        "formats/src/lib.rs:2",
        "engine/src/points.rs:3",
        "engine/src/render/tiles.rs:2",
    ];
    let sorted = |mut list: Vec<String>| {
        list.sort();
        list
    };
    let (got, want) = (sorted(got), sorted(want.iter().map(|&w| w.to_owned()).collect()));
    if got == want { Ok(()) } else { Err(format!("got {got:#?}, want {want:#?}").into()) }
}
