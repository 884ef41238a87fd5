//! Rules that say which frames are held out.

use std::num::NonZeroUsize;

use lgs_formats::frame_list::FrameList;

use crate::error::{EngineError, Result};

/// Which frames are held out. Rules count by index in the clip, whichever frames take part.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum HoldOut {
    /// None.
    Nothing,
    /// These indices.
    List(Vec<usize>),
    /// Odd indices: 1, 3, 5, ...
    Odd,
    /// The N-th frame, the 2N-th and so on: indices N-1, 2N-1, ...
    Every(NonZeroUsize),
}

impl HoldOut {
    /// The indices that the rule holds out of a clip of `num_frames` frames of which `frames` take part (all when
    /// `None`). A list is returned as it is: whether it fits the clip is for
    /// [`Selection::frames`](crate::views::Selection::frames) to say.
    ///
    /// # Errors
    /// [`EngineError::Setting`] for a rule that no frame meets.
    pub fn indices(&self, num_frames: usize, frames: Option<&[usize]>) -> Result<Vec<usize>> {
        let meets = |frame: usize| match self {
            Self::Nothing | Self::List(_) => false,
            Self::Odd => frame % 2 == 1,
            Self::Every(n) => (frame + 1).is_multiple_of(n.get()),
        };
        let found: Vec<usize> = match (self, frames) {
            (Self::Nothing, _) => return Ok(Vec::new()),
            (Self::List(list), _) => return Ok(list.clone()),
            (_, Some(frames)) => frames.iter().copied().filter(|&frame| meets(frame)).collect(),
            (_, None) => (0..num_frames).filter(|&frame| meets(frame)).collect(),
        };
        if found.is_empty() {
            let expected = "a rule that some selected frame meets".to_owned();
            return Err(EngineError::Setting { setting: "hold-out", expected, found: self.to_string() });
        }
        Ok(found)
    }
}

impl std::str::FromStr for HoldOut {
    type Err = String;

    /// The rule that [`HoldOut`] prints so.
    fn from_str(text: &str) -> std::result::Result<Self, String> {
        match (text, text.strip_prefix("every:")) {
            ("none", _) => Ok(Self::Nothing),
            ("odd", _) => Ok(Self::Odd),
            (_, Some(n)) => {
                n.parse().map(Self::Every).map_err(|error| format!("expected every:N with N of 1 or more: {error}"))
            }
            (list, None) => list
                .parse()
                .map(|FrameList(frames)| Self::List(frames))
                .map_err(|error| format!("{error}; or odd, or every:N, or none")),
        }
    }
}

impl std::fmt::Display for HoldOut {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Nothing => write!(formatter, "none"),
            Self::List(frames) => write!(formatter, "{}", FrameList(frames.clone())),
            Self::Odd => write!(formatter, "odd"),
            Self::Every(n) => write!(formatter, "every:{n}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::HoldOut;

    fn every(n: usize) -> HoldOut {
        HoldOut::Every(n.try_into().unwrap())
    }

    #[test]
    fn rules_count_by_index_in_the_clip() {
        assert_eq!(HoldOut::Odd.indices(6, None).unwrap(), [1, 3, 5]);
        assert_eq!(HoldOut::Odd.indices(6, Some(&[2, 3, 4])).unwrap(), [3]);
        assert_eq!(every(2).indices(6, None).unwrap(), [1, 3, 5]);
        assert_eq!(every(10).indices(25, None).unwrap(), [9, 19]);
        assert_eq!(HoldOut::List(vec![4, 0]).indices(6, Some(&[1])).unwrap(), [4, 0]);
        assert!(HoldOut::Nothing.indices(6, None).unwrap().is_empty());
    }

    #[test]
    fn rules_are_read_as_they_are_printed() {
        for text in ["none", "odd", "every:3", "1,4"] {
            assert_eq!(text.parse::<HoldOut>().unwrap().to_string(), text);
        }
        assert_eq!("1..3".parse::<HoldOut>().unwrap(), HoldOut::List(vec![1, 2, 3]));
        for text in ["", "even", "every:0", "every:", "1,", "-1", "5..2"] {
            assert!(text.parse::<HoldOut>().is_err(), "{text}");
        }
    }

    #[test]
    fn a_rule_that_no_frame_meets_is_an_error() {
        let error = every(10).indices(9, None).unwrap_err().to_string();
        assert_eq!(error, "hold-out: expected a rule that some selected frame meets, found every:10");
        assert!(HoldOut::Odd.indices(6, Some(&[0, 2])).is_err());
    }
}
