//! One configuration of a reconstruction: a recipe and weights.

use lgs_engine::{
    densify::{Density, Scope},
    gaussians::background::Mode,
    recipe::{Recipe, usual_limit, word},
    refine::{LineSearch, PixelStride},
};
use serde::{Deserialize, Serialize};

use crate::error::{MeasureError, Result};

/// Weights, apart from where they lie.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Weights {
    /// What people call them: the name of the file, or that of weights that ship.
    pub name: String,
    /// SHA-256 of the file; for seeded weights `random:` and that of the config.
    pub sha256: String,
}

/// One configuration of a reconstruction.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Setting {
    /// Of the network; `None` for a recipe without one.
    pub weights: Option<Weights>,
    /// The recipe.
    pub recipe: Recipe,
}

impl Setting {
    /// Whether it is the reference: per-scene optimisation without a network.
    pub const fn is_reference(&self) -> bool {
        self.weights.is_none()
    }

    /// Whether it is the same as another but for the passes of per-scene optimisation.
    pub fn differs_in_steps_only(&self, other: &Self) -> bool {
        let adam_passes = self.recipe.adam_passes;
        self.weights == other.weights && self.recipe == Recipe { adam_passes, ..other.recipe }
    }

    /// Steps of both refinements.
    pub const fn steps(&self) -> usize {
        self.recipe.refine_steps + self.recipe.adam_passes
    }

    /// A text that tells it from every other.
    ///
    /// # Errors
    /// Never: it holds nothing that JSON cannot say.
    pub fn identity(&self) -> Result<String> {
        serde_json::to_string(self).map_err(|source| MeasureError::Json { what: "configuration", source })
    }

    /// A name for people, of what is not as usual.
    pub fn name(&self) -> String {
        let (mut parts, recipe) = (Vec::new(), &self.recipe);
        parts.extend(self.weights.as_ref().map(|weights| weights.name.clone()));
        let plural = if recipe.refine_steps == 1 { "" } else { "s" };
        parts.extend(recipe.network.then(|| format!("{} step{plural}", recipe.refine_steps)));
        match recipe.line_search {
            LineSearch::Auto => {}
            LineSearch::Every => parts.push("line search in each".to_owned()),
            LineSearch::Last => parts.push("line search in the last".to_owned()),
            LineSearch::Off => parts.push("no line search".to_owned()),
        }
        parts.extend((recipe.adam_passes > 0 || !recipe.network).then(|| format!("Adam {}", recipe.adam_passes)));
        parts.extend(recipe.refine_views.map(|views| format!("{views} views a step")));
        parts.extend((!recipe.device.is_auto()).then(|| format!("on {}", String::from(recipe.device))));
        match recipe.pixel_stride {
            PixelStride::Auto => {}
            PixelStride::ALL => parts.push("all pixels".to_owned()),
            stride => parts.push(format!("pixel stride {stride}")),
        }
        if recipe.network {
            parts.extend((!recipe.query).then(|| "no query".to_owned()));
            match recipe.density {
                Density::Exact => {
                    parts.extend((recipe.density_scope == Scope::Lidar).then(|| "LiDAR alone pruned".to_owned()));
                }
                Density::Policy => parts.push("density by policy".to_owned()),
                Density::Random => parts.push("density by chance".to_owned()),
                Density::Off => parts.push("no pruning".to_owned()),
            }
            if recipe.density != Density::Off && !recipe.thresholds.are_usual() {
                parts.push(format!("theta {}", recipe.thresholds.prune));
            }
            if recipe.max_gaussians != usual_limit(recipe.density) {
                let limit = |most| format!("at most {most}");
                parts.push(recipe.max_gaussians.map_or("no limit".to_owned(), limit));
            }
        }
        match recipe.background {
            Mode::Auto => {}
            Mode::Off => parts.push("no background".to_owned()),
            other => parts.push(format!("background {}", word(&other))),
        }
        parts.extend((!recipe.coarseness.is_usual()).then(|| format!("coarseness {}", recipe.coarseness)));
        parts.join(", ")
    }
}

#[cfg(test)]
mod tests {
    use lgs_engine::densify::Limit;

    use super::*;

    #[test]
    fn a_name_says_what_is_not_as_usual() {
        let usual = Recipe::default();
        let name = |recipe: Recipe| Setting { weights: None, recipe }.name();
        assert_eq!(name(usual), "3 steps");
        assert_eq!(name(Recipe { density_scope: Scope::Lidar, ..usual }), "3 steps, LiDAR alone pruned");
        assert_eq!(name(Recipe { max_gaussians: None, ..usual }), "3 steps, no limit");
        assert_eq!(name(usual.with_density(Density::Policy)), "3 steps, density by policy");
        assert_eq!(name(usual.with_density(Density::Off)), "3 steps, no pruning");
        let fewer = Recipe { max_gaussians: Some(Limit::Count(9)), ..usual.with_density(Density::Random) };
        assert_eq!(name(fewer), "3 steps, density by chance, at most 9");
    }
}
