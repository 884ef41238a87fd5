//! What decides which Gaussians of a scene stay.

use std::{fmt, str::FromStr};

use lgs_engine::{
    densify::{Limit, Scope},
    evidence::survivors,
    gaussians::{GaussianSet, LOGIT_OPACITY},
    render::Device,
    views::View,
};
use rand_chacha::{
    ChaCha8Rng,
    rand_core::{Rng, SeedableRng},
};
use serde::{Deserialize, Serialize};

use super::entropy::entropy_of;

/// What decides which Gaussians stay.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Signal {
    /// What taking each out costs in the input views, measured in rounds.
    Exact,
    /// The same over input and held-out views: what nobody can know, as a ceiling.
    Oracle,
    /// The most opaque stay.
    Opacity,
    /// Chance by the entropy of the input image where a Gaussian stands: what image content alone says.
    Entropy,
    /// Chance.
    Chance,
}

/// What a signal decides by.
#[derive(Clone, Copy, Debug)]
pub struct Seen<'a> {
    /// The scene, as far ahead as pruning takes it.
    pub scene: &'a GaussianSet,
    /// Its input views.
    pub inputs: &'a [&'a View],
    /// Its held-out views.
    pub held_out: &'a [View],
    /// Seed of chance.
    pub seed: u64,
}

impl Signal {
    /// Every signal.
    pub const ALL: [Self; 5] = [Self::Exact, Self::Oracle, Self::Opacity, Self::Entropy, Self::Chance];

    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Exact => "exact",
            Self::Oracle => "oracle",
            Self::Opacity => "opacity",
            Self::Entropy => "entropy",
            Self::Chance => "chance",
        }
    }

    /// The Gaussians that stay, in the order of the scene, as many as the percentage says.
    pub fn survivors(self, seen: Seen<'_>, percent: u32) -> Vec<usize> {
        let (scene, limit) = (seen.scene, Limit::Percent(percent));
        let by_costs = |judges: &[&View]| survivors(scene, judges, (Scope::All, Some(limit)), Device::Cpu, &mut || ());
        let count = limit.of(scene.len());
        match self {
            Self::Exact => by_costs(seen.inputs),
            Self::Oracle => by_costs(&seen.inputs.iter().copied().chain(seen.held_out).collect::<Vec<_>>()),
            Self::Opacity => {
                let opacity = |i: usize| f64::from(scene.attributes[i][LOGIT_OPACITY]);
                greatest((0..scene.len()).map(opacity).collect(), count)
            }
            Self::Entropy => greatest(drawn(&entropy_of(scene, seen.inputs), seen.seed), count),
            Self::Chance => greatest(drawn(&vec![1.0; scene.len()], seen.seed), count),
        }
    }
}

impl fmt::Display for Signal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Signal {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let found = Self::ALL.into_iter().find(|signal| signal.name() == text);
        found.ok_or_else(|| {
            let names = Self::ALL.map(Self::name).join(", ");
            format!("expected one of {names}, found {text:?}")
        })
    }
}

/// Keys whose greatest are a draw without replacement, each by its weight.
///
/// # Formula
/// `ln(u) / weight`, u uniform over (0, 1].
///
/// # Source
/// Efraimidis and Spirakis, Weighted random sampling with a reservoir, 2006.
fn drawn(weights: &[f64], seed: u64) -> Vec<f64> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let uniform = |bits: u64| ((bits >> 11) as f64 + 1.0) / (1_u64 << 53) as f64;
    weights.iter().map(|weight| uniform(random.next_u64()).ln() / weight).collect()
}

/// Indices of the greatest values, ascending; of equal ones the first.
fn greatest(values: Vec<f64>, count: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&a, &b| values[b].total_cmp(&values[a]).then(a.cmp(&b)));
    order.truncate(count);
    order.sort_unstable();
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_greatest_stay_in_the_order_of_the_scene() {
        assert_eq!(greatest(vec![1.0, 5.0, 3.0, 5.0, 0.0], 3), [1, 2, 3]);
        assert_eq!(greatest(vec![1.0, 1.0, 1.0], 2), [0, 1]);
        assert_eq!(greatest(vec![1.0], 5), [0]);
    }

    #[test]
    fn a_draw_follows_its_weights() {
        let weights: Vec<f64> = (0..4000).map(|i| if i % 2 == 0 { 4.0 } else { 1.0 }).collect();
        let kept = greatest(drawn(&weights, 7), 400);
        let heavy = kept.iter().filter(|&&i| i % 2 == 0).count();
        assert!((290..350).contains(&heavy), "{heavy} of 400, expected some 320");
        assert_eq!(kept, greatest(drawn(&weights, 7), 400));
        assert_ne!(kept, greatest(drawn(&weights, 8), 400));
    }

    #[test]
    fn names_are_read_as_they_are_written() {
        for signal in Signal::ALL {
            assert_eq!(signal.to_string().parse(), Ok(signal));
        }
        assert!("best".parse::<Signal>().unwrap_err().contains("exact, oracle"));
    }
}
