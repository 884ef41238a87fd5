//! One configuration of a reconstruction, in the words of `lgs-infer`.

use std::num::NonZeroUsize;

use clap::ValueEnum;
use lgs_engine::{
    densify::{Density, Limit},
    gaussians::{Coarseness, Start, background::Mode},
    refine::LineSearch,
};
use serde::{Deserialize, Serialize};

use super::error::{Result, SweepError};

/// Score above which the policy acts where nobody says otherwise.
pub const THETA: f32 = 0.7;

/// Whether the query runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Switch {
    /// It does.
    On,
    /// It does not.
    Off,
}

/// Weights, apart from where they lie.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Weights {
    /// What people call them: the name of the file, or that of weights that ship.
    pub name: String,
    /// SHA-256 of the file; for seeded weights `random:` and that of the config.
    pub sha256: String,
}

/// How a network is used.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Network {
    /// Its weights.
    pub weights: Weights,
    /// Whether primitives ask those of other moments.
    pub query: Switch,
    /// Who prunes and adds.
    pub density: Density,
    /// Score above which a primitive is pruned or copied.
    pub theta: f32,
    /// Largest number of `LiDAR` Gaussians after the set update.
    pub max_gaussians: Option<Limit>,
}

/// How a scene is refined.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Refine {
    /// Steps of the network; 0 without one.
    pub learned: usize,
    /// Steps of per-scene optimisation after them.
    pub adam: usize,
    /// Input views that a step looks at; `None` for all.
    pub views: Option<NonZeroUsize>,
    /// How many times smaller in width and height the images are that a step looks at.
    pub reduce: usize,
    /// Learned steps whose lengths are searched for.
    pub line_search: LineSearch,
}

/// One configuration of a reconstruction.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Setting {
    /// Where the background comes from.
    pub background: Mode,
    /// How coarse the scene is to begin with.
    pub coarseness: Coarseness,
    /// How the network is used; `None` without one.
    pub network: Option<Network>,
    /// How it is refined.
    pub refine: Refine,
}

/// The word that the user gives for a value.
pub fn word(value: &impl ValueEnum) -> String {
    value.to_possible_value().map_or(String::new(), |value| value.get_name().to_owned())
}

impl Setting {
    /// What its scene begins with.
    pub const fn start(&self) -> Start {
        Start { background: self.background, coarseness: self.coarseness }
    }

    /// Whether it is the reference: per-scene optimisation without a network.
    pub const fn is_reference(&self) -> bool {
        self.network.is_none()
    }

    /// Whether it is the same as another but for the steps of per-scene optimisation.
    pub fn differs_in_steps_only(&self, other: &Self) -> bool {
        let adam = self.refine.adam;
        *self == Self { refine: Refine { adam, ..other.refine }, ..other.clone() }
    }

    /// Steps of both refinements.
    pub const fn steps(&self) -> usize {
        self.refine.learned + self.refine.adam
    }

    /// A text that tells it from every other.
    ///
    /// # Errors
    /// Never: it holds nothing that JSON cannot say.
    pub fn identity(&self) -> Result<String> {
        serde_json::to_string(self).map_err(|source| SweepError::Json { what: "configuration", source })
    }

    /// The words of `lgs-infer` that ask for it, `--weights` left out.
    pub fn flags(&self) -> Vec<String> {
        let mut flags = vec![format!("--background {}", word(&self.background))];
        flags.extend((!self.coarseness.is_usual()).then(|| format!("--coarseness {}", self.coarseness)));
        let Refine { learned, adam, views, reduce, line_search } = self.refine;
        flags.extend(self.network.is_some().then(|| format!("--refine-steps {learned}")));
        flags.extend((!line_search.is_every()).then(|| format!("--line-search {}", word(&line_search))));
        flags.extend((adam > 0 || self.network.is_none()).then(|| format!("--refine-with adam:{adam}")));
        flags.extend(views.map(|views| format!("--refine-views {views}")));
        flags.extend((reduce > 1).then(|| format!("--refine-reduce {reduce}")));
        if let Some(network) = &self.network {
            flags.push(format!("--query {}", word(&network.query)));
            flags.push(format!("--density {}", word(&network.density)));
            if network.density != Density::Off {
                flags.push(format!("--theta-prune {0} --theta-add {0}", network.theta));
                flags.extend(network.max_gaussians.map(|most| format!("--max-gaussians {most}")));
            }
        }
        flags
    }

    /// A name for people, of what is not as usual.
    pub fn name(&self) -> String {
        let mut parts = Vec::new();
        parts.extend(self.network.as_ref().map(|network| network.weights.name.clone()));
        let Refine { learned, adam, views, reduce, line_search } = self.refine;
        let plural = if learned == 1 { "" } else { "s" };
        parts.extend(self.network.is_some().then(|| format!("{learned} step{plural}")));
        match line_search {
            LineSearch::Every => {}
            LineSearch::Last => parts.push("line search in the last".to_owned()),
            LineSearch::Off => parts.push("no line search".to_owned()),
        }
        parts.extend((adam > 0 || self.network.is_none()).then(|| format!("Adam {adam}")));
        parts.extend(views.map(|views| format!("{views} views a step")));
        parts.extend((reduce > 1).then(|| format!("images 1/{reduce}")));
        if let Some(network) = &self.network {
            parts.extend((network.query == Switch::Off).then(|| "no query".to_owned()));
            match network.density {
                Density::Policy => {}
                Density::Random => parts.push("density by chance".to_owned()),
                Density::Off => parts.push("no policy".to_owned()),
            }
            if network.density != Density::Off && network.theta != THETA {
                parts.push(format!("theta {}", network.theta));
            }
            parts.extend(network.max_gaussians.map(|most| format!("at most {most}")));
        }
        match self.background {
            Mode::Auto => {}
            Mode::Off => parts.push("no background".to_owned()),
            other => parts.push(format!("background {}", word(&other))),
        }
        parts.extend((!self.coarseness.is_usual()).then(|| format!("coarseness {}", self.coarseness)));
        parts.join(", ")
    }
}
