//! No two files of a crate name each other.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::Path,
};

use lgs_tests::sources::{code_of, paths_after, project_files, rust_files};
use lgs_tests::{Outcome, case, places};
use libtest_mimic::Trial;

/// The crates with more than a few files.
const CRATES: [&str; 7] = ["cli", "pages", "formats", "engine", "targetgen", "train", "measure"];
/// Most `super::` in a row that are followed.
const DEPTH: usize = 4;

type Module = Vec<String>;

pub(crate) fn cases() -> Vec<Trial> {
    vec![
        case("structure::no_two_files_name_each_other", || report(&offences(places::repository())?)),
        case("structure::the_test_of_circles_finds_offences", finds_offences),
    ]
}

fn report(offences: &[String]) -> Outcome {
    if offences.is_empty() { Ok(()) } else { Err(offences.join("\n").into()) }
}

fn offences(root: &Path) -> Result<Vec<String>, String> {
    let files = project_files(root)?;
    let mut offences = Vec::new();
    for name in CRATES {
        let source = Path::new(name).join("src");
        let inside = rust_files(&files).into_iter().filter(|path| !path.starts_with(source.join("bin")));
        let modules: BTreeMap<Module, &Path> =
            inside.filter_map(|path| Some((module_of(path.strip_prefix(&source).ok()?), path.as_path()))).collect();
        let mut named: BTreeMap<&Module, BTreeSet<Module>> = BTreeMap::new();
        for (module, path) in &modules {
            let text = fs::read_to_string(root.join(path)).map_err(|e| format!("{}: {e}", path.display()))?;
            let code = code_of(text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default());
            named.insert(module, named_by(&code, module, &modules));
        }
        for (module, others) in &named {
            let back = |other: &&Module| *module < *other && named.get(other).is_some_and(|all| all.contains(*module));
            offences.extend(others.iter().filter(back).map(|other| {
                format!("{}: this file and {} name each other", modules[*module].display(), modules[other].display())
            }));
        }
    }
    Ok(offences)
}

/// `["a", "b"]` for `a/b.rs` and `a/b/mod.rs`; the root of the crate is empty.
fn module_of(inside: &Path) -> Module {
    let mut names: Module =
        inside.with_extension("").components().map(|c| c.as_os_str().to_string_lossy().into_owned()).collect();
    if names.last().is_some_and(|name| name == "mod") || names == ["lib"] {
        names.pop();
    }
    names
}

/// The files whose modules a file names by `crate::` or `super::`.
fn named_by(code: &str, module: &Module, modules: &BTreeMap<Module, &Path>) -> BTreeSet<Module> {
    let mut found = BTreeSet::new();
    for depth in 0..=module.len().min(DEPTH) {
        let (prefix, base) = match depth {
            0 => ("crate::".to_owned(), &[][..]),
            _ => ("super::".repeat(depth), &module[..module.len() - depth]),
        };
        for path in
            paths_after(code, &prefix).into_iter().map(|named| named.name).filter(|name| !name.starts_with("super"))
        {
            let mut whole: Module = base.iter().cloned().chain(path.split("::").map(str::to_owned)).collect();
            while !whole.is_empty() && !modules.contains_key(&whole) {
                whole.pop();
            }
            if !whole.is_empty() && whole != *module {
                found.insert(whole);
            }
        }
    }
    found
}

/// The rule on a made-up crate that breaks it.
fn finds_offences() -> Outcome {
    let root = tempfile::tempdir()?;
    let write = |path: &str, text: &str| {
        let full = root.path().join(path);
        full.parent().map_or(Ok(()), fs::create_dir_all).and_then(|()| fs::write(full, text))
    };
    write("engine/src/lib.rs", "mod a;\nmod b;\n")?;
    write("engine/src/a/mod.rs", "mod c;\nmod d;\nmod e;\n")?;
    write("engine/src/a/c.rs", "use super::{\n    d::{Two, f},\n    One,\n};\nuse crate::b::g;\n")?;
    write(
        "engine/src/a/d.rs",
        "use super::e::h;\nfn i() { super::c::j() }\n#[cfg(test)]\nmod tests {\n    use crate::b;\n}\n",
    )?;
    write("engine/src/a/e.rs", "use crate::{b, a::Three};\n")?;
    write("engine/src/b.rs", "// crate::a::e\nuse crate::a::{Four, c as k};\n")?;
    let found = offences(root.path())?;
    let wanted = [
        "engine/src/a/c.rs: this file and engine/src/a/d.rs name",
        "engine/src/a/c.rs: this file and engine/src/b.rs name",
    ];
    let as_wanted = found.len() == wanted.len() && found.iter().zip(wanted).all(|(got, want)| got.starts_with(want));
    if as_wanted { Ok(()) } else { Err(format!("got {found:#?}, want {wanted:#?}").into()) }
}
