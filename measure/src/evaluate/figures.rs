//! The figures of a view or a mean: those of the engine, and the depth error of what moves.

use lgs_engine::{evaluate::ViewFigures, report::FIGURES};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};
use serde_json::{Map, Value, json};

/// How many figures there are.
pub const COUNT: usize = FIGURES.len() + 1;

/// A figure as people and programs know it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Kind {
    /// Its key in files.
    pub key: &'static str,
    /// Heading for people, with the unit.
    pub label: &'static str,
    /// Digits after the point that people are shown.
    pub digits: usize,
    /// Whether more is better; `None` for a figure that others are compared with.
    pub more_is_better: Option<bool>,
}

/// The figure that the engine has not.
const DMAE_DYNAMIC: Kind = Kind { key: "dmae_dynamic", label: "DMAE, dynamic", digits: 2, more_is_better: Some(false) };

/// Every figure, in the order of [`Figures`].
pub fn kinds() -> [Kind; COUNT] {
    std::array::from_fn(|k| {
        FIGURES.get(k).map_or(DMAE_DYNAMIC, |kind| Kind {
            key: kind.key,
            label: kind.label,
            digits: kind.digits,
            more_is_better: match kind.better {
                "↑" => Some(true),
                "↓" => Some(false),
                _ => None,
            },
        })
    })
}

/// Values of all figures; `None` where one is not defined. In files a map by key, infinity as `"inf"`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Figures([Option<f64>; COUNT]);

impl Figures {
    /// Those of a view, with the depth error of what moves.
    pub fn of(view: &ViewFigures, dmae_dynamic: Option<f64>) -> Self {
        Self(std::array::from_fn(|k| FIGURES.get(k).map_or(dmae_dynamic, |kind| (kind.get)(view))))
    }

    /// The value of a key; `None` where it is not defined.
    pub fn get(&self, key: &str) -> Option<f64> {
        kinds().iter().position(|kind| kind.key == key).and_then(|k| self.0[k])
    }

    /// The means of each figure over those that have it.
    pub fn mean<'a>(all: impl Iterator<Item = &'a Self> + Clone) -> Self {
        Self(std::array::from_fn(|k| {
            let values: Vec<f64> = all.clone().filter_map(|figures| figures.0[k]).collect();
            (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
        }))
    }

    /// The value as people are shown it; a dash where it is not defined.
    pub fn text(&self, kind: &Kind) -> String {
        match self.get(kind.key) {
            Some(value) if value == f64::INFINITY => "∞".to_owned(),
            Some(value) if value.is_finite() => format!("{value:.*}", kind.digits),
            _ => "–".to_owned(),
        }
    }

    /// The value as tables for programs have it; empty where it is not defined.
    pub fn exact(&self, kind: &Kind) -> String {
        self.get(kind.key).map_or(String::new(), |value| value.to_string())
    }
}

impl Serialize for Figures {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let value = |value: Option<f64>| match value {
            Some(value) if value == f64::INFINITY => json!("inf"),
            Some(value) if value.is_finite() => json!(value),
            _ => Value::Null,
        };
        serializer.collect_map(kinds().iter().zip(self.0).map(|(kind, number)| (kind.key, value(number))))
    }
}

impl<'de> Deserialize<'de> for Figures {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let map = Map::deserialize(deserializer)?;
        let mut figures = Self::default();
        for (kind, figure) in kinds().iter().zip(&mut figures.0) {
            *figure = match map.get(kind.key) {
                Some(Value::Null) => None,
                Some(Value::String(text)) if text == "inf" => Some(f64::INFINITY),
                Some(Value::Number(number)) => number.as_f64(),
                other => {
                    let expected = format!("{}: expected a number, null or \"inf\", found {other:?}", kind.key);
                    return Err(D::Error::custom(expected));
                }
            };
        }
        Ok(figures)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_read_back_as_they_were() {
        let view = ViewFigures { psnr: Some(f64::INFINITY), ssim: Some(0.1 + 0.2), ..ViewFigures::default() };
        let figures = Figures::of(&view, Some(1.5));
        let text = serde_json::to_string(&figures).unwrap();
        assert!(text.contains("\"psnr\":\"inf\"") && text.contains("\"lpips\":null"), "{text}");
        assert_eq!(serde_json::from_str::<Figures>(&text).unwrap(), figures);
        assert!(serde_json::from_str::<Figures>("{}").is_err());
        assert_eq!((figures.get("dmae_dynamic"), figures.get("dmae")), (Some(1.5), None));
    }

    #[test]
    fn a_mean_is_over_those_that_have_the_figure() {
        let figures = |psnr: f64, ssim: Option<f64>| {
            Figures::of(&ViewFigures { psnr: Some(psnr), ssim, ..ViewFigures::default() }, None)
        };
        let all = [figures(20.0, Some(0.5)), figures(30.0, None)];
        let mean = Figures::mean(all.iter());
        assert_eq!((mean.get("psnr"), mean.get("ssim"), mean.get("dmae_dynamic")), (Some(25.0), Some(0.5), None));
    }
}
