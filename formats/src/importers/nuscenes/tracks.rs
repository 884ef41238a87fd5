//! Boxes of a scene over time: annotated at the keyframes, in between on the way from one to the other.

use std::{collections::BTreeMap, path::Path};

use super::tables::{Annotation, Category, Instance, Sample, read_table};
use crate::{
    clip::TrackedBox,
    error::Result,
    importers::{trajectory::between, values::At},
};

/// The boxes of one keyframe by their tracks.
#[derive(Debug)]
struct Key {
    /// Microseconds since 1970.
    timestamp: i64,
    boxes: BTreeMap<String, TrackedBox>,
}

/// The boxes of a scene.
#[derive(Debug)]
pub(super) struct Tracks {
    /// By time; none when the release has no annotations of this scene, as those of test splits.
    keys: Vec<Key>,
}

impl Tracks {
    /// The boxes of the samples, which are sorted by time.
    pub(super) fn read(tables: &Path, samples: &[Sample]) -> Result<Self> {
        let file = tables.join("sample_annotation.json");
        if !file.exists() {
            return Ok(Self { keys: Vec::new() });
        }
        let mut keys: Vec<Key> =
            samples.iter().map(|sample| Key { timestamp: sample.timestamp, boxes: BTreeMap::new() }).collect();
        let places: BTreeMap<&str, usize> =
            samples.iter().enumerate().map(|(index, sample)| (sample.token.as_str(), index)).collect();
        let annotations: Vec<Annotation> =
            read_table(&file, |a: &Annotation| places.contains_key(a.sample_token.as_str()))?;
        if annotations.is_empty() {
            return Ok(Self { keys: Vec::new() });
        }
        let categories = categories(tables)?;
        for annotation in annotations {
            let at = At { file: &file, field: &format!("{}: pose", annotation.token) };
            let world_from_box = at.pose(annotation.rotation, annotation.translation)?;
            let [width, length, height] = annotation.size;
            let track = annotation.instance_token;
            let category = categories.get(&track).cloned().unwrap_or_else(|| "unknown".to_owned());
            let tracked = TrackedBox { track: track.clone(), category, size: [length, width, height], world_from_box };
            keys[places[annotation.sample_token.as_str()]].boxes.insert(track, tracked);
        }
        Ok(Self { keys })
    }

    /// The boxes at a moment; `None` when the release has none.
    #[expect(clippy::cast_precision_loss, reason = "microseconds between keyframes are below 2^53")]
    pub(super) fn at(&self, timestamp: i64) -> Option<Vec<TrackedBox>> {
        let after = self.keys.partition_point(|key| key.timestamp < timestamp);
        let (first, last) = (self.keys.first()?, self.keys.last()?);
        let (before, after) = match (after.checked_sub(1).and_then(|i| self.keys.get(i)), self.keys.get(after)) {
            (_, Some(key)) if key.timestamp == timestamp => (key, key),
            (Some(before), Some(after)) => (before, after),
            (None, _) => (first, first),
            (_, None) => (last, last),
        };
        let span = after.timestamp.saturating_sub(before.timestamp);
        let share = if span > 0 { timestamp.saturating_sub(before.timestamp) as f64 / span as f64 } else { 0.0 };
        // What is seen at one end only is taken from there for the half that is nearer to it.
        let nearer = if share < 0.5 { before } else { after };
        let placed = |(track, tracked): (&String, &TrackedBox)| match (before.boxes.get(track), after.boxes.get(track))
        {
            (Some(a), Some(b)) => {
                let world_from_box = between(&a.world_from_box, &b.world_from_box, share);
                TrackedBox { world_from_box, ..tracked.clone() }
            }
            _ => tracked.clone(),
        };
        Some(nearer.boxes.iter().map(placed).collect())
    }
}

/// Names of categories by the tokens of instances; none where their tables were not fetched.
fn categories(tables: &Path) -> Result<BTreeMap<String, String>> {
    if ["instance.json", "category.json"].iter().any(|name| !tables.join(name).exists()) {
        return Ok(BTreeMap::new());
    }
    let instances: Vec<Instance> = read_table(&tables.join("instance.json"), |_| true)?;
    let categories: Vec<Category> = read_table(&tables.join("category.json"), |_| true)?;
    let names: BTreeMap<String, String> = categories.into_iter().map(|c| (c.token, c.name)).collect();
    let of_instance = |i: Instance| names.get(&i.category_token).map(|name| (i.token, name.clone()));
    Ok(instances.into_iter().filter_map(of_instance).collect())
}
