//! `tracklet_labels.xml`: boxes over the frames, in the LiDAR's frame, standing on the ground point of the object.

use std::{collections::BTreeMap, path::Path};

use glam::DVec3;
use roxmltree::{Document, Node, ParsingOptions};

use crate::{
    clip::TrackedBox,
    error::{FormatError, Result},
    importers::values::{read_text, yaw},
    pose::Pose,
};

/// Largest number of XML nodes that are looked at.
const MAX_NODES: u32 = 50_000_000;

/// Boxes by frame number, in the LiDAR's frame; `None` when there is no such file.
pub(super) fn read(file: &Path) -> Result<Option<BTreeMap<u64, Vec<TrackedBox>>>> {
    if !file.exists() {
        return Ok(None);
    }
    let text = read_text(file)?;
    // The document's type is declared but never used.
    let options = ParsingOptions { allow_dtd: true, nodes_limit: MAX_NODES, ..ParsingOptions::default() };
    let document = Document::parse_with_options(&text, options)
        .map_err(|e| FormatError::syntax(file, "document", e.to_string()))?;
    let list = child(document.root_element(), "tracklets")
        .ok_or_else(|| FormatError::invalid(file, "document", "an element `tracklets`", "none"))?;
    let mut boxes: BTreeMap<u64, Vec<TrackedBox>> = BTreeMap::new();
    for (track, item) in items(list).enumerate() {
        let reader = Reader { file, track };
        let category = reader.text(item, "objectType")?;
        let [height, width, length] = [reader.number(item, "h")?, reader.number(item, "w")?, reader.number(item, "l")?];
        let first: u64 = reader.value(item, "first_frame", "a frame number")?;
        let poses = child(item, "poses").ok_or_else(|| reader.error("poses", "an element", "none"))?;
        for (frame, pose) in items(poses).enumerate() {
            let frame = first.saturating_add(frame as u64);
            let ground = [reader.number(pose, "tx")?, reader.number(pose, "ty")?, reader.number(pose, "tz")?];
            let centre = DVec3::from(ground) + DVec3::new(0.0, 0.0, height / 2.0);
            let world_from_box = Pose::new(yaw(reader.number(pose, "rz")?), centre);
            let (track, category) = (track.to_string(), category.to_owned());
            let size = [length, width, height];
            boxes.entry(frame).or_default().push(TrackedBox { track, category, size, world_from_box });
        }
    }
    Ok(Some(boxes))
}

fn child<'a>(node: Node<'a, 'a>, name: &str) -> Option<Node<'a, 'a>> {
    node.children().find(|child| child.has_tag_name(name))
}

fn items<'a>(node: Node<'a, 'a>) -> impl Iterator<Item = Node<'a, 'a>> {
    node.children().filter(|child| child.has_tag_name("item"))
}

struct Reader<'a> {
    file: &'a Path,
    track: usize,
}

impl Reader<'_> {
    fn error(&self, name: &str, expected: &str, found: &str) -> FormatError {
        FormatError::invalid(self.file, format!("tracklet {}: {name}", self.track), expected, found)
    }

    fn text<'a>(&self, node: Node<'a, 'a>, name: &str) -> Result<&'a str> {
        child(node, name).and_then(|c| c.text()).map(str::trim).ok_or_else(|| self.error(name, "a text", "none"))
    }

    fn value<T: std::str::FromStr>(&self, node: Node<'_, '_>, name: &str, expected: &str) -> Result<T> {
        let text = child(node, name).and_then(|c| c.text()).unwrap_or_default().trim();
        text.parse().map_err(|_e| self.error(name, expected, &format!("`{text}`")))
    }

    fn number(&self, node: Node<'_, '_>, name: &str) -> Result<f64> {
        let number: f64 = self.value(node, name, "a number")?;
        if number.is_finite() { Ok(number) } else { Err(self.error(name, "a finite number", &number.to_string())) }
    }
}
