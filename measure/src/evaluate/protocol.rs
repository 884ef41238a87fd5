//! Protocols: which cameras at which size, and how a drive is cut into snippets of input and target frames.

use lgs_formats::image::ImageSize;
use lgs_pages::ranges;
use serde_json::{Value, json};

use crate::error::{MeasureError, Result};

/// Which protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Name {
    /// That of the Waymo table.
    Waymo,
    /// That of the `PandaSet` table.
    PandaSet,
    /// One's own.
    Own,
}

/// How a drive is cut.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Cutting {
    /// Snippets of successive frames.
    Windows(Windows),
    /// A snippet for each target frame.
    Targets {
        /// Frames `every - 1`, `2 every - 1`, ... are targets, and inputs of none.
        every: usize,
        /// The so many nearest frames that are no targets are inputs, the earlier of two equally near ones, at least one on either side.
        inputs: usize,
    },
}

/// Snippets of successive frames.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Windows {
    /// Frames of a snippet.
    pub length: usize,
    /// From the first frame of a snippet to that of the next.
    pub stride: usize,
    /// Places in a snippet, from 0, of the frames that are held out.
    pub held_out: Vec<usize>,
    /// Most snippets of a drive; `None` for all.
    pub most: Option<usize>,
}

/// A protocol.
#[derive(Clone, Debug, PartialEq)]
pub struct Protocol {
    /// Which it is.
    pub name: Name,
    /// Names of the cameras; `None` for all.
    pub cameras: Option<Vec<String>>,
    /// Size to which every image is brought; `None` for its own.
    pub image_size: Option<ImageSize>,
    /// How drives are cut.
    pub cutting: Cutting,
}

/// A snippet: indices of frames of its drive, ascending.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Snippet {
    /// What the reconstruction reads.
    pub inputs: Vec<usize>,
    /// What is drawn and measured.
    pub targets: Vec<usize>,
}

impl Name {
    /// Its word.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Waymo => "waymo",
            Self::PandaSet => "pandaset",
            Self::Own => "own",
        }
    }
}

impl Snippet {
    /// Its first frame.
    pub fn first(&self) -> usize {
        self.frames().first().copied().unwrap_or(0)
    }

    /// Inputs and targets, ascending.
    pub fn frames(&self) -> Vec<usize> {
        let mut all = [self.inputs.as_slice(), &self.targets].concat();
        all.sort_unstable();
        all
    }
}

impl Protocol {
    /// Three front cameras at 256x512; every tenth frame is drawn from the three nearest of the others.
    pub fn waymo() -> Self {
        Self {
            name: Name::Waymo,
            cameras: Some(["FRONT_LEFT", "FRONT", "FRONT_RIGHT"].map(str::to_owned).to_vec()),
            image_size: Some(ImageSize { height: 256, width: 512 }),
            cutting: Cutting::Targets { every: 10, inputs: 3 },
        }
    }

    /// The front camera at full size; 11 frames from every 20th on, four times a log, the odd ones held out.
    pub fn pandaset() -> Self {
        let windows = Windows { length: 11, stride: 20, held_out: vec![1, 3, 5, 7, 9], most: Some(4) };
        Self {
            name: Name::PandaSet,
            cameras: Some(vec!["front_camera".to_owned()]),
            image_size: None,
            cutting: Cutting::Windows(windows),
        }
    }

    /// The snippets of a drive of so many frames.
    ///
    /// # Errors
    /// A drive that is too short for one.
    pub fn snippets(&self, num_frames: usize) -> Result<Vec<Snippet>> {
        let (found, least) = match &self.cutting {
            Cutting::Windows(windows) => (windows.cut(num_frames), windows.length),
            Cutting::Targets { every, inputs } => (around_targets(num_frames, *every, *inputs), every + 1),
        };
        if found.is_empty() {
            let expected = format!("at least {least} frames, which a snippet of this protocol takes");
            return Err(MeasureError::unfit("frames", expected, num_frames));
        }
        Ok(found)
    }

    /// Everything that it says, for records.
    pub fn recorded(&self) -> Value {
        let cutting = match &self.cutting {
            Cutting::Windows(Windows { length, stride, held_out, most }) => {
                json!({ "snippet_frames": length, "stride": stride, "held_out": held_out, "max_snippets": most })
            }
            Cutting::Targets { every, inputs } => json!({ "every": every, "inputs": inputs }),
        };
        let size = self.image_size.map(|size| [size.height, size.width]);
        json!({
            "name": self.name.word(),
            "cameras": self.cameras,
            "image_size": size,
            "cutting": cutting,
            "in_words": self.in_words(),
        })
    }

