//! Which scene of a release is read: a root may hold the tables of several versions, such as `v1.0-mini` and `v1.0-trainval`.

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

use super::tables::{Scene, read_table};
use crate::{
    error::{FormatError, Result},
    importers::values::entries,
};

/// Most names that an error lists.
const MAX_NAMES: usize = 10;

/// A scene and the tables that it stands in.
pub(super) struct Chosen {
    pub(super) tables: PathBuf,
    pub(super) scene: Scene,
}

/// Names of the folders of tables of a release, sorted.
pub(super) fn versions(folder: &Path) -> Result<Vec<String>> {
    let is_tables = |name: &String| folder.join(name).join("sample_data.json").is_file();
    Ok(entries(folder, &[""])?.into_iter().filter(is_tables).collect())
}

/// Names of the scenes of a release, each once, in the order of its tables.
///
/// # Errors
/// A table that cannot be read.
pub(super) fn names(folder: &Path) -> Result<Vec<String>> {
    let mut names: Vec<String> = Vec::new();
    let mut known = BTreeSet::new();
    for version in versions(folder)? {
        let scenes = read_table(&folder.join(version).join("scene.json"), |_: &Scene| true)?;
        names.extend(scenes.into_iter().map(|scene| scene.name).filter(|name| known.insert(name.clone())));
    }
    Ok(names)
}

/// The scene of a name, or the only one. Of several versions that have it, the first: they say the same of it; `VERSION/NAME` takes it
/// from another.
///
/// # Errors
/// No tables; no such scene, or several and no name.
pub(super) fn choose(folder: &Path, name: Option<&str>) -> Result<Chosen> {
    let versions = versions(folder)?;
    let (mut known, mut num_scenes) = (Vec::new(), 0);
    let mut found = Vec::new();
    for version in &versions {
        let tables = folder.join(version);
        for scene in read_table(&tables.join("scene.json"), |_: &Scene| true)? {
            num_scenes += 1;
            if known.len() < MAX_NAMES {
                known.push(if versions.len() > 1 { format!("{version}/{}", scene.name) } else { scene.name.clone() });
            }
            let is_it = |name: &str| match name.split_once('/') {
                Some((of, name)) => of == version && name == scene.name,
                None => name == scene.name,
            };
            if name.is_none_or(is_it) {
                found.push(Chosen { tables: tables.clone(), scene });
            }
        }
    }
    if found.len() == 1 || (name.is_some() && !found.is_empty()) {
        return Ok(found.swap_remove(0));
    }
    if versions.is_empty() {
        return Err(FormatError::invalid(folder, "tables", "a folder of tables such as `v1.0-mini`", "none"));
    }
    let more = if known.len() < num_scenes { ", ..." } else { "" };
    let place = match versions.as_slice() {
        [one] => folder.join(one).join("scene.json"),
        _ => folder.to_owned(),
    };
    let expected =
        name.map_or_else(|| "the name of one, for lgs-clip to import it alone".to_owned(), |name| format!("`{name}`"));
    let found = format!("{num_scenes} scenes: {}{more}", known.join(", "));
    Err(FormatError::unfit(&place, "scene", expected, found))
}
