//! Lists of frames as users write them: `0,2,5..8`.

use std::{fmt, str::FromStr};

/// Largest frame index that may be asked for, so that a range cannot fill the memory.
const MAX_FRAME: usize = 1_000_000;

/// Indices of frames, in the order in which they were given.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameList(pub Vec<usize>);

impl FromStr for FrameList {
    type Err = String;

    /// The frames of a list of indices and ranges with both ends.
    fn from_str(text: &str) -> Result<Self, String> {
        let mut frames = Vec::new();
        for item in text.split(',') {
            let (first, last) = item.split_once("..").unwrap_or((item, item));
            let (first, last) = (index(first)?, index(last)?);
            if first > last {
                return Err(format!("expected an ascending range, found {item}"));
            }
            frames.extend(first..=last);
            if frames.len() > MAX_FRAME + 1 {
                return Err(format!("expected at most {} frames, found more", MAX_FRAME + 1));
            }
        }
        Ok(Self(frames))
    }
}

impl fmt::Display for FrameList {
    /// One index after the other, without ranges.
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let frames: Vec<String> = self.0.iter().map(usize::to_string).collect();
        formatter.write_str(&frames.join(","))
    }
}

fn index(text: &str) -> Result<usize, String> {
    let number = text.trim().parse().ok().filter(|&number| number <= MAX_FRAME);
    number.ok_or_else(|| format!("expected frame indices from 0 to {MAX_FRAME}, found {text:?}"))
}

#[cfg(test)]
mod tests {
    use super::FrameList;

    #[test]
    fn indices_and_ranges_keep_their_order() {
        assert_eq!("7,0,2..4".parse(), Ok(FrameList(vec![7, 0, 2, 3, 4])));
        assert_eq!(FrameList(vec![7, 0, 2]).to_string(), "7,0,2");
    }

    #[test]
    fn what_is_no_list_is_refused() {
        for text in ["", "1,", "-1", "5..2", "0..1000001", "99999999999", "a", "0..1000000,0..1000000"] {
            assert!(text.parse::<FrameList>().is_err(), "{text}");
        }
    }
}
