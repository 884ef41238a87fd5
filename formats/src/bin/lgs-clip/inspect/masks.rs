//! Masks that cannot be what was meant.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use anyhow::Result;
use lgs_formats::{clip_dir::ClipDir, image};

/// Share of an image that a mask of the own vehicle never hides.
const MAX_HIDDEN: f64 = 0.95;

/// One sentence for each camera whose masks hide nearly everything or have other values than the format's.
pub(super) fn warnings(dir: &ClipDir) -> Result<Vec<String>> {
    let mut found: BTreeMap<String, String> = BTreeMap::new();
    let mut seen: BTreeSet<(&str, &Path)> = BTreeSet::new();
    for record in dir.clip().frames.iter().flat_map(|frame| &frame.cameras) {
        let name = &record.camera.name;
        let Some(file) = record.mask.as_deref().filter(|file| seen.insert((name, file))) else { continue };
        if found.contains_key(name) {
            continue;
        }
        let counts = image::mask_values(dir.root(), record)?;
        if let Some(words) = counts.as_ref().and_then(words) {
            found.insert(name.clone(), format!("{name}: mask `{}` {words}", file.display()));
        }
    }
    Ok(found.into_values().collect())
}

/// What is wrong with the numbers of pixels of each grey value.
#[expect(clippy::cast_precision_loss, reason = "pixels of an image are below 2^53")]
fn words(counts: &[usize; 256]) -> Option<String> {
    let total: usize = counts.iter().sum();
    let hidden = counts[0] as f64 / total.max(1) as f64;
    if counts[1] > 0 && counts[2..].iter().all(|&count| count == 0) {
        return Some(
            "holds 0 and 1, where 255 is what stands still and 1 what moves: written as truth values?".to_owned(),
        );
    }
    (hidden > MAX_HIDDEN).then(|| format!("hides {:.0} % of the image: 0 and 255 the wrong way round?", hidden * 100.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_are_known_by_their_values() {
        let summary = |values: &[(usize, usize)]| {
            let mut counts = [0; 256];
            values.iter().for_each(|&(grey, count)| counts[grey] = count);
            words(&counts).unwrap_or_default()
        };
        assert_eq!(summary(&[(0, 30), (255, 70)]), "");
        assert_eq!(summary(&[(0, 30), (1, 5), (255, 70)]), "");
        assert!(summary(&[(0, 10), (1, 90)]).contains("0 and 1"));
        assert!(summary(&[(0, 99), (255, 1)]).contains("hides 99 %"));
    }
}
