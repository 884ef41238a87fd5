//! A way to reconstruct, apart from the clip and the weights: every option that decides on the scene.

mod knobs;

use std::num::NonZeroUsize;

use serde::{Deserialize, Serialize};

use crate::{
    densify::{Density, Limit, Scope, Thresholds},
    gaussians::{Coarseness, Start, background::Mode},
    refine::{LineSearch, PixelStride, ViewSchedule},
    render::{Device, DeviceChoice},
};

pub use knobs::{KNOBS, Knob};

/// Which parts of the pipeline run, and how often.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// What stands behind the `LiDAR` Gaussians.
    pub background: Mode,
    /// How coarse the scene is to begin with.
    #[serde(default, skip_serializing_if = "Coarseness::is_usual")]
    pub coarseness: Coarseness,
    /// Whether there is a network.
    pub network: bool,
    /// Whether primitives ask those of other timestamps.
    pub query: bool,
    /// Who prunes and adds.
    pub density: Density,
    /// Scores above which the policy prunes and adds.
    #[serde(default, skip_serializing_if = "Thresholds::are_usual")]
    pub thresholds: Thresholds,
    /// Which Gaussians exact pruning may take.
    #[serde(default, skip_serializing_if = "Scope::is_usual")]
    pub density_scope: Scope,
    /// Largest number of Gaussians after that, of those that the update may take; `None` for no limit. See [`usual_limit`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_gaussians: Option<Limit>,
    /// Steps of the learned refinement; 0 without a network.
    pub refine_steps: usize,
    /// Passes of per-scene optimisation over the input views after them.
    pub adam_passes: usize,
    /// Most input views that a step looks at; `None` for all in a learned one, and for one in one of per-scene optimisation.
    pub refine_views: Option<NonZeroUsize>,
    /// Which pixels of the images a step looks at.
    #[serde(default, skip_serializing_if = "PixelStride::is_auto")]
    pub pixel_stride: PixelStride,
    /// Learned steps whose lengths are searched for.
    #[serde(default, skip_serializing_if = "LineSearch::is_auto")]
    pub line_search: LineSearch,
    /// Where views are drawn.
    #[serde(default, skip_serializing_if = "DeviceChoice::is_auto")]
    pub device: DeviceChoice,
    /// 10^6 bytes that a GPU may take; `None` for what its driver gives.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub device_memory: Option<NonZeroUsize>,
}

impl Default for Recipe {
    /// The network with its query, pruning by exact effects, and three learned steps.
    fn default() -> Self {
        Self {
            background: Mode::Auto,
            coarseness: Coarseness::default(),
            network: true,
            query: true,
            density: Density::Exact,
            density_scope: Scope::All,
            thresholds: Thresholds::default(),
            max_gaussians: usual_limit(Density::Exact),
            refine_steps: 3,
            adam_passes: 0,
            refine_views: None,
            pixel_stride: PixelStride::Auto,
            line_search: LineSearch::Auto,
            device: DeviceChoice::Auto,
            device_memory: None,
        }
    }
}

impl Recipe {
    /// The initial Gaussians alone: no network, no optimisation.
    pub fn initial(start: Start) -> Self {
        Self {
            background: start.background,
            coarseness: start.coarseness,
            network: false,
            refine_steps: 0,
            ..Self::default().with_density(Density::Off)
        }
    }

    /// The recipe with another who prunes and adds, and as many Gaussians as that usually leaves.
    #[must_use]
    pub fn with_density(self, density: Density) -> Self {
        Self { density, max_gaussians: usual_limit(density), ..self }
    }

    /// Whether anybody refines.
    pub const fn refines(&self) -> bool {
        (self.network && self.refine_steps > 0) || self.adam_passes > 0
    }

    /// Whether anybody draws the input views: to refine, or to see which Gaussians they need.
    pub fn draws_inputs(&self) -> bool {
        self.refines() || (self.network && self.density == Density::Exact)
    }

    /// Where views are drawn, held to the memory that it may take.
    pub fn device(&self) -> Device {
        self.device.opened().held_to(self.device_memory)
    }

    /// The views that a learned step looks at.
    pub(crate) const fn view_schedule(&self, seed: u64) -> ViewSchedule {
        ViewSchedule { views_per_step: self.refine_views, seed }
    }

    /// The views that a step of per-scene optimisation looks at: one, where nobody asks for more.
    pub(crate) fn adam_schedule(&self, seed: u64) -> ViewSchedule {
        ViewSchedule { views_per_step: self.refine_views.or(NonZeroUsize::new(1)), seed }
    }

    /// What the scene begins with.
    pub const fn start(&self) -> Start {
        Start { background: self.background, coarseness: self.coarseness }
    }

    /// Changes the option of this name to a value.
    ///
    /// # Errors
    /// What was expected instead of the value, or that there is no such option.
    pub fn set(&mut self, name: &str, value: &str) -> Result<(), String> {
        let knob = KNOBS.iter().find(|knob| knob.name == name);
        (knob.ok_or_else(|| format!("expected an option of a recipe, found {name}"))?.set)(self, value)
    }

    /// The names and values of the options that ask for it, where the weights are named apart.
    pub fn options(&self) -> Vec<(&'static str, String)> {
        KNOBS.iter().filter_map(|knob| Some((knob.name, knob.option(self)?))).collect()
    }

    /// The flags that ask for it, with the weights that ship where there is a network.
    pub fn flags(&self) -> String {
        let mut options = self.options();
        if !self.network {
            options.insert(0, ("weights", "none".to_owned()));
        }
        flags(options).join(" ")
    }
}

/// How many Gaussians are left where nobody says otherwise: 70 % with exact effects, else no limit.
pub fn usual_limit(density: Density) -> Option<Limit> {
    (density == Density::Exact).then_some(Limit::Percent(70))
}

/// Options as a command line has them: two words for each.
pub fn flags<'a>(options: impl IntoIterator<Item = (&'a str, String)>) -> Vec<String> {
    options.into_iter().flat_map(|(name, value)| [format!("--{name}"), value]).collect()
}

/// The word that stands for a value in JSON and on the command line.
pub fn word(value: &impl Serialize) -> String {
    serde_json::to_value(value).ok().and_then(|value| value.as_str().map(str::to_owned)).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn as_flags(options: &str) -> String {
        options.split(", ").map(|option| format!("--{option}")).collect::<Vec<_>>().join(" ")
    }

    #[test]
    fn flags_say_what_is_not_as_usual() {
        let usual = Recipe::default();
        assert_eq!(
            usual.flags(),
            as_flags("background auto, query on, density exact, max-gaussians 70%, refine-steps 3")
        );
        let policy = usual.with_density(Density::Policy);
        assert!(policy.flags().contains(&as_flags("density policy, refine-steps 3")));
        let adam =
            Recipe { network: false, background: Mode::Gaps, adam_passes: 30, pixel_stride: PixelStride::ALL, ..usual };
        assert_eq!(adam.flags(), as_flags("weights none, background gaps, refine-with adam:30, pixel-stride 1"));
        let quicker = Recipe { line_search: LineSearch::Last, adam_passes: 2, ..usual };
        assert!(quicker.flags().ends_with(&as_flags("refine-with adam:2, refine-steps 3, line-search last")));
        let eager = Recipe { thresholds: Thresholds { prune: 0.9, add: 0.5 }, ..policy };
        assert!(eager.flags().contains(&as_flags("density policy, theta-prune 0.9, theta-add 0.5, refine-steps 3")));
    }
}
