//! A run of `lgs-infer` with a time budget.

use lgs_engine::recipe::Recipe;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::error::{MeasureError, Result};

/// A run with a budget.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BudgetRun {
    /// What was asked for: seconds from the start of the program until the scene is finished.
    pub budget_s: f64,
    /// What it took.
    pub finished_s: f64,
    /// Seconds before the reconstruction began.
    pub before_s: f64,
    /// Whether the program knew something that fits.
    pub fits: bool,
    /// What ran.
    pub recipe: Recipe,
    /// Mean PSNR over the held-out views, dB.
    pub psnr: Option<f64>,
}

impl BudgetRun {
    /// The run that a `metrics.json` tells of.
    ///
    /// # Errors
    /// A page without a budget.
    pub fn of(metrics: &Value) -> Result<Self> {
        let budget = &metrics["budget"];
        let seconds = |value: &Value| {
            value
                .as_f64()
                .ok_or_else(|| MeasureError::unfit("metrics.json", "seconds of a budget and of stages", value))
        };
        let recipe = serde_json::from_value(budget["recipe"].clone());
        Ok(Self {
            budget_s: seconds(&budget["budget_s"])?,
            finished_s: seconds(&budget["finished_s"])?,
            before_s: seconds(&budget["before_s"])? - seconds(&metrics["stages_s"]["points"])?,
            fits: budget["fits"] == true,
            recipe: recipe.map_err(|source| MeasureError::Json { what: "recipe of a budget", source })?,
            psnr: metrics["mean"]["held_out"]["psnr"].as_f64(),
        })
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_run_is_read_from_what_inference_writes() {
        let recipe = Recipe { refine_steps: 1, adam_passes: 4, ..Recipe::default() };
        let page = json!({
            "budget": { "budget_s": 2.0, "before_s": 0.5, "fits": true, "finished_s": 1.75, "recipe": recipe },
            "stages_s": { "points": 0.25 },
            "mean": { "held_out": { "psnr": 21.5 } },
        });
        let want = BudgetRun { budget_s: 2.0, finished_s: 1.75, before_s: 0.25, fits: true, recipe, psnr: Some(21.5) };
        assert_eq!(BudgetRun::of(&page).unwrap(), want);
        assert!(BudgetRun::of(&json!({ "budget": null })).is_err());
    }
}
