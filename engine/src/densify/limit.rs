//! How many primitives may be left.

use std::{fmt, str::FromStr};

use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

/// How many primitives of the `LiDAR` branch may be left after the set update: `50000`, or `70%` of those before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Limit {
    /// So many.
    Count(usize),
    /// So many of every hundred that there were, rounded down.
    Percent(u32),
}

impl Limit {
    /// The number of primitives, of `before` ones.
    pub const fn of(self, before: usize) -> usize {
        match self {
            Self::Count(count) => count,
            // A usize of 64 bits: no number of primitives in memory times 2^32 exceeds u128.
            Self::Percent(percent) => {
                let share = before as u128 * percent as u128 / 100;
                if share > usize::MAX as u128 { usize::MAX } else { share as usize }
            }
        }
    }
}

impl FromStr for Limit {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parsed = match text.strip_suffix('%') {
            Some(percent) => percent.parse().ok().map(Self::Percent),
            None => text.parse().ok().map(Self::Count),
        };
        parsed.ok_or_else(|| format!("expected a number such as 50000, or a share such as 70%, found {text}"))
    }
}

impl fmt::Display for Limit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Count(count) => write!(f, "{count}"),
            Self::Percent(percent) => write!(f, "{percent}%"),
        }
    }
}

impl Serialize for Limit {
    /// A number, or a share as text.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Count(count) => count.serialize(serializer),
            Self::Percent(_) => serializer.collect_str(self),
        }
    }
}

impl<'de> Deserialize<'de> for Limit {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged)]
        enum Value {
            Count(usize),
            Text(String),
        }
        match Value::deserialize(deserializer)? {
            Value::Count(count) => Ok(Self::Count(count)),
            Value::Text(text) => text.parse().map_err(D::Error::custom),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Limit;

    #[test]
    fn a_limit_is_read_as_it_is_written() {
        for (text, json, limit) in [
            ("0", "0", Limit::Count(0)),
            ("50000", "50000", Limit::Count(50_000)),
            ("70%", "\"70%\"", Limit::Percent(70)),
        ] {
            assert_eq!((text.parse(), limit.to_string()), (Ok(limit), text.to_owned()));
            assert_eq!(serde_json::to_string(&limit).unwrap(), json);
            assert_eq!(serde_json::from_str::<Limit>(json).unwrap(), limit);
        }
        for text in ["", "%", "-1", "1.5%", "70 %", "x", "99999999999%"] {
            assert!(text.parse::<Limit>().unwrap_err().ends_with(text), "{text}");
        }
    }

    #[test]
    fn a_share_is_rounded_down() {
        assert_eq!([0, 1, 9, 10, 11].map(|before| Limit::Percent(70).of(before)), [0, 0, 6, 7, 7]);
        assert_eq!((Limit::Percent(u32::MAX).of(usize::MAX), Limit::Count(3).of(1)), (usize::MAX, 3));
    }
}
