//! What runs where no preset and no budget is asked for.

use crate::network::source::ModelSource;
use crate::recipe::Recipe;

/// Options that say who refines, or in how many steps.
pub const REFINER: &[&str] = &["refine-with", "refine-steps"];

/// The recipe that flags change where nobody asks for a preset or a budget; `refiner` is whether
/// one of [`REFINER`] is among them.
///
/// With the weights that ship, two learned steps and four of per-scene optimisation in place of the third: in the same time ten real clips have
/// MEASURED. Of other weights nothing is known, and what a flag asks for comes alone.
pub fn usual(weights: &ModelSource, refiner: bool) -> Recipe {
    match weights {
        ModelSource::Shipped if !refiner => Recipe { refine_steps: 2, adam_steps: 4, ..Recipe::default() },
        _ => Recipe::default(),
    }
}