    /// How drives are cut, for people.
    pub fn in_words(&self) -> String {
        match &self.cutting {
            Cutting::Windows(Windows { length, stride, held_out, most }) => {
                let places = if held_out.is_empty() { "none".to_owned() } else { ranges(held_out) };
                let most = most.map_or(String::new(), |most| format!(", at most {most} a log"));
                format!(
                    "snippets of {length} frames, from one start to the next {stride}{most}; held out of each: {places}"
                )
            }
            Cutting::Targets { every, inputs } => {
                format!("every {every}th frame is held out and drawn from the {inputs} nearest of the others")
            }
        }
    }
}

impl Windows {
    fn cut(&self, num_frames: usize) -> Vec<Snippet> {
        let starts = (0..num_frames).step_by(self.stride.max(1)).take_while(|start| start + self.length <= num_frames);
        let snippet = |start: usize| {
            let (targets, inputs) =
                (start..start + self.length).partition(|frame| self.held_out.contains(&(frame - start)));
            Snippet { inputs, targets }
        };
        starts.take(self.most.unwrap_or(usize::MAX)).map(snippet).collect()
    }
}

fn around_targets(num_frames: usize, every: usize, count: usize) -> Vec<Snippet> {
    let is_target = |frame: usize| (frame + 1).is_multiple_of(every);
    // Of two successive frames one is no target at least: the nearest ones stand within twice their number.
    let reach = 2 * count;
    let of_target = |target: usize| {
        let near = target.saturating_sub(reach)..num_frames.min(target + reach + 1);
        let mut others: Vec<usize> = near.filter(|&frame| !is_target(frame)).collect();
        others.sort_by_key(|&frame| (frame.abs_diff(target), frame));
        others.truncate(count);
        others.sort_unstable();
        Snippet { inputs: others, targets: vec![target] }
    };
    let lies_between = |snippet: &Snippet| {
        let (before, after): (Vec<usize>, Vec<usize>) =
            snippet.inputs.iter().partition(|&&frame| frame < snippet.targets[0]);
        !before.is_empty() && !after.is_empty() && snippet.inputs.len() == count
    };
    (0..num_frames).filter(|&frame| is_target(frame)).map(of_target).filter(lies_between).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cut(protocol: &Protocol, num_frames: usize) -> Vec<(Vec<usize>, Vec<usize>)> {
        protocol.snippets(num_frames).unwrap().into_iter().map(|s| (s.inputs, s.targets)).collect()
    }

    #[test]
    fn a_log_of_pandaset_has_four_snippets_of_six_inputs_and_five_targets() {
        let protocol = Protocol::pandaset();
        let log = cut(&protocol, 80);
        assert_eq!(log.len(), 4);
        assert_eq!(log[0], (vec![0, 2, 4, 6, 8, 10], vec![1, 3, 5, 7, 9]));
        assert_eq!(log[3].1, [61, 63, 65, 67, 69]);
        assert_eq!((cut(&protocol, 11).len(), cut(&protocol, 30).len(), cut(&protocol, 31).len()), (1, 1, 2));
        assert_eq!(cut(&protocol, 200).len(), 4);
        let message = protocol.snippets(10).unwrap_err().to_string();
        assert!(message.starts_with("frames: expected at least 11 frames") && message.ends_with("found 10"));
    }

    #[test]
    fn every_tenth_frame_of_waymo_is_drawn_from_its_neighbours_and_an_input_of_none() {
        let log = cut(&Protocol::waymo(), 198);
        assert_eq!(log.len(), 19);
        assert_eq!(log[0], (vec![7, 8, 10], vec![9]));
        assert_eq!(log[18], (vec![187, 188, 190], vec![189]));
        assert!(log.iter().all(|(inputs, _)| inputs.iter().all(|frame| frame % 10 != 9)));
        // The last frame has nothing behind it.
        assert_eq!(cut(&Protocol::waymo(), 20).len(), 1);
        assert!(Protocol::waymo().snippets(10).is_err());
    }

    #[test]
    fn windows_may_overlap() {
        let windows = Windows { length: 3, stride: 1, held_out: vec![1], most: None };
        let own = Protocol { name: Name::Own, cameras: None, image_size: None, cutting: Cutting::Windows(windows) };
        assert_eq!(cut(&own, 5), [(vec![0, 2], vec![1]), (vec![1, 3], vec![2]), (vec![2, 4], vec![3])]);
        assert_eq!(own.snippets(5).unwrap()[1].frames(), [1, 2, 3]);
    }
}
